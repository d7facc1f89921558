"""Every pose that was asked is compared with the rest state, and said where it is not met or in doubt."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.scene.types.intent import OrientationRequest
from dcap.scene.types.rotation import AskedPose
from dcap.scene.types.settled import PoseCheck
from tasks.drop.poses import pose_checks, pose_name, pose_warnings

UP, FRONT, LEFT = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
BOUNDS = (np.pi / 4.0, np.pi / 4.0)
UPRIGHT = AskedPose("upright", UP, 0.0, UP, FRONT)


def turn(axis: str, degrees: float) -> Rotation:
    """A turn about an axis of the world."""
    return Rotation.from_euler(axis, degrees, degrees=True)


def checked(asked: AskedPose, *, before: Rotation, dropped: Rotation, facing: str = "") -> tuple[PoseCheck, ...]:
    """The rows of an object of half its file's size that starts like that and is turned by the drop."""
    pose = np.eye(4)
    pose[:3, :3] = 0.5 * before.as_matrix()
    turned = dropped.as_quat(canonical=True, scalar_first=True)
    return pose_checks(asked, OrientationRequest(asked.name, facing, ""), pose, turned, 0.1, BOUNDS)


@pytest.mark.parametrize(
    ("axis", "degrees", "found"),
    [("x", 0, "upright"), ("x", 30, "upright"), ("x", 180, "upside_down"), ("x", 90, "on_front"), ("x", -90, "on_back"),
     ("y", 90, "on_left_side"), ("y", -90, "on_right_side"), ("z", 90, "upright")],
)  # fmt: skip
def test_a_rest_state_has_the_name_that_one_would_give_it(axis, degrees, found):
    """Up is +z, the front -y and so its own left +x: tipped about x by 90 degrees it looks down, about y its left is
    down."""
    way = turn(axis, degrees).as_matrix()
    assert pose_name(way @ UP, way @ FRONT) == found
    (row,) = checked(UPRIGHT, before=turn("z", 0), dropped=turn(axis, degrees))
    assert (row.asked, row.found) == ("upright", found)
    assert row.angle_rad == pytest.approx(0.0 if axis == "z" else np.radians(abs(degrees)))
    assert row.met == (found == "upright")


def test_a_thing_laid_on_its_back_is_not_seated():
    """Also where the drop changed nothing: it is the rest state that counts, not the way to it. A line says so."""
    rows = checked(UPRIGHT, before=turn("x", -90), dropped=turn("z", 20))
    assert [(row.found, row.met) for row in rows] == [("on_back", False)]
    (line,) = pose_warnings(rows)
    assert "asked upright, found on back: 90 degrees off" in line


def test_a_pose_about_the_way_it_was_put_down_is_compared_with_that():
    """On end is no matter of its own up: the axis that was vertical stays so."""
    on_end = AskedPose("standing", LEFT, None, UP, FRONT)
    (row,) = checked(on_end, before=turn("y", -90), dropped=turn("x", 10))
    assert (row.found, row.met) == ("standing", True)
    assert row.angle_rad == pytest.approx(np.radians(10))
    assert not checked(on_end, before=turn("y", -90), dropped=turn("x", 60))[0].met


def test_a_facing_has_a_row_of_its_own():
    """Its angle is the turn about the vertical; a front that nobody can tell is a doubt, and a line."""
    asked = AskedPose("any", UP, None, UP, FRONT, facing_doubt="nothing tells")
    (row,) = checked(asked, before=turn("z", 0), dropped=turn("z", 0), facing="bed_0")
    assert (row.asked, row.met, row.angle_rad, row.doubt) == ("facing bed_0", True, 0.1, "nothing tells")
    assert "nothing tells" in pose_warnings((row,))[0]


def test_nothing_asked_nothing_checked():
    """And a pose that is met beyond doubt is no warning."""
    assert pose_checks(None, OrientationRequest("any", "", ""), np.eye(4), np.array([1.0, 0, 0, 0]), 0.0, BOUNDS) == ()
    assert pose_warnings(checked(UPRIGHT, before=turn("z", 0), dropped=turn("z", 0))) == ()
