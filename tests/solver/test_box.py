"""Boxes of points."""

import numpy as np
import pytest

from solver.box import bounds, inside

POINTS = np.array([[0.0, 1.0, 2.0], [-1.0, 3.0, 0.5], [2.0, -1.0, 1.0]])


def test_bounds_are_those_of_numpy():
    """The corners are the least and the largest coordinate of each axis, to the bit."""
    low, high = bounds(POINTS)
    assert low == pytest.approx(POINTS.min(axis=0), abs=0)
    assert high == pytest.approx(POINTS.max(axis=0), abs=0)


def test_points_on_the_faces_are_inside():
    """The box is closed: a point on a face is inside, one beyond is not, and an empty answer is an empty list."""
    assert inside(POINTS, *bounds(POINTS)).tolist() == [0, 1, 2]
    assert inside(POINTS, np.array([-1.0, 1.0, 0.5]), np.array([0.0, 3.0, 2.0])).tolist() == [0, 1]
    assert inside(POINTS, np.zeros(3), np.full(3, 0.1)).tolist() == []
