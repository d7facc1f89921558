"""Node planes that follow wanted sizes."""

import numpy as np
import pytest

from solver.box import bounds, inside
from solver.errors import ModelError
from solver.model.grid import sized_planes


@pytest.mark.parametrize("growth", [1.3, 1.6, 2.2])
def test_spacings_are_as_wanted_and_grow_away_from_there(growth):
    """Two fine places with a coarse one between: no cell is larger than wanted, none grows faster than allowed."""
    at, size = np.array([0.2, 0.21, 0.8]), np.array([0.01, 0.01, 0.02])
    planes = sized_planes(0.0, 1.0, at, at + 0.05, size, growth)
    spacing, middle = np.diff(planes), 0.5 * (planes[1:] + planes[:-1])
    assert (planes[0], planes[-1]) == (0.0, 1.0)
    assert (spacing > 0.0).all()
    for place, wanted in zip(at, size, strict=True):
        inside = (middle > place + 0.5 * wanted) & (middle < place + 0.05 - 0.5 * wanted)
        assert inside.any()
        assert (spacing[inside] <= 1.001 * wanted).all()
    ratio = np.maximum(spacing[1:] / spacing[:-1], spacing[:-1] / spacing[1:])
    assert ratio.max() < 1.15 * growth
    assert spacing.max() > 4.0 * size.min()


def test_without_a_wish_there_is_one_cell():
    """As coarse as it can be."""
    assert sized_planes(-1.0, 2.0, np.zeros(0), np.zeros(0), np.zeros(0), 1.5).tolist() == [-1.0, 2.0]


def test_a_size_of_nothing_is_refused():
    """Cells need an extent."""
    with pytest.raises(ModelError, match="sizes > 0"):
        sized_planes(0.0, 1.0, np.array([0.5]), np.array([0.6]), np.array([0.0]), 1.5)


def test_a_fine_interval_is_filled_however_fine():
    """Also where it is finer than the places at which sizes are looked at."""
    planes = sized_planes(0.0, 1.0, np.array([0.4]), np.array([0.6]), np.array([1e-5]), 1.5)
    assert len(planes) > 0.2 / 1e-5


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
