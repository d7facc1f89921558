"""Surfaces that contact is evaluated on, refined within a budget."""

import numpy as np

from dcap.geometry.primitives import Box
from dcap.geometry.solid.repair import longest_near
from tasks.bodies.footprint import PER_CELL, Footprint, rigid_object_surface, soft_support_surface

CELL = 0.0045
CROP = np.array([[-0.6, -0.6, -0.5], [0.6, 0.6, 0.5]])
SUPPORT = Box(np.array([2.0, 2.0, 0.4])).surface(2.0)
TOP = 0.2


def sloping(length: float) -> Footprint:
    """A board that comes down with a short end first and may touch along all of its length later [m]."""
    end = np.array([[0.0, -0.05, TOP + 0.01], [0.02, 0.05, TOP + 0.011]])
    wider = np.array([[0.0, -0.05, TOP + 0.01], [length, 0.05, TOP + 0.02]])
    return Footprint(
        end[0], end[1], wider, on_base=np.stack([under(end), under(wider)]), half_width=0.01, depth=2e-3, contacts=()
    )


def under(box: np.ndarray) -> np.ndarray:
    """What of the support is below a box."""
    return box * [1.0, 1.0, 0.0] + [0.0, 0.0, TOP]


def at_top(foot: Footprint, end: float) -> np.ndarray:
    """The support's top under the first part of a footprint, up to x = `end` [m]."""
    return np.array([[foot.low[0], foot.low[1], TOP - 1e-3], [end, foot.high[1], TOP + 1e-3]])


def test_edges_of_a_support_are_a_third_of_a_cell_where_the_budget_allows() -> None:
    """All that may touch is that fine, sides and underside of the support are not."""
    foot = sloping(0.2)
    fine, longest = soft_support_surface(SUPPORT, foot, CROP, SUPPORT.bounds, CELL, 400_000)
    assert longest <= CELL / PER_CELL * (1 + 1e-9)
    assert longest_near(fine, at_top(foot, 0.2)) <= CELL / PER_CELL * (1 + 1e-9)
    below = np.array([[0.0, -0.05, -TOP - 1e-3], [0.2, 0.05, -TOP + 1e-3]])
    assert longest_near(fine, below) > CELL


def test_a_budget_is_spent_on_what_touches_first() -> None:
    """The longest edge that is left is told; it lies where the board touches later, not under its first end."""
    foot, budget = sloping(0.5), 30_000
    fine, longest = soft_support_surface(SUPPORT, foot, CROP, SUPPORT.bounds, CELL, budget)
    assert len(fine.faces) <= len(SUPPORT.faces) + 2 * budget  # one for the crop, one for what may touch
    assert longest > CELL / PER_CELL
    assert longest_near(fine, at_top(foot, 0.02)) <= CELL / PER_CELL * (1 + 1e-9)


def test_a_rigid_object_of_any_size_keeps_within_its_budget() -> None:
    """A cube of 4 m that may touch with a whole side, asked for in 2 mm: millions of faces, of which it gets the few
    that it may have."""
    cube = Box(np.full(3, 4.0)).surface(4.0)
    under = np.array([[-2.0, -2.0, -2.0], [2.0, 2.0, -1.99]])
    foot = Footprint(
        under[0], under[1], under, on_base=np.stack([under, under]), half_width=0.01, depth=2e-3, contacts=()
    )
    fine = rigid_object_surface(cube, foot, 0.002, 20_000)
    assert len(cube.faces) < len(fine.faces) <= len(cube.faces) + 20_000
