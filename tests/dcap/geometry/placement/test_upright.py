"""Which side a shape stands on, where its file does not say."""

import numpy as np
import pytest
import trimesh
from box_rooms import block, toy
from scipy.spatial.transform import Rotation
from scipy.spatial.transform import Rotation as Turn

from dcap.geometry.placement.poses import center_of_mass, front_of, rotated
from dcap.geometry.placement.resting_poses import end_axis, own_box, sits
from dcap.geometry.placement.upright import opening, round_axis, standing_features, stands_as_read, upright_pose
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.dataset import build_object

DOWN = np.array([0.0, 0.0, -1.0])


def mesh_of(name: str) -> Mesh:
    return Mesh.concatenate([solid for part in build_object(name).parts for solid in part.solids])


def box(x: float, y: float, z: float) -> Mesh:
    shape = trimesh.creation.box((x, y, z))
    return Mesh.of(shape.vertices, shape.faces)


def test_stand_of_a_box():
    """A box of 0.2 x 0.1 x 0.4: all of its plan touches, its middle is half way up and 0.05 of 0.4 inside."""
    mesh = box(0.2, 0.1, 0.4)
    one = standing_features(mesh.vertices, center_of_mass(mesh), DOWN)
    assert (one.contact, one.height, one.margin) == pytest.approx((1.0, 0.5, 0.05 / 0.4))
    assert one.stands


def test_a_thing_on_its_edge_does_not_stand():
    """A box turned by 20 degrees touches the ground with an edge."""
    assert not stands_as_read(rotated(box(0.2, 0.1, 0.4), Turn.from_euler("x", 20, degrees=True).as_matrix()))


def test_opening_has_a_sign():
    """A bowl opens upwards, turned over downwards by as much; a box does not open."""
    bowl = mesh_of("bowl")
    above, below = (opening(bowl, Raycaster(bowl), side) for side in (DOWN, -DOWN))
    assert above == pytest.approx(-below, abs=1e-3)  # single precision of the ray caster, 24 x 24 rays both times
    assert above > 0.7
    cube = box(0.1, 0.1, 0.1)
    assert opening(cube, Raycaster(cube), DOWN) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("name", "axis"), [("bottle", (0, 0, 1)), ("dumbbell", (1, 0, 0)), ("book", None)])
def test_axis_of_round_things(name, axis):
    """A bottle is round about z, a dumbbell about x, a book about nothing (5 degrees)."""
    found = round_axis(mesh_of(name))
    assert (found is None) if axis is None else abs(float(found @ axis)) > np.cos(np.radians(5))


@pytest.mark.parametrize("name", ["mug", "bowl", "bottle", "candle", "shoe", "laptop"])
@pytest.mark.parametrize("vector", [(90.0, 0.0, 0.0), (0.0, 180.0, 0.0), (40.0, -25.0, 70.0)])
def test_household_things_are_put_upright(name, vector):
    """However its file lies, the shape tells which way is up (5 degrees)."""
    file_from_own = Turn.from_rotvec(vector, degrees=True).as_matrix()
    matrix, gain, lead = upright_pose(rotated(mesh_of(name), file_from_own))
    assert float((matrix @ file_from_own)[2, 2]) > np.cos(np.radians(5))
    assert gain > 0.3
    assert lead > 0.1


def test_upright_files_are_left_alone():
    """What stands as it should gains nothing from any other side."""
    for name in ("mug", "bowl", "shoe", "plate"):
        assert upright_pose(mesh_of(name))[1] < 0.05, name


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


def test_a_hollow_seat_is_a_seat():
    """A seam or a recess of a tenth of the height under the middle is passed by."""
    recessed = Mesh.concatenate(
        [block((-0.1, -0.1, 0.03), (0.1, 0.1, 0.12)), block((-0.1, -0.1, 0.0), (-0.06, 0.1, 0.05)),
         block((0.06, -0.1, 0.0), (0.1, 0.1, 0.05)), block((-0.05, -0.05, 0.12), (0.05, 0.05, 0.3))]
    )  # fmt: skip
    assert sits(recessed, UP)


TILTED = Rotation.from_euler("xyz", (20, 35, 50), degrees=True).as_matrix()


def slab(x: float, y: float, z: float) -> Mesh:
    """A block of that size, tilted as no file's axes are."""
    pose = np.eye(4)
    pose[:3, :3] = TILTED
    return block((0, 0, 0), (x, y, z)).transformed(pose)


@pytest.mark.parametrize("size", [(0.2, 0.14, 0.03), (0.03, 0.2, 0.14), (0.2, 0.02, 0.02), (0.2, 0.1, 0.0)])
def test_the_box_is_the_blocks_own(size):
    """However it lies in its file."""
    axes, found = own_box(slab(*size))
    assert found == pytest.approx(sorted(size, reverse=True), abs=1e-9)
    assert abs(axes[0] @ TILTED[:, int(np.argmax(size))]) == pytest.approx(1.0)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)


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


def test_a_cube_has_no_end():
    """Nor has what is nearly one."""
    assert end_axis(slab(0.1, 0.09, 0.08), on_edge=False) is None
