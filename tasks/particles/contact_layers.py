"""Layers at the predicted contact: those of the object above it and those of the base below it."""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.particles import ColumnLayer
from tasks.bodies.footprint import Footprint, joined
from tasks.bodies.layered_patch import Layer
from tasks.particles.drop_setup import DropSetup
from tasks.particles.layers import COLUMN_STEPS, column_of
from tasks.particles.object_parts import part_at

Array = NDArray[np.float64]

RIGID: Layer = (np.inf, 0.0)
"""Support of the base."""


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
    """Part and material."""
    return [(row.part, row.material.id) for row in rows]


def compliance_of(row: PartMaterial) -> float:
    """(1 - nu^2) / E [1/Pa]; 0 if rigid."""
    if row.model is BodyModel.RIGID:
        return 0.0
    return (1.0 - row.material.poisson_ratio**2) / row.material.youngs_modulus
