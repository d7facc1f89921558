"""Convex polygons: hull, clipping, containment, distance, smallest rectangle."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.placement.polygons import (
    clipped_half_plane,
    convex_hull,
    counter_clockwise,
    smallest_rectangle,
)
from dcap.geometry.placement.poses import about_z
from dcap.scene.types.boxes import min_area_box


def area(ring: np.ndarray) -> float:
    return float(shapely.Polygon(ring).area) if len(ring) > 2 else 0.0


@settings(max_examples=30, deadline=None)
@given(st.floats(0, 3.1), st.floats(0.2, 0.9))
def test_smallest_rectangle_finds_the_turned_box(yaw, short):
    """Extents 1 x short and the long axis along the box, whatever the angle."""
    corners = np.array([[-0.5, -short / 2], [0.5, -short / 2], [0.5, short / 2], [-0.5, short / 2]])
    axis, extents = smallest_rectangle(corners @ about_z(yaw)[:2, :2].T)
    assert np.allclose(extents, (1.0, short), atol=1e-6)
    assert abs(axis @ (np.cos(yaw), np.sin(yaw))) == pytest.approx(1.0, abs=1e-6)


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


def test_rectangles_of_round_things_do_not_turn_with_the_last_digits():
    """Of 64 equally small rectangles about a circle it is always the same one."""
    rng, turn = np.random.default_rng(0), 2.0 * np.pi * np.arange(64) / 64
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    shaken = [circle + 1e-12 * rng.standard_normal(circle.shape) for _ in range(8)]
    assert np.ptp([smallest_rectangle(points)[0] for points in shaken], axis=0).max() < 1e-9
    assert np.allclose([min_area_box(np.c_[points, np.zeros(64)]).axes for points in shaken], np.eye(3))
