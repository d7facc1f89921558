"""Areas of a surface named by words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.placement.named_regions import (
    SIDES,
    distance_beside,
    regions,
    viewer_frame,
)
from dcap.geometry.placement.polygons import counter_clockwise, inside
from dcap.geometry.placement.poses import about_z
from dcap.scene.types.boxes import OrientedBox


def box(x: float, y: float, wide: float, deep: float, yaw: float = 0.0) -> OrientedBox:
    return OrientedBox(np.array([x, y, 0.5]), about_z(yaw), np.array([wide / 2, deep / 2, 0.1]))


FRONT = np.array([0.0, -1.0, 0.0])
"""The viewer stands at -y and looks along +y, so that his right is +x."""
MIDDLE = np.zeros(3)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.sampled_from([*SIDES, "center", "edge", "corner", "middle", "any"]), max_size=3, unique=True),
    st.floats(0, 6.28),
    st.floats(0.02, 0.5),
)
def test_every_region_is_convex_on_the_part_and_holds_its_target(names, yaw, radius):
    """Polygons are counter-clockwise, inside the part's rectangle, and contain the point to aim at."""
    part = box(1.0, -2.0, 2.0, 1.2, yaw)
    frame = viewer_frame(part, np.append(part.axes[:2, 1], 0.0), MIDDLE)
    areas = regions(frame, names, [], np.full(2, radius))
    assert areas
    for area in areas:
        assert np.array_equal(counter_clockwise(area.polygon), area.polygon)
        assert np.abs(frame.local(area.polygon)).max() <= 1 + 1e-9
        assert inside(area.polygon, area.target[None], margin=1e-9).all()


def test_corners_on_both_sides_are_all_that_fit():
    """The left or right corners in front are two, of which none is forgotten."""
    frame = viewer_frame(box(0, 0, 2.0, 2.0), FRONT, MIDDLE)
    areas = regions(frame, ("left", "right", "front", "corner"), [], np.full(2, 0.1))
    assert sorted(np.sign(area.target).tolist() for area in areas) == [[-1, -1], [1, -1]]


@pytest.mark.parametrize(
    ("names", "place", "away"),
    [
        # the thing's side less 15 cm and the object's 10 cm; the part's side is at 0.5 m
        (("next_to",), (3.5, 0.0), 3.4 - 0.25 - 0.5),
        (("near",), (3.5, 0.0), 3.4 - 0.6 - 0.5),
        # right of the thing begins at its middle
        (("next_to", "right"), (3.5, 0.0), 3.5 - 0.5),
        # corner to corner, along the diagonal
        (("near",), (2.1, 1.6), np.hypot(1.5, 1.0) - 0.6),
    ],
)
def test_place_beside_the_part_says_how_far(names, place, away):
    """Where nothing is left, the distance from the place to the part is that of their nearest points."""
    frame, thing = viewer_frame(box(0, 0, 1.0, 1.0), FRONT, MIDDLE), box(place[0], place[1], 0.2, 0.2)
    assert regions(frame, names, [thing], np.full(2, 0.1)) == []
    # a 16-gon lies inside its circle by up to 1 - cos(pi / 16) = 2 % of at most 0.6 m
    assert distance_beside(frame, names, [thing], np.full(2, 0.1)) == pytest.approx(away, abs=0.012)


@pytest.mark.parametrize("names", [("end", "near"), ("corner", "near"), ("corner", "back", "next_to")])
@pytest.mark.parametrize("at", [(3.0, 0.4), (-3.0, 0.4)])
def test_end_and_corner_at_a_thing_are_those_that_come_nearest(names, at):
    areas = regions(
        viewer_frame(box(0, 0, 2.0, 1.0), FRONT, MIDDLE), names, [box(at[0], at[1], 0.3, 0.3)], np.full(2, 0.1)
    )
    assert len(areas) == 1
    x, y = areas[0].target
    assert np.sign(x) == np.sign(at[0])
    assert ("corner" in names) == (abs(y) > 0.3)


def test_corner_behind_a_thing_is_no_corner_before_it():
    """Behind a chair that stands near the front corner: the corner at the back."""
    areas = regions(
        viewer_frame(box(0, 0, 2.0, 2.0), FRONT, MIDDLE), ("corner", "back", "next_to"), [box(0.6, -0.6, 0.4, 0.4)],
        np.full(2, 0.1),
    )  # fmt: skip
    assert [int(s) for s in np.sign(areas[0].target)] == [1, 1]
