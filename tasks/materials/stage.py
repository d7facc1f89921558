"""Stage 6, materials: one row of the library for each part, rigid above 1 GPa, everything else soft.

In: scene, object, intent, anchor and prompt. Out: `PartMaterials`: the object's parts, the base's, then those of the
neighbours within reach (only as obstacles). Rows are selected, never mixed. The density of a hollow thing is fitted to
the mass prior when its particles are filled; the reason says so. With `load_aware`, parts of object or base whose
predicted deflection under the object's weight is invisible are rigid too, with the reason and a note for each.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, NonNegativeFloat, PositiveFloat

from dcap.geometry.camera import looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.knowledge.material_table import load_materials
from dcap.language.connect import Client
from dcap.language.offline.material_choice import shortlist
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import MATERIALS
from dcap.language.protocol.replies import MaterialChoice
from dcap.language.protocol.requests import MaterialQuestion, MaterialsRequest, Picture
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.earlier import FreedThings
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import GRAVITY
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from solver.contact.patch import deflection
from tasks.bodies.footprint import first_curvature
from tasks.cache import stage
from tasks.requests.surroundings import part_frame
from tasks.requests.views import part_views, sums_of

OBJECT = "object"
MOST_ROWS = 20
"""Number of rows of the library that are offered; more only for questions with more parts [-]."""
PICTURE, DISTANCE = 512, 1.3
"""Side length of the picture [pixels], and distance of its camera over the visible extent [-]."""
LIMITED = "materials are clamped to the paper's limits (E 5e4 to 5e9 Pa, density 30 to 8000 kg/m3, friction 0.05 to 1)"


def stiffened(
    rows: list[PartMaterial], scene: Segmentation, item: Segmentation, intent: Intent, anchor: Anchor, invisible: float
) -> tuple[list[PartMaterial], tuple[str, ...]]:
    """Make parts rigid that deflect less than `invisible` [m] under the object's weight.

    The deflection is Hertz's indentation with the curvature of the object's underside, as if the part were alone, plus
    bending: of a part of the object as a bar clamped at one end, of a part of the base as a bar of its own height,
    since its bottom is held.
    """
    weight = intent.mass * GRAVITY
    base = scene.index_of(anchor.base_id)
    beneath = Raycaster(scene.mesh.submesh(np.flatnonzero(scene.face_instance == base)))
    mesh = item.mesh.transformed(anchor.world_from_object)
    radius = first_curvature(mesh, beneath, float(anchor.surface_point[2]))
    scale = float(np.linalg.norm(anchor.world_from_object[:3, 2]))
    changed, notes = [], []
    for row in rows:
        m = row.material
        if row.body == OBJECT:
            x, y, z = scale * 2.0 * item.instances[0].parts[row.part_index].box.half_extents
            thickness, width, length = sorted((float(x), float(y), float(z)))
        elif row.body == anchor.base_id:
            x, y, length = 2.0 * scene.instances[base].parts[row.part_index].box.half_extents
            thickness, width = sorted((float(x), float(y)))
        else:  # neighbours are rigid obstacles anyway
            changed.append(row)
            continue
        depth = deflection(weight, radius, (length, width, thickness), m.youngs_modulus, m.poisson_ratio)
        if row.model is BodyModel.MPM and depth < invisible:
            why = f"would give {1e3 * depth:.2g} mm under {weight:.3g} N, below {1e3 * invisible:.2g} mm (load-aware)"
            notes.append(f"{row.body}: {row.part} ({m.id}) is treated as rigid: it {why}")
            row = replace(row, model=BodyModel.RIGID, reason=f"{row.reason}; but it {why}: rigid")
        changed.append(row)
    return changed, tuple(notes)


class MaterialsConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and the limit of soft materials."""

    language: LanguageConfig = LanguageConfig()
    rigid_above: PositiveFloat = 1.0e9
    """Young's modulus above which a part is rigid [Pa]; the paper's 1 GPa."""
    paper_limits: bool = False
    """Clamp the constants as the paper's section 4.3 does; makes most foams alike."""
    blended: bool = False
    """Blend constants with the mean of all rows of the same kind: an ablation."""
    load_aware: bool = False
    """Parts with an invisible deflection under the object's weight are rigid too."""
    invisible: PositiveFloat = 5e-5
    """Invisible deflection [m]; the penetration_target of the solver."""
    neighbour_distance: NonNegativeFloat = 0.3
    """Largest distance between the boxes of a neighbour and of the object's start [m]."""


def materials(
    scene: SegmentedScene,
    item: SegmentedObject,
    intent: Intent,
    anchor: Anchor,
    prompt: str,
    config: MaterialsConfig,
    client: Client,
    freed: FreedThings | None = None,
) -> PartMaterials | Infeasible:
    """Ask once for all parts, except for those known from an earlier placement (`freed`)."""
    library = load_materials()
    known = {(row.body, row.part_index): row for row in freed.materials} if freed is not None else {}
    taking_part = () if freed is None else (freed.ground, *(one.id for one in freed.things))
    around = base_and_neighbours(scene, item, anchor, config, taking_part)
    before = [known[one.body, one.part.index] for one in around if (one.body, one.part.index) in known]
    asked = [one for one in around if (one.body, one.part.index) not in known]
    own = [MaterialQuestion(OBJECT, intent.object_name, part) for part in part_views(item, 0)]
    questions = [*own, *asked]
    rows_alone = tuple(replace(row, source="") for row in library.values())  # the source does not help to choose
    seen = Picture("the object over its support", partial(over_its_base, scene, item, anchor))
    whole = MaterialsRequest(prompt, tuple(questions), rows_alone, anchor.base_id, (seen,))
    request = replace(whole, library=shortlist(whole, MOST_ROWS))
    reply = client.ask(MATERIALS, request)
    given = {(choice.body, choice.part_index): choice for choice in reply.choices}
    rows = [part_material(q, given[q.body, q.part.index], library, intent, config) for q in questions]
    rows += before
    notes: tuple[str, ...] = (LIMITED,) if config.paper_limits else ()
    if config.load_aware:
        rows, stiff = stiffened(rows, scene, item, intent, anchor, config.invisible)
        notes += stiff
    return PartMaterials(tuple(rows), "paper_limits" if config.paper_limits else "none", notes)


materials_task = stage(materials)


def over_its_base(scene: Segmentation, item: Segmentation, anchor: Anchor) -> NDArray[np.uint8]:
    """The object at the start of its drop and its base, from the side of the base's viewer, RGB, shape (h, w, 3)."""
    index = scene.index_of(anchor.base_id)
    base = scene.instance_mesh(index)
    frame = part_frame(scene, scene.instances[index], scene.instances[index].box)
    above = item.mesh.transformed(anchor.world_from_object)
    corners = np.concatenate([base.bounds, above.bounds])
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    direction = np.array([*(0.7 * frame.front + 0.5 * frame.right), 0.5])
    away = DISTANCE * float(np.linalg.norm(np.ptp(corners, axis=0))) * direction
    return picture([base, above], looking_at(middle + away, middle, PICTURE, PICTURE), samples=1).rgb


def base_and_neighbours(
    scene: Segmentation, item: Segmentation, anchor: Anchor, config: MaterialsConfig, taking_part: Sequence[str] = ()
) -> list[MaterialQuestion]:
    """Questions about parts of the base, then of things within reach of the object's start or taking part for another
    reason."""
    start = item.mesh.transformed(anchor.world_from_object).bounds
    near = [i for i in scene.instances if i.id == anchor.base_id]
    for instance in scene.instances:
        corners = instance.box.corners
        apart = np.maximum(corners.min(axis=0) - start[1], start[0] - corners.max(axis=0))
        within = float(np.linalg.norm(np.maximum(apart, 0.0))) <= config.neighbour_distance
        if (within or instance.id in taking_part) and instance.id != anchor.base_id:
            near.append(instance)
    sums = sums_of(scene)
    return [
        MaterialQuestion(instance.id, instance.label, part)
        for instance in near
        for part in part_views(scene, scene.index_of(instance.id), sums)
    ]


def part_material(
    question: MaterialQuestion,
    choice: MaterialChoice,
    library: dict[str, Material],
    intent: Intent,
    config: MaterialsConfig,
) -> PartMaterial:
    """The simulated row of a part, and the reason."""
    material = library[choice.material]
    reason = choice.reason
    if config.blended:
        material = blended(material, [row for row in library.values() if row.kind == material.kind])
        reason += f"; blended with the other {material.kind} rows"
    if config.paper_limits:
        material, change = limited(material)
        reason += change
    if question.body == OBJECT and intent.hollow:
        reason += f"; hollow: its density is set so that the whole weighs {intent.mass:.3g} kg"
    model = BodyModel.RIGID if material.youngs_modulus > config.rigid_above else BodyModel.MPM
    side = "above" if model is BodyModel.RIGID else "not above"
    reason += f"; E {material.youngs_modulus:.3g} Pa is {side} {config.rigid_above:.3g} Pa"
    return PartMaterial(question.body, question.part.name, question.part.index, material, model, reason)


def blended(material: Material, rows: Sequence[Material]) -> Material:
    """The mean of the chosen row and the mean over all rows, of moduli on a logarithmic scale; without layers."""

    def mixed(own: float, others: Iterable[float]) -> float:
        return 0.5 * own + 0.5 * float(np.mean(list(others)))

    modulus = float(np.exp(np.mean(np.log([row.youngs_modulus for row in rows]))))
    return replace(
        material,
        youngs_modulus=float(np.sqrt(material.youngs_modulus * modulus)),
        layers=None,
        density=mixed(material.density, (row.density for row in rows)),
        poisson_ratio=mixed(material.poisson_ratio, (row.poisson_ratio for row in rows)),
        static_friction=mixed(material.static_friction, (row.static_friction for row in rows)),
        dynamic_friction=mixed(material.dynamic_friction, (row.dynamic_friction for row in rows)),
    )


def limited(material: Material) -> tuple[Material, str]:
    """The material within the paper's limits: E 5e4 to 5e9 Pa, nu below 0.49, rho 30 to 8000 kg/m3, friction 0.05 to 1;
    no layers."""
    static = float(np.clip(material.static_friction, 0.05, 1.0))
    changed = replace(
        material,
        youngs_modulus=float(np.clip(material.youngs_modulus, 5.0e4, 5.0e9)),
        poisson_ratio=min(material.poisson_ratio, 0.489),
        layers=None,
        density=float(np.clip(material.density, 30.0, 8000.0)),
        static_friction=static,
        dynamic_friction=float(np.clip(material.dynamic_friction, 0.05, static)),
    )
    return changed, "" if changed == material else "; clamped to the paper's limits"
