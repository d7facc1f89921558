"""What cases and placements build bodies with: mass, material points, node states, samples and the solver's model."""

import numpy as np
import pytest

from dcap.geometry.primitives import Box, Capsule
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import NodeState, Particles, RigidSimulationBody, SoftSimulationBody
from solver.model import bodies as solver_bodies
from tasks.bodies.discretization import (
    MaterialConstants,
    distance_samples,
    inertial_of_material,
    inertial_of_shell,
    inertial_of_solid,
    material_points,
    with_mass,
)
from tasks.bodies.solver_model import (
    grid_of,
    nodes_at_bottoms,
    nodes_at_cuts,
    nodes_at_faces,
    nodes_within,
    solver_model,
)

SIDE = 0.1
CUBE = Box(np.full(3, SIDE))
PLANES = (np.linspace(-0.05, 0.05, 5),) * 3
FRICTION = ContactFriction(0.5, 0.4, 0.002)


def foam(position: np.ndarray) -> MaterialConstants:
    """One material everywhere."""
    one = np.ones(len(position))
    return MaterialConstants(50.0 * one, 2e4 * one, 0.3 * one)


def test_a_solid_and_the_points_that_fill_it_weigh_the_same() -> None:
    """A cube of side a: rho a^3, inertia m a^2 / 6; octant centres lack (a/n)^2 m / 6 of it, n points along a side."""
    solid = inertial_of_solid(CUBE.surface(SIDE), 50.0)
    points = material_points(PLANES, CUBE.distance, foam, if_empty="none")
    filled = inertial_of_material(points)
    assert solid.mass == pytest.approx(50.0 * SIDE**3)
    assert filled.mass == pytest.approx(solid.mass)
    assert np.allclose(solid.inertia, solid.mass * SIDE**2 / 6.0 * np.eye(3))
    assert np.allclose(filled.inertia, solid.inertia * (1.0 - 1.0 / 8.0**2))


def test_scaling_a_mass_keeps_how_matter_is_distributed() -> None:
    """Twice the mass is twice the inertia about the same centre; of points twice every density."""
    shell = inertial_of_shell(CUBE.surface(SIDE), 700.0)
    double = shell.scaled_to(2.0 * shell.mass)
    assert np.allclose(double.inertia, 2.0 * shell.inertia)
    assert np.array_equal(double.center_of_mass, shell.center_of_mass)
    points = material_points(PLANES, CUBE.distance, foam, if_empty="none")
    assert np.allclose(with_mass(points, 2.0 * 50.0 * SIDE**3).density, 100.0)


def test_a_clamped_face_of_a_turned_box_holds_its_own_nodes() -> None:
    """Turned by a quarter about z, local x is the world's y: its `x_min` holds the nodes at the world's low y only."""
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    held = nodes_at_faces(PLANES, ["x_min"], np.array([[-0.05] * 3, [0.05] * 3]), quarter, np.zeros(3))
    assert held[:, 0].all()
    assert not held[:, 1:].any()


def test_cuts_bottoms_and_supports_hold_the_nodes_at_them() -> None:
    """Low x is cut; a part whose box covers low y only stands on the bottom; a ball in the middle holds its inside."""
    cut = nodes_at_cuts(PLANES, np.array([[True, False], [False, False]]))
    assert cut[0].all()
    assert not cut[1:].any()
    part = OrientedBox(np.array([0.0, -0.1, 0.0]), np.eye(3), np.array([0.1, 0.03, 0.1]))
    bottom = nodes_at_bottoms(PLANES, [(-0.05, [part])])
    assert bottom[:, :2, 0].all()  # y = -0.05 and -0.025: at most 3 + 5 cm from the box's middle
    assert not bottom[:, 2:].any()
    assert not bottom[:, :, 1:].any()
    inside = nodes_within(PLANES, Capsule(0.03, 0.0).distance, 0.0)
    assert inside.sum() == 7  # the middle and its six neighbours, 2.5 cm away


def test_the_solver_gets_every_body_as_it_is() -> None:
    """A rigid and a soft body keep their arrays; node states mean the same to both, and only the soft one has cells."""
    assert (NodeState.FREE, NodeState.HELD, NodeState.CORE) == (
        solver_bodies.FREE, solver_bodies.HELD, solver_bodies.CORE,
    )  # fmt: skip
    surface = CUBE.surface(SIDE)
    points = material_points(PLANES, CUBE.distance, foam, if_empty="none")
    distance = distance_samples(CUBE.distance, surface.bounds, 0.01, margin=0.02)
    floor = RigidSimulationBody(
        name="floor", instance="floor", fixed=True, distance=distance, inertial=inertial_of_shell(surface, 1.0),
        surface=Mesh.of(surface.vertices - np.array([0, 0, 0.2]), surface.faces), friction=FRICTION,
    )  # fmt: skip
    cube = SoftSimulationBody(
        name="object", instance="object", fixed=False, surface=surface, distance=distance,
        inertial=inertial_of_material(points), friction=FRICTION, velocity=np.array([0.0, 0.0, -1.0]), points=points,
        grid=grid_of(PLANES), loaded=False,
    )  # fmt: skip
    model = solver_model(Particles((cube, floor), (), 0.025, ()), (0.0, 0.0, -9.81), [("object", "floor")])
    assert model.bonds == (("object", "floor"),)
    soft, rigid = model.bodies
    assert [body.name for body in model.bodies] == ["object", "floor"]
    assert np.array_equal(soft.velocity, cube.velocity)
    assert (rigid.static_friction, rigid.dynamic_friction, rigid.rolling_resistance) == (0.5, 0.4, 0.002)
    assert isinstance(rigid, solver_bodies.RigidBody)
    assert isinstance(soft, solver_bodies.SoftBody)
    assert soft.interior.position is points.position
    assert not soft.interior.loaded
