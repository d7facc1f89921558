"""The quasi-static reference of the indentation against contacts known from finite elements."""

import numpy as np
import pytest
import trimesh

from dcap.geometry.primitives import Box
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY
from tasks.bodies.footprint import heights_over
from tasks.bodies.plan_contact import Layer, plan_contact
from tasks.particles.contact_layers import RIGID


def over(shape: trimesh.Trimesh) -> Mesh:
    """A shape 1 cm over the slab, whose top is at 7.5 cm."""
    shape.apply_translation([0.0, 0.0, 0.085 - shape.bounds[0, 2]])
    return Mesh.of(np.asarray(shape.vertices), np.asarray(shape.faces))


def foam(young: float, poisson: float = 0.3, thickness: float = 0.15) -> Layer:
    return thickness, (1.0 - poisson**2) / young


def lying_capsule() -> trimesh.Trimesh:
    shape = trimesh.creation.capsule(height=0.10, radius=0.04, count=[64, 64])
    return shape.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))


@pytest.mark.parametrize(
    ("shape", "mass", "layers", "depth"),
    [
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(2e4)], 12.166e-3),
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(5e5)], 1.488e-3),
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(1.2e4, 0.2, 0.02), foam(4e4, 0.3, 0.23)], 12.547e-3),
        (trimesh.creation.cylinder(0.04, 0.1, sections=128), 1.5, [foam(5e4)], 2.617e-3),
        (lying_capsule(), 3.0, [foam(5e4)], 7.092e-3),
    ],
    ids=["ball", "ball on stiff foam", "ball on a cover", "flat cylinder", "lying capsule"],
)
def test_the_reference_is_near_finite_elements(
    shape: trimesh.Trimesh, mass: float, layers: list[Layer], depth: float
) -> None:
    """Static finite elements of a slab of 0.40 x 0.40 x 0.15 m (the covered one 0.25 m), bottom bonded."""
    slab, thing = Box(np.array([0.4, 0.4, 0.15])).surface(10.0), over(shape)
    stacks = ([(1.0, 0.0)], [*layers, RIGID])
    found = plan_contact(heights_over(thing, Raycaster(slab)), thing.bounds[:, :2], mass * GRAVITY, stacks)
    assert found is not None
    assert found.patch.approach == pytest.approx(depth, rel=0.04)  # the worst, on a cover, is 3.97 % off
