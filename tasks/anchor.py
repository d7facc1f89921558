"""Stage 5, anchor: the part and the place on it, from which gravity does the rest.

In: scene, object, intent and rotation. Out: `Anchor` with the pre-drop pose, or `no_support_hit`, or
`too_large_for_target`. The region's aim is tried first, then the spots around it: a ray along gravity must hit the
part, the object's underside must be over it, and nothing else may be in the way. Faces need not look up. The object's
centre of mass goes over the anchor, and its lowest points start `clearance` above what lies beneath them, measured
between the meshes.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveFloat

from geometry.landing import SHARES, Landing, Refusal, Spot, vertical_gap
from geometry.poses import center_of_mass
from geometry.raycast import Raycaster
from geometry.regions import Frame, Region, regions
from language.questions import ANCHOR
from language.replies import AnchorReply
from language.requests import AnchorRequest
from language.seam import LanguageConfig, client
from scene.anchor import Anchor
from scene.intent import Intent
from scene.mesh import Mesh
from scene.outcome import Infeasible, Reason
from scene.rotation import Rotation
from scene.segmentation import Instance, Segmentation
from tasks.stage import stage
from tasks.surroundings import part_frame, reference_boxes
from tasks.views import instance_of, part_views

Array = NDArray[np.float64]
COVERS = frozenset({"blanket", "mattress"})
"""Parts that lie on each other: whichever is on top there carries the object."""
LIFT = 0.05
"""The gap is measured from this height over the estimated contact [m]; more than any sampling error."""


class AnchorConfig(BaseModel, frozen=True, extra="forbid"):
    """Who is asked, and where the drop starts."""

    language: LanguageConfig = LanguageConfig()
    clearance: PositiveFloat = 0.01
    """Smallest vertical gap at the start [m]; the paper's 1 cm."""


@dataclass(frozen=True, eq=False, slots=True)
class Choice:
    """A part with its frame and the areas to try."""

    index: int
    frame: Frame
    areas: list[Region]


def anchor(
    scene: Segmentation, item: Segmentation, intent: Intent, rotation: Rotation, config: AnchorConfig
) -> Anchor | Infeasible:
    """Choose part and region, find a free spot, set the object over it."""
    base = instance_of(scene, intent.base_id)
    pose = np.eye(4)
    pose[:3, :3] = intent.scale * rotation.matrix
    mesh = item.mesh.transformed(pose)
    center = center_of_mass(mesh)
    pose[:3, 3] = -center
    mesh = item.mesh.transformed(pose)
    reply = client(config.language).ask(ANCHOR, request_of(scene, base, intent, mesh))
    caster = Raycaster(scene.mesh)
    choice = choice_of(scene, base, intent, reply, reply.part_index, mesh)
    choice, covered = topmost(scene, base, intent, reply, choice, mesh, caster)
    landing = landing_of(scene, base, choice.index, mesh, caster)
    found = first_spot(landing, choice.areas)
    if found is None:
        return refused(base, choice, landing, intent, mesh)
    return anchored(scene, base, choice, found, landing, mesh, pose, caster, config, reply, covered)


anchor_task = stage(anchor)


# choosing -----------------------------------------------------------------------------------------------------------


def request_of(scene: Segmentation, base: Instance, intent: Intent, mesh: Mesh) -> AnchorRequest:
    """What the client needs to choose."""
    frame = part_frame(scene, base, base.box)
    size = np.ptp(mesh.bounds, axis=0)
    return AnchorRequest(
        prompt=intent.region.words,
        object_name=intent.object_name,
        footprint=(float(size[0]), float(size[1])),
        base_label=base.label,
        parts=part_views(scene, scene.index_of(base.id)),
        asked_part=intent.region.part,
        asked_which=intent.region.which,
        asked_regions=intent.region.names,
        asked_references=intent.region.references,
        right=(float(frame.right[0]), float(frame.right[1]), 0.0),
        front=(float(frame.front[0]), float(frame.front[1]), 0.0),
    )


def radius_of(mesh: Mesh) -> float:
    """Half the larger horizontal extent [m]."""
    return 0.5 * float(np.ptp(mesh.bounds[:, :2], axis=0).max())


def choice_of(
    scene: Segmentation, base: Instance, intent: Intent, reply: AnchorReply, index: int, mesh: Mesh
) -> Choice:
    """The areas that the reply means on one part."""
    part = base.parts[index]
    frame = part_frame(scene, base, part.box)
    boxes = reference_boxes(scene, base, reply.references, part.box.center)
    # "near the pillow" with two pillows: the nearer one first; "between" takes all of them together
    groups = [[box] for box in boxes] if boxes and "between" not in reply.regions else [boxes]
    areas = [area for group in groups for area in regions(frame, reply.regions, group, radius_of(mesh))]
    if reply.point is not None:
        areas = [replace(area, target=frame.world(np.array(reply.point))) for area in areas]
    return Choice(index, frame, areas)


def topmost(
    scene: Segmentation,
    base: Instance,
    intent: Intent,
    reply: AnchorReply,
    choice: Choice,
    mesh: Mesh,
    caster: Raycaster,
) -> tuple[Choice, str]:
    """The blanket instead of the mattress, or the other way round, where that is what lies on top at the aim."""
    name = base.parts[choice.index].name
    if name not in COVERS or not choice.areas:
        return choice, ""
    hit = face_below(caster, np.array([*choice.areas[0].target, max(part.box.top for part in base.parts) + 1.0]))
    other = part_at(scene, base, hit)
    explicit = intent.region.part == name
    if other < 0 or other == choice.index or base.parts[other].name not in COVERS:
        return choice, ""
    if explicit and exposed(scene, base, choice.index, caster) > 0.3:
        return choice, ""
    better = choice_of(scene, base, intent, reply, other, mesh)
    if not better.areas:
        return choice, ""
    return better, f"; there the {base.parts[other].name} lies on the {name}"


def exposed(scene: Segmentation, base: Instance, index: int, caster: Raycaster) -> float:
    """Share of a part's box from which a ray down meets the part first [-]."""
    box = base.parts[index].box
    steps = (np.arange(12) + 0.5) / 6.0 - 1.0
    u, v = np.meshgrid(steps, steps)
    local = np.c_[u.ravel(), v.ravel(), np.ones(u.size)] * box.half_extents + (0.0, 0.0, 0.3)
    hits = caster.cast(box.to_world(local), np.tile([0.0, 0.0, -1.0], (u.size, 1)))
    return float(np.mean([part_at(scene, base, int(face)) == index for face in hits.face]))


def face_below(caster: Raycaster, point: Array) -> int:
    """Index of the first face under a point, -1 if there is none."""
    return int(caster.cast(point[None], np.array([[0.0, 0.0, -1.0]])).face[0])


def part_at(scene: Segmentation, base: Instance, face: int) -> int:
    """Part index of a face of the base, -1 if it is none."""
    if face < 0 or scene.face_instance[face] != scene.index_of(base.id):
        return -1
    return int(scene.face_part[face])


# finding ------------------------------------------------------------------------------------------------------------


def landing_of(scene: Segmentation, base: Instance, index: int, mesh: Mesh, caster: Raycaster) -> Landing:
    """The part's surface and the object's underside, sampled."""
    mask = (scene.face_instance == scene.index_of(base.id)) & (scene.face_part == index)
    low, high = (
        scene.mesh.triangles[mask].reshape(-1, 3).min(axis=0),
        scene.mesh.triangles[mask].reshape(-1, 3).max(axis=0),
    )
    return Landing(caster, mask, mesh, low, high)


def first_spot(landing: Landing, areas: list[Region]) -> tuple[Region, Spot] | None:
    """The best supported free spot; of equally good ones the nearest to the aim of the first area."""
    for share in SHARES:
        for area in areas:
            spot = landing.find(area, share)
            if spot is not None:
                return area, spot
    return None


def refused(base: Instance, choice: Choice, landing: Landing, intent: Intent, mesh: Mesh) -> Infeasible:
    """Why there is no spot, with numbers."""
    part = base.parts[choice.index]
    size = np.ptp(mesh.bounds, axis=0)
    space = 2.0 * choice.frame.half
    region = " ".join(intent.region.names) or "whole surface"
    reasons = [landing.refusal(area) for area in choice.areas] or [Refusal(False, 0.0, 0.0)]
    best = max(reason.best_share for reason in reasons)
    evidence: dict[str, object] = {
        "base": base.id,
        "part": part.name,
        "region": region,
        "footprint_m": [round(float(s), 4) for s in size[:2]],
        "height_m": round(float(size[2]), 4),
        "part_size_m": [round(float(s), 4) for s in space],
        "best_supported_share": round(best, 4),
        "needed_share": SHARES[-1],
        "blocked_share": round(max(reason.blocked for reason in reasons), 4),
    }
    where = f"the {region} of {part.name} of {base.label}"
    if not any(reason.hit for reason in reasons):
        return Infeasible(Reason.NO_SUPPORT_HIT, f"no ray along gravity meets {where}", evidence)
    text = (
        f"{intent.object_name} of {size[0]:.2f} x {size[1]:.2f} m does not fit on {where} "
        f"({space[0]:.2f} x {space[1]:.2f} m): at best {100 * best:.0f} % of its underside would be supported "
        f"without anything in the way, {100 * SHARES[-1]:.0f} % are needed"
    )
    return Infeasible(Reason.TOO_LARGE_FOR_TARGET, text, evidence)


# setting ------------------------------------------------------------------------------------------------------------


def anchored(
    scene: Segmentation, base: Instance, choice: Choice, found: tuple[Region, Spot], landing: Landing, mesh: Mesh,
    pose: Array, caster: Raycaster, config: AnchorConfig, reply: AnchorReply, note: str,
) -> Anchor:  # fmt: skip
    """The pre-drop pose over the spot with the exact clearance."""
    region, spot = found
    part = base.parts[choice.index]
    height, gap = settled_height(scene.mesh, caster, mesh, spot, landing, config.clearance)
    world_from_object = pose.copy()
    world_from_object[:3, 3] += (spot.x, spot.y, height)
    hit = caster.cast(np.array([[spot.x, spot.y, landing.top]]), np.array([[0.0, 0.0, -1.0]]))
    share = "" if spot.share >= SHARES[0] else f"; {100 * spot.share:.0f} % of its underside are over the {part.name}"
    return Anchor(
        base_id=base.id,
        part=part.name,
        part_index=choice.index,
        region=" ".join(reply.regions) or "center",
        local=choice.frame.local(np.array([spot.x, spot.y])),
        surface_point=hit.position[0],
        world_from_object=world_from_object,
        clearance=gap,
        region_polygon=region.polygon,
        reason=f"{reply.reason}{note}{share}",
    )


def settled_height(
    scene: Mesh, caster: Raycaster, mesh: Mesh, spot: Spot, landing: Landing, clearance: float
) -> tuple[float, float]:
    """Height of the object's origin that leaves the clearance, and the gap measured there [m]."""
    touching = landing.start_height(spot)
    lifted = np.eye(4)
    lifted[:3, 3] = spot.x, spot.y, touching + LIFT
    raised = mesh.transformed(lifted)
    gap = vertical_gap(raised, Raycaster(raised), scene, caster, float(raised.bounds[1, 2]))
    height = touching + LIFT - min(gap, LIFT) + clearance
    return height, clearance
