"""Cells through what is thin in a soft support."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import sampler
from dcap.geometry.primitives import Box
from solver.model.grid import graded_planes
from tasks.bodies.discretization import distance_samples
from tasks.bodies.soft_cells import THROUGH, Cells, UnderResolved, occupied, thin_profile, through_thin_parts

SEAT, BACK = Box(np.array([0.6, 0.5, 0.3])), Box(np.array([0.6, 0.05, 0.4]))
LEAST = 1.5e-3


def seat_with_back(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """A seat of 0.3 m with a back of 5 cm rising from its far end."""
    return np.minimum(SEAT.distance(points), BACK.distance(points - np.array([0.0, 0.225, 0.3])))


GRID = distance_samples(
    seat_with_back, np.array([[-0.3, -0.25, -0.15], [0.3, 0.25, 0.5]]), 0.005, margin=0.01
)  # fmt: skip
INSIDE = sampler(GRID)
ALL = np.array([[-1.0] * 3, [1.0] * 3])


def contact_cells() -> Cells:
    """Fine under a contact on the seat, coarse at the back."""
    box = np.array([[-0.3, -0.25, -0.15], [0.3, 0.25, 0.5]])
    fine = np.array([[-0.05, -0.15, 0.1], [0.05, -0.05, 0.15]])
    x, y, z = (graded_planes(*map(float, (*box[:, a], *fine[:, a], 0.02))) for a in range(3))
    return Cells((x, y, z), 0.02, occupied((x, y, z), INSIDE))


def with_budget(budget: int) -> tuple[Cells, list[UnderResolved]]:
    """Those cells with what is thin seen to."""
    return through_thin_parts(contact_cells(), GRID, ALL, budget, LEAST)


def test_a_profile_tells_how_thick_a_solid_is_where() -> None:
    """Along y the back is 5 cm, cut nowhere, and the seat below it 50 cm: a low quantile says 5 cm at the back."""
    profile = thin_profile(GRID, 1, ALL)
    at_back = np.abs(profile.place - 0.225) < 0.02
    assert np.abs(profile.thickness[at_back] - 0.05).max() <= GRID.spacing
    assert profile.thickness[np.abs(profile.place) < 0.15].min() > 0.45
    assert np.isinf(profile.thickness[profile.place > 0.252]).all()


def test_what_is_thin_has_two_cells_through_it() -> None:
    """The contact alone leaves less than one cell through the back; afterwards it has two, and the contact's planes are
    all still there."""
    before = contact_cells().planes[1]
    assert np.diff(before)[-1] > 0.05 / THROUGH
    found, thin = with_budget(100_000)
    assert not thin
    assert np.diff(found.planes[1])[found.planes[1][1:] > 0.2 + GRID.spacing].max() <= 0.05 / THROUGH + GRID.spacing
    for axis in range(3):
        assert np.isin(np.round(contact_cells().planes[axis], 9), np.round(found.planes[axis], 9)).all()


def test_what_a_budget_leaves_too_thin_is_named_with_its_places() -> None:
    """Without any cells to spare the grid stays as it was, and every place that is told lies in the back."""
    found, thin = with_budget(1)
    assert found.count == contact_cells().count
    assert thin
    for one in thin:
        assert one.cells < THROUGH
        assert abs(one.thickness - 0.05) <= GRID.spacing
        assert abs(one.place[1] - 0.225) < 0.025
        assert one.place[2] > 0.15


def test_what_is_thin_out_of_reach_costs_no_cells() -> None:
    """Of a back beyond the box that is asked for nothing is split and nothing told."""
    seat = np.array([[-0.3, -0.25, -0.15], [0.3, 0.15, 0.5]])
    found, thin = through_thin_parts(contact_cells(), GRID, seat, 100_000, LEAST)
    assert not thin
    assert found.count == contact_cells().count
