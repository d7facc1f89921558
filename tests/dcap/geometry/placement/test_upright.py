"""Which side a shape stands on, where its file does not say."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation as Turn

from dcap.geometry.placement.poses import center_of_mass, front_of, rotated
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
