"""The exported object: its frame is the pose of the placement, its inertia that of its matter at rest."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from dented_bed import RADIUS, anchor, settled
from dented_export import BALL, particles
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import BackgroundGrid, InertialProperties, MaterialPoints, SoftSimulationBody
from dcap.scene.types.settled import SettledBody
from tasks.bodies.discretization import inertial_of_points
from tasks.export.settled_export import BodyFrame, settled_inertial, settled_pose

WORLD = BodyFrame(np.eye(3), np.zeros(3))
TURN = Rotation.from_euler("xyz", [0.3, -0.8, 1.1])
SHIFT = np.array([0.4, -0.2, 0.7])


def soft_block() -> tuple[SoftSimulationBody, Mesh]:
    """A block 20 x 10 x 6 cm of 1 cm^3 points, and its surface."""
    sides = np.array([0.2, 0.1, 0.06])
    cells = np.stack(np.meshgrid(*[np.arange(0.005, side, 0.01) for side in sides], indexing="ij"), -1).reshape(-1, 3)
    count = len(cells)
    points = MaterialPoints(
        cells - sides / 2, np.full(count, 1e-6), np.full(count, 50.0), np.full(count, 1e4), np.full(count, 0.3)
    )
    box = trimesh.creation.box(sides).subdivide_to_size(0.01)
    surface, planes = Mesh.of(box.vertices, box.faces), np.array([-0.2, 0.2])
    own = inertial_of_points(points.position, points.volume * points.density)
    ball = particles().bodies[0]
    body = SoftSimulationBody(
        name="object", instance="object", fixed=False, surface=surface, distance=ball.distance,
        inertial=InertialProperties(1.2 * own.mass, own.center_of_mass, 1.2 * own.inertia), friction=BALL,
        points=points, grid=BackgroundGrid(planes, planes, planes, np.zeros((2, 2, 2), dtype=np.int8)), loaded=False,
    )  # fmt: skip
    return body, surface


def at_rest(surface: Mesh, bend: NDArray[np.float64]) -> SettledBody:
    """A surface that was turned, moved, and bent besides."""
    now = surface.vertices @ TURN.as_matrix().T + SHIFT + bend
    return SettledBody(
        "object", Mesh(now, surface.faces, surface.colors), SHIFT, TURN.as_quat(scalar_first=True),
        now - surface.vertices,
    )  # fmt: skip


def test_the_frame_is_the_objects_own() -> None:
    """The vertices of the object's file come back in the frame, the scale of its pose aside."""
    scaled = replace(anchor(), world_from_object=anchor().world_from_object @ np.diag([2.0, 2.0, 2.0, 1.0]))
    frame = settled_pose(scaled, settled().bodies[0])
    np.testing.assert_allclose(frame.rotation @ frame.rotation.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        frame.position, [0.0, 0.0, settled().bodies[0].surface.bounds.mean(axis=0)[2]], atol=1e-6
    )
    local = frame.inside(settled().bodies[0].surface).vertices
    np.testing.assert_allclose(local, trimesh.creation.icosphere(3, RADIUS).vertices, atol=1e-9)


def test_a_soft_body_that_only_moved_has_the_inertia_of_a_rigid_one() -> None:
    body, surface = soft_block()
    found = settled_inertial(at_rest(surface, np.zeros_like(surface.vertices)), body, WORLD)
    turn = TURN.as_matrix()
    assert found.mass == pytest.approx(body.inertial.mass)
    np.testing.assert_allclose(found.center_of_mass, turn @ body.inertial.center_of_mass + SHIFT, atol=1e-12)
    np.testing.assert_allclose(found.inertia, turn @ body.inertial.inertia @ turn.T, atol=1e-12)


def test_a_soft_body_that_sagged_has_its_matter_where_it_is() -> None:
    """Pressed evenly to 80 % of its height its centre sinks as its middle does, and its inertia is that of the flatter
    block, moving points as the nearest surface leaves a tenth of the sinking and half of the change of inertia open."""
    body, surface = soft_block()
    turn = TURN.as_matrix()

    def bend(points: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.outer(-0.2 * (points[:, 2] + 0.03), turn[:, 2]))

    found = settled_inertial(at_rest(surface, bend(surface.vertices)), body, WORLD)
    points = body.points.position
    mass = body.points.volume * body.points.density
    exact = inertial_of_points(points @ turn.T + SHIFT + bend(points), mass).scaled_to(body.inertial.mass)
    change = np.linalg.norm(exact.inertia - turn @ body.inertial.inertia @ turn.T)
    assert np.linalg.norm(found.center_of_mass - exact.center_of_mass) < 0.1 * 0.2 * 0.03
    assert np.linalg.norm(found.inertia - exact.inertia) < 0.5 * change
