"""A scene as a floor plan: outline, boxes that look somewhere, and the asset in its canonical pose."""

import numpy as np
import pytest
from box_rooms import HALL, ROOM, Things, block, segmentation, toy

from dcap.evaluation.baselines.floor_plan import canonical_asset, floor_plan_of, proposed_anchor
from dcap.geometry.placement.poses import about_z, front_of
from dcap.scene.types.floor_plan import PlanBox


def area_of(ring: np.ndarray) -> float:
    """Shoelace formula."""
    x, y = ring.T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_the_outline_is_that_of_the_floor() -> None:
    """A floor of 6 m x 6 m has four corners and 36 m2, counter-clockwise; its height is that of its top."""
    plan = floor_plan_of(ROOM)
    assert plan.outline.shape == (4, 2)
    assert area_of(plan.outline) == pytest.approx(36.0)
    np.testing.assert_allclose(plan.low, (-3.0, -3.0, 0.0), atol=1e-9)
    assert plan.kind == "bedroom"


def test_an_l_shaped_floor_keeps_its_corner_and_gaps_of_a_wall_are_bridged() -> None:
    """4 x 2 m and 2 x 2 m floors, 0.1 m apart, are one L of 12 m2 and the 0.2 m2 between them."""
    things: Things = {
        "a": ("floor", None, [("floor", block((0, 0, -0.1), (4, 2, 0)))]),
        "b": ("floor", None, [("floor", block((0, 2.1, -0.1), (2, 4.1, 0)))]),
    }
    plan = floor_plan_of(segmentation(things))
    assert len(plan.outline) == 6
    assert area_of(plan.outline) == pytest.approx(12.2, abs=1e-6)


def test_a_scene_without_a_floor_has_the_rectangle_about_it() -> None:
    """Things alone: the plan is their bounds and stands at their lowest point."""
    plan = floor_plan_of(segmentation({"t": ("table", None, [("top", block((1, 1, 0.4), (3, 2, 0.5)))])}))
    assert area_of(plan.outline) == pytest.approx(2.0)
    assert plan.floor == pytest.approx(0.4)


def test_boxes_look_where_the_front_is() -> None:
    """The bench looks along +y, so it is turned by half a turn; walls and floors have no box, parts have theirs."""
    boxes = {box.thing: box for box in floor_plan_of(HALL).things}
    np.testing.assert_allclose(boxes["bench"].front, (0.0, 1.0), atol=1e-12)
    np.testing.assert_allclose(boxes["bench"].size, (1.0, 0.4, 0.45), atol=1e-9)
    assert "floor" not in boxes
    parts = [box.label for box in floor_plan_of(ROOM).boxes if box.thing == "bed" and box.part >= 0]
    assert parts == ["bed frame", "bed mattress", "bed headboard", "bed pillow", "bed pillow"]


def test_a_turned_box_has_its_extents_along_right_and_front() -> None:
    """At a quarter turn the front is +x; the ring of a 2 x 1 m box spans 1 m in x and 2 m in y."""
    box = PlanBox("a", -1, "a", np.zeros(3), np.array([2.0, 1.0, 0.4]), np.pi / 2)
    np.testing.assert_allclose(box.front, (1.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(np.ptp(box.ring, axis=0), (1.0, 2.0), atol=1e-12)
    assert area_of(box.ring) == pytest.approx(2.0)


def test_an_asset_is_scaled_looks_along_minus_y_and_lies_about_the_origin() -> None:
    """A figure that looks along +x in its file looks along -y; the middle of its box is the origin."""
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = about_z(np.pi / 2), (5.0, 1.0, 2.0)
    asset = canonical_asset(toy().transformed(turn), 0.5, "plush toy")
    np.testing.assert_allclose(asset.mesh.bounds.mean(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(asset.size, (0.08, 0.125, 0.15), atol=1e-6)
    np.testing.assert_allclose(front_of(asset.mesh)[0], (0.0, -1.0, 0.0), atol=1e-6)
    again = toy().transformed(turn).transformed(asset.canonical_from_object)
    np.testing.assert_allclose(again.vertices, asset.mesh.vertices, atol=1e-6)


@pytest.mark.parametrize(
    ("center", "part"),
    [((0.0, 0.0, 0.53), "mattress"), ((0.0, 0.0, 0.49), "mattress"), ((-0.3, 0.7, 0.65), "pillow"),
     ((2.9, -2.9, 0.02), "floor"), ((2.0, 0.7, 0.6), "top")],
)  # fmt: skip
def test_a_pose_is_told_to_be_on_what_is_nearest_beneath(center, part: str) -> None:
    """A cube of 6 cm above, or 1 cm in, a surface is told to be on it; its pose is not changed."""
    pose = np.eye(4)
    pose[:3, 3] = center
    found = proposed_anchor(ROOM, block((-0.03, -0.03, -0.03), (0.03, 0.03, 0.03)), pose, "center", "said")
    assert found.part == part
    np.testing.assert_array_equal(found.world_from_object, pose)
    top = {"mattress": 0.5, "pillow": 0.62, "floor": 0.0, "top": 0.5}[part]
    assert found.clearance == pytest.approx(center[2] - 0.03 - top)
