"""Convex polygons: hull, clipping, containment, distance, smallest rectangle."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.placement.polygons import (
    clipped,
    clipped_half_plane,
    convex_hull,
    counter_clockwise,
    gap_between,
    grown,
    inside,
    smallest_rectangle,
)
from dcap.geometry.placement.poses import about_z

SQUARE = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def area(ring: np.ndarray) -> float:
    return float(shapely.Polygon(ring).area) if len(ring) > 2 else 0.0


def test_clipping_gives_the_common_area():
    """Two unit squares half a side apart share a half."""
    assert area(clipped(SQUARE, SQUARE + np.array([0.5, 0.0]))) == pytest.approx(0.5)


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 3.1), st.floats(0.2, 0.9))
def test_smallest_rectangle_finds_the_turned_box(yaw, short):
    """Extents 1 x short and the long axis along the box, whatever the angle."""
    corners = np.array([[-0.5, -short / 2], [0.5, -short / 2], [0.5, short / 2], [-0.5, short / 2]])
    axis, extents = smallest_rectangle(corners @ about_z(yaw)[:2, :2].T)
    assert np.allclose(extents, (1.0, short), atol=1e-6)
    assert abs(axis @ (np.cos(yaw), np.sin(yaw))) == pytest.approx(1.0, abs=1e-6)


def test_convex_hull_drops_what_lies_inside():
    """A square with a point in it keeps four corners."""
    points = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [0.4, 0.5]])
    assert len(convex_hull(points)) == 4


def test_polygons_that_only_touch_have_no_common_area():
    """A common side or corner is no area, and nothing is left of nothing."""
    for shift in ((1.0, 0.0), (1.0, 1.0), (3.0, 0.0)):
        assert len(clipped(SQUARE, SQUARE + shift)) == 0
    assert len(clipped(np.zeros((0, 2)), SQUARE)) == 0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_line_parts_a_polygon(seed):
    """What lies behind a line and what lies before it make up the whole, counter-clockwise each."""
    rng = np.random.default_rng(seed)
    ring, point, outward = convex_hull(rng.normal(size=(12, 2))), rng.normal(size=2), rng.normal(size=2)
    parts = [clipped_half_plane(ring, point, way) for way in (outward, -outward)]
    assert sum(area(part) for part in parts) == pytest.approx(area(ring))
    for part, way in zip(parts, (outward, -outward), strict=True):
        assert len(part) == 0 or np.array_equal(counter_clockwise(part), part)
        assert ((part - point) @ way <= 1e-9).all()


def test_a_grown_point_is_a_disc_and_holds_its_margin():
    """Sixteen corners at the radius; points are inside up to the margin, and no farther."""
    ring = grown(np.zeros((1, 2)), 0.5)
    assert len(ring) == 16
    assert np.allclose(np.linalg.norm(ring, axis=1), 0.5)
    points = np.array([[0.5 + 0.9e-6, 0.0], [0.5 + 1e-5, 0.0], [0.0, 0.0]])
    assert inside(ring, points, margin=1e-6).tolist() == [True, False, True]


def test_the_gap_is_that_between_the_rims():
    """A metre beside each other, and from corner to corner."""
    assert gap_between(SQUARE, SQUARE + np.array([2.0, 0.5])) == pytest.approx(1.0)
    assert gap_between(SQUARE, SQUARE + np.array([2.0, 2.0])) == pytest.approx(np.sqrt(2.0))
