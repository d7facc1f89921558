"""Explicit steps are refused where they would not see a layer under the contact."""

import numpy as np
import pytest

from dcap.geometry.distance import distance_grid
from dcap.geometry.primitives import Box
from dcap.scene.errors import GeometryError
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import (
    BackgroundGrid,
    ColumnLayer,
    InertialProperties,
    MaterialPoints,
    Particles,
    SoftSimulationBody,
)
from tasks.drop.stage import refuse_coarse_layers

HERE = np.array([[[-0.1, -0.1], [0.1, 0.1]]])
BLANKET, MATTRESS = ColumnLayer("blanket", "wool", 0.0, 0.03), ColumnLayer("mattress", "foam", 0.03, 0.2)


def bed(cell: float, instance: str = "bed") -> SoftSimulationBody:
    """A slab of 0.2 m whose top is at 0.2 m, with cells of one height."""
    surface = Box(np.array([0.4, 0.4, 0.2])).surface(0.05)
    mesh = Mesh.of(surface.vertices + np.array([0.0, 0.0, 0.1]), surface.faces)
    sides, heights = np.linspace(-0.2, 0.2, 5), np.linspace(0.0, 0.2, round(0.2 / cell) + 1)
    state = np.zeros((5, 5, len(heights)), np.int8)
    return SoftSimulationBody(
        name=instance, instance=instance, fixed=True, surface=mesh,
        distance=distance_grid(mesh, mesh.bounds[0] - 0.01, mesh.bounds[1] + 0.01, 0.02),
        inertial=InertialProperties(1.0, np.zeros(3), np.eye(3)), friction=ContactFriction(0.5, 0.4, 1e-3),
        points=MaterialPoints(np.zeros((1, 3)), np.ones(1), np.ones(1), np.ones(1), np.ones(1)),
        grid=BackgroundGrid(sides, sides, heights, state), loaded=True,
    )  # fmt: skip


def on(body: SoftSimulationBody, *column: ColumnLayer, foreseen: np.ndarray | None = HERE) -> Particles:
    """Something that is to touch it in the middle."""
    return Particles((body,), (), 0.01, (), column=column, foreseen=foreseen)


def test_a_layer_with_too_few_particles_is_refused() -> None:
    """The line says how many there are and what cells would do; those cells do."""
    refuse_coarse_layers(on(bed(0.01), BLANKET, MATTRESS))
    with pytest.raises(
        GeometryError,
        match=r"1\.2 particles through blanket under the contact \(30 mm thick\).*--resolution 0\.02 or finer",
    ):
        refuse_coarse_layers(on(bed(0.05), BLANKET, MATTRESS))
    refuse_coarse_layers(on(bed(0.02), BLANKET, MATTRESS))
    refuse_coarse_layers(on(bed(0.05), MATTRESS))


def test_a_soft_object_needs_as_many_particles() -> None:
    """Through all of it, wherever it touches."""
    refuse_coarse_layers(on(bed(0.1, "object"), BLANKET))
    with pytest.raises(GeometryError, match=r"2\.0 particles through the object \(200 mm thick\).*object_cells"):
        refuse_coarse_layers(on(bed(0.2, "object"), foreseen=None))
