"""Every pose that was asked is compared with the rest state, and said where it is not met or in doubt."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.scene.types.choices import AskedPose, OrientationRequest
from dcap.scene.types.settled import PoseCheck
from tasks.drop.settled import pose_checks, pose_name, pose_warnings

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
    assert "requested upright, found on back: 90 degrees off" in line


def test_what_has_no_seat_is_not_found_seated():
    """A bear on its four feet is upright; the row says what is in doubt, and so does a line."""
    seated = AskedPose("seated", UP, 0.0, UP, FRONT)
    (row,) = checked(seated, before=turn("z", 0), dropped=turn("z", 0))
    assert (row.found, pose_warnings((row,))) == ("seated", ())
    (row,) = checked(replace(seated, doubt="it stands"), before=turn("z", 0), dropped=turn("z", 0))
    assert row.found == "upright"
    assert "requested seated: it stands" in pose_warnings((row,))[0]


def test_a_pose_that_the_shape_does_not_tell_is_compared_with_the_one_before_the_drop():
    """A cube has no end: what was up stays so."""
    on_end = AskedPose("standing", LEFT, None, UP, FRONT, either_way=True)
    (row,) = checked(on_end, before=turn("y", -90), dropped=turn("x", 10))
    assert (row.found, row.met) == ("standing", True)
    assert row.angle_rad == pytest.approx(np.radians(10))
    assert not checked(on_end, before=turn("y", -90), dropped=turn("x", 60))[0].met


@pytest.mark.parametrize(("before", "dropped", "degrees"), [(180, 0, 180), (0, 0, 0), (170, -160, 10), (0, -100, 100)])
def test_a_facing_is_the_front_against_what_it_shall_face(before, dropped, degrees):
    """Its front looks along -y of the mesh and shall look along -y of the world: what was set down facing away is not
    met although the drop changed nothing, and says so in a line."""
    asked = AskedPose("any", UP, 0.0, UP, FRONT, looks=FRONT, ahead=FRONT)
    (row,) = checked(asked, before=turn("z", before), dropped=turn("z", dropped), facing="door_0")
    assert (row.asked, row.met) == ("facing door_0", degrees < 45)
    assert row.angle_rad == pytest.approx(np.radians(degrees), abs=1e-6)
    assert any(f"facing door 0, found {degrees} degrees off" in line for line in pose_warnings((row,))) != row.met


def test_a_front_that_nobody_can_tell_is_a_doubt():
    """And a line; so is a facing towards what is not known."""
    for told in ("it is unknown", ""):
        ahead = FRONT if told else None
        asked = AskedPose("any", UP, 0.0, UP, FRONT, facing_doubt=told, looks=ahead, ahead=ahead)
        (row,) = checked(asked, before=turn("z", 0), dropped=turn("z", 0), facing="bed_0")
        assert row.met
        assert "is unknown" in pose_warnings((row,))[0]


@pytest.mark.parametrize(("axis", "degrees", "met"), [("y", 0, False), ("y", 90, True), ("y", -90, True)])
def test_what_lies_does_not_stand(axis, degrees, met):
    """A book whose long axis is x lies as it is in its file, whatever it was before the drop, and stands on both its
    ends."""
    asked = AskedPose("standing", LEFT, 0.0, UP, FRONT, either_way=True)
    (row,) = checked(asked, before=turn(axis, degrees), dropped=turn("z", 20))
    assert (row.found, row.met) == ("standing" if met else "lying", met)
    assert len(pose_warnings((row,))) == (0 if met else 1)
