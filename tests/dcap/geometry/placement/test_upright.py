"""Which side a shape stands on, where its file does not say."""

import numpy as np
import pytest
import trimesh
from box_rooms import block, toy
from scipy.spatial.transform import Rotation
from scipy.spatial.transform import Rotation as Turn

from dcap.geometry.placement.poses import front_of, rotated
from dcap.geometry.placement.resting_poses import end_axis, sits
from dcap.geometry.placement.upright import upright_pose
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.dataset import build_object


def mesh_of(name: str) -> Mesh:
    return Mesh.concatenate([solid for part in build_object(name).parts for solid in part.solids])


def box(x: float, y: float, z: float) -> Mesh:
    shape = trimesh.creation.box((x, y, z))
    return Mesh.of(shape.vertices, shape.faces)


@pytest.mark.parametrize("name", ["mug", "bowl", "bottle", "candle", "shoe", "laptop"])
@pytest.mark.parametrize("vector", [(90.0, 0.0, 0.0), (0.0, 180.0, 0.0), (40.0, -25.0, 70.0)])
def test_household_things_are_put_upright(name, vector):
    """However its file lies, the shape tells which way is up (5 degrees)."""
    file_from_own = Turn.from_rotvec(vector, degrees=True).as_matrix()
    matrix, gain, lead = upright_pose(rotated(mesh_of(name), file_from_own))
    assert float((matrix @ file_from_own)[2, 2]) > np.cos(np.radians(5))
    assert gain > 0.3
    assert lead > 0.1


def test_category_tells_the_axis_of_the_front():
    """A car's front is at an end of its long side, a screen's in the middle of it; a round thing keeps what it had."""
    assert front_of(box(0.4, 0.1, 0.1), "long")[0].tolist() == [1.0, 0.0, 0.0]
    assert front_of(box(0.1, 0.4, 0.1), "short")[0].tolist() == [1.0, 0.0, 0.0]
    assert front_of(box(0.4, 0.1, 0.1), "short")[0].tolist() == [0.0, -1.0, 0.0]
    assert not front_of(box(0.1, 0.1, 0.1), "long")[1]


UP = np.array([0.0, 0.0, 1.0])
LEGS = [block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.16)) for x in (-0.05, 0.05) for y in (-0.12, 0.12)]
ON_FOURS = Mesh.concatenate([block((-0.08, -0.16, 0.14), (0.08, 0.16, 0.28)), *LEGS])
ON_TWO = Mesh.concatenate(
    [block((-0.08, -0.05, 0.2), (0.08, 0.05, 0.4)), block((-0.06, -0.04, 0.0), (0.06, 0.04, 0.2))]
)
BEGGING = Mesh.concatenate([block((-0.1, -0.1, 0.0), (0.1, 0.1, 0.12)), block((-0.05, -0.05, 0.12), (0.05, 0.05, 0.3))])


@pytest.mark.parametrize(
    ("mesh", "seated"), [(toy(), True), (BEGGING, True), (ON_FOURS, False), (ON_TWO, False)],
)  # fmt: skip
@pytest.mark.parametrize("turn", [np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])])
def test_what_bears_on_its_body_sits(mesh, seated, turn):
    """Legs before it, or a broad seat; not on four legs with 0.14 of air under a centre at about 0.2, nor on two closed
    legs, where the centre is at 0.22 of 0.4 and over. The file's axes do not matter."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    assert sits(mesh.transformed(pose), turn @ UP) == seated


TILTED = Rotation.from_euler("xyz", (20, 35, 50), degrees=True).as_matrix()


def slab(x: float, y: float, z: float) -> Mesh:
    """A block of that size, tilted as no file's axes are."""
    pose = np.eye(4)
    pose[:3, :3] = TILTED
    return block((0, 0, 0), (x, y, z)).transformed(pose)


@pytest.mark.parametrize(
    ("size", "on_edge", "expected"),
    [((0.2, 0.14, 0.03), False, (0, 0.0)), ((0.2, 0.14, 0.03), True, (2, 0.5 * np.pi)),
     ((0.4, 0.4, 0.02), False, (2, 0.5 * np.pi)), ((0.2, 0.02, 0.02), True, (0, 0.0))],
)  # fmt: skip
def test_long_things_stand_by_their_length_and_flat_ones_by_their_thickness(size, on_edge, expected):
    """A book both ways, a tray and a stick."""
    found = end_axis(slab(*size), on_edge=on_edge)
    assert found is not None
    assert abs(found[0] @ TILTED[:, expected[0]]) == pytest.approx(1.0)
    assert found[1] == expected[1]
