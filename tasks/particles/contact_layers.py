"""Layers at the predicted contact, and the depth of a soft base under its visible surface.

Each part of a soft base reaches down to its support, or as far as it is thick.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.solid.support import carried_bottoms
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.particles import GRAVITY, ColumnLayer
from tasks.bodies.footprint import Footprint, joined
from tasks.bodies.plan_contact import Layer
from tasks.particles.drop_setup import DropSetup
from tasks.particles.layers import COLUMN_STEPS, BaseLayers, Cover, column_of, lies_under, looks_up
from tasks.particles.object_body import part_at

RIGID: Layer = (np.inf, 0.0)
"""Layer of the base's support."""


def footprint_on(setup: DropSetup, base: list[Layer]) -> Footprint:
    """The object's predicted contact with layers of the base, from the top down."""
    weight, stacks = (setup.intent.mass + setup.borne) * GRAVITY, (object_layers(setup), [*base, RIGID])
    foot = setup.descent.footprint(weight, stacks)
    for other in setup.beside:
        foot = joined(foot, footprint_on(other, base))
    return foot if setup.returned is None else joined(foot, setup.returned.footprint(weight, stacks))


def object_layers(setup: DropSetup) -> list[Layer]:
    """The parts of the object straight above the contact, up to its top."""
    rows = setup.materials.of_parts(setup.body, len(setup.item.instances[0].parts))
    part_of_face = np.clip(setup.item.face_part, 0, None)
    used = np.unique(part_of_face).tolist()
    lying, first = setup.descent.lying, setup.descent.first
    bottom, top = (float(z) for z in lying.bounds[:, 2])
    if len(used) == 1 or all(rows[p].model is BodyModel.RIGID for p in used):
        return [(top - bottom, compliance_of(rows[used[0]]))]
    start = float(first[2] + setup.descent.way.min())
    depth = np.linspace(0.0, max(top - start, 0.0), COLUMN_STEPS)
    points = np.column_stack([np.tile(first[:2], (len(depth), 1)), start + depth])
    owner = part_at(lying, part_of_face, points)
    return layers_of(column_of(owner, depth, names_of(rows)), rows)


def layers_of(column: tuple[ColumnLayer, ...], rows: list[PartMaterial]) -> list[Layer]:
    """Thickness and compliance of each layer of a column."""
    named = {name: compliance_of(row) for name, row in zip(names_of(rows), rows, strict=True)}
    return [(one.to_m - one.from_m, named[one.part, one.material]) for one in column if one.to_m > one.from_m]


def names_of(rows: list[PartMaterial]) -> list[tuple[str, str]]:
    """Name and material of each part."""
    return [(row.part, row.material.id) for row in rows]


def compliance_of(row: PartMaterial) -> float:
    """Compliance (1 - nu^2) / E [1/Pa]; 0 if rigid."""
    if row.model is BodyModel.RIGID:
        return 0.0
    return (1.0 - row.material.poisson_ratio**2) / row.material.youngs_modulus


def soft_bottoms(setup: DropSetup, layers: BaseLayers) -> Array:
    """Bottom of the soft solid under each face [m], shape (m,)."""
    boxes = [layers.base.parts[index].box for index in layers.soft]
    bottom = dict(zip(layers.soft, carried_bottoms(boxes).tolist(), strict=True))
    seen = set(layers.part.tolist())
    for index in layers.carrying:
        if index in seen:
            bottom[index] = thick_enough(setup, layers, index, bottom[index])
    # the part that carries a cover is not a cover, so covers can be handled in any order
    carrying = {index: bottom[index] for index in layers.carrying}
    for index in seen & set(layers.covers):
        bottom[index] = cover_bottom(setup, layers, layers.covers[index], bottom[index], carrying)
    return np.array([bottom[index] for index in layers.part.tolist()])


def thick_enough(setup: DropSetup, layers: BaseLayers, index: int, bottom: float) -> float:
    """Bottom of a part that is not a cover [m]; a part that looks like a sheet gets the least thickness."""
    least = setup.config.least_thickness
    top = float(np.median(layers.mesh.triangles[layers.part == index][:, :, 2]))
    if top - bottom >= least:
        return bottom
    taken = (
        f"{layers.base.id}: {layers.base.parts[index].name} shows no thickness and is assumed to be {least} m thick "
        "(ParticlesConfig.least_thickness)"
    )
    setup.notes.append(Caution(Cause.ASSUMED, taken))
    return top - least


def cover_bottom(
    setup: DropSetup, layers: BaseLayers, cover: Cover, own: float, carrying: Mapping[int, float]
) -> float:
    """Bottom under a cover [m]: over soft parts the lowest of their bottoms and its own; elsewhere its lowest height
    where the object may touch, minus the thickness of this cover and those beneath it."""
    under = [bottom for index, bottom in carrying.items() if lies_under(layers.base, index, cover)]
    if under:
        return min([own, *under])
    depth = sum(layers.covers[index].thickness for index in (cover.part, *layers.beneath[cover.part]))
    return lowest_top(layers.mesh, layers.part == cover.part, setup) - depth


def lowest_top(mesh: Mesh, own: NDArray[np.bool_], setup: DropSetup) -> float:
    """Lowest height of a cover's upward faces (m,) in the region that the object may touch [m]: there a wavy cloth lies
    on its support. If the region has none, all upward faces count; if there are none, all faces."""
    upward = own & looks_up(mesh)
    choices: Sequence[NDArray[np.bool_]] = (upward & setup.in_contact_region(mesh.triangles), upward, own)
    chosen = next(faces for faces in choices if faces.any())
    return float(mesh.triangles[chosen][:, :, 2].min())
