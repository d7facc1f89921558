"""How fine the cells of a soft body must be where contacts are predicted, along each axis for itself.

A fifth of half the patch's width: across a line of contact fine, along it as coarse as it is long, and finer again
where a long contact ends, since pressure falls to nothing there over about as much as it is wide.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model.grid import sized_planes
from tasks.bodies.plan_contact import BESIDE, PlanContact
from tasks.bodies.soft_cells import COARSENING, Cells, Planes

Array = NDArray[np.float64]

CELLS_ACROSS = 5.0  # cells in half the width of a predicted contact
CELLS_AT_ENDS = 2.0  # and in the shorter half width where a long contact ends: pressure falls over about as much
CELLS_AT_EDGES = 11.0  # and where it ends at an edge: a flat cylinder on a thin layer is 1.5 to 3 % short so
MOST_FACTOR = 1e3  # on the wanted sizes: what is still over its budget then is so without any contact
GROWTH = 1.6  # ratio of neighbouring cells away from a contact


@dataclass(frozen=True, eq=False, slots=True)
class WantedCells:
    """Largest cells along an axis in some intervals."""

    begin: Array
    """[m], shape (k,)."""
    end: Array
    """[m], shape (k,)."""
    size: Array
    """[m], shape (k,)."""

    @classmethod
    def joined(cls, several: Sequence["WantedCells"]) -> "WantedCells":
        """All of them."""
        nothing = np.zeros(0)
        return cls(
            np.concatenate([nothing, *(one.begin for one in several)]),
            np.concatenate([nothing, *(one.end for one in several)]),
            np.concatenate([nothing, *(one.size for one in several)]),
        )

    def resized(self, *, size: float | None = None, scale: float = 1.0, away: float = 0.0) -> "WantedCells":
        """The same with a given size [m], that many times larger, and grown over a way `away` [m] to the body."""
        asked = np.full(len(self.size), size) if size is not None else self.size
        return WantedCells(self.begin, self.end, scale * asked + np.log(GROWTH) * away)


def wanted_in_plan(contact: PlanContact, axis: int) -> WantedCells:
    """The cells that a contact asks for along x (0) or y (1)."""
    place, half = contact.across(axis)
    step = 0.5 * contact.patch.spacing[axis]
    apart = np.diff(place) > 3.0 * step
    ends = np.concatenate([place[:1], place[:-1][apart], place[1:][apart], place[-1:]])
    beside = BESIDE * contact.half_width
    begin = np.concatenate([[place[0] - BESIDE * half[0]], place[1:] - step, ends - beside])
    end = np.concatenate([place[:-1] + step, [place[-1] + BESIDE * half[-1]], ends + beside])
    return WantedCells(
        begin, end, np.append(half / CELLS_ACROSS, np.full(len(ends), contact.half_width / CELLS_AT_ENDS))
    )


def wanted_at_edges(contact: PlanContact, axis: int) -> WantedCells:
    """Return the cells that an accurate depth needs along x (0) or y (1) where the contact ends at an edge: a cell that
    lies half under an edge gives way too little."""
    place, size = contact.edges(axis), contact.half_width / CELLS_AT_EDGES
    return WantedCells(place - size, place + size, np.full(len(place), size))


def wanted_in_height(contact: PlanContact, low: float, high: float) -> WantedCells:
    """The cells that it asks for along z, where it lies between two heights [m] on the body."""
    half = contact.half_width
    return WantedCells(np.array([low - half]), np.array([high + half]), np.array([half / CELLS_ACROSS]))


def cells_within(
    box: Array, wanted: Callable[[float], Sequence[WantedCells]], count: Callable[[Planes], int], budget: int | None
) -> tuple[Cells, float]:
    """Cells over a box (2, 3) [m] as they are wanted along x, y and z, or larger by the least factor with which their
    `count` meets a budget, if there is one; and that factor. `wanted` is asked with the factor."""
    scale = 1.0
    while True:
        x, y, z = (
            sized_planes(float(box[0, a]), float(box[1, a]), w.begin, w.end, w.size, GROWTH)
            for a, w in enumerate(wanted(scale))
        )
        total = count((x, y, z))
        if budget is None or total <= budget or scale > MOST_FACTOR:
            return Cells((x, y, z), min(float(np.diff(p).min()) for p in (x, y, z)), total), scale
        scale *= COARSENING
