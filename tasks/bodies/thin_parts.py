"""Cells through what is thin in a soft support: a cushion of one cell can neither bend nor be pressed together.

In: the sampled distance of a solid and the planes that the contact asked for. Out: planes with enough cells through
what is thin, where a budget allows them, and the places where it does not. Thickness is that of the material that a
line along an axis passes at one stretch; rims and rounded edges are shorter than what they belong to, so that a low
quantile counts, not the least.
"""

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import sampler
from dcap.scene.types.particles import DistanceGrid
from tasks.bodies.soft_cells import THIN_SHARE, Cells, Planes, occupied

THROUGH = 2.0  # cells through what bends, at least
ALLOWANCE = 1.25  # times the budget of the contact's cells, for thin parts too
EASED = (1.0, 1.25, 1.5, 2.0, 3.0)  # factors on the wanted size of cells, tried in this order to meet the allowance
MOST_PIECES = 4  # of an interval between two planes: a sliver must not spend what others need
LEAST_SHARE = (
    0.05  # of the lines through the solid that must pass a place: less is a rim or a knob, which bends nothing
)
MOST_LINES = 60  # lines across a solid along each of the two other axes
NAMED = 0.95  # share of the wanted number of cells below which a part is named

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class ThinProfile:
    """How thick a solid is along one axis, at places along it."""

    place: Array
    """Coordinates along the axis [m], shape (n,)."""
    thickness: Array
    """Typical small thickness of what is there [m], inf where nothing is, shape (n,)."""
    example: Array
    """The middle of a stretch of that thickness [m], shape (n, 3)."""


class Limit(StrEnum):
    """Reason why cells are coarser than something thin needs."""

    BUDGET = "budget"
    """With more cells in all there would be enough."""
    FINEST = "finest"
    """Cells are as fine as they may be."""
    PIECES = "pieces"
    """A cell that the contact asks for is cut into MOST_PIECES already."""


@dataclass(frozen=True, eq=False, slots=True)
class UnderResolved:
    """A place that is too thin for its cells."""

    cells: float
    """Cells through it [-]."""
    thickness: float
    """[m]."""
    place: Array
    """A point in it [m], shape (3,)."""
    limit: Limit
    """Why there are no more."""


def thin_profile(grid: DistanceGrid, axis: int, region: Array) -> ThinProfile:
    """The profile of a sampled solid along an axis, of what passes through the box `region` [m], shape (2, 3)."""
    others = [a for a in range(3) if a != axis]
    first, last = (
        np.clip(np.round((corner - grid.origin) / grid.spacing).astype(int), 0, np.array(grid.values.shape) - 1)
        for corner in region
    )
    lines = tuple(slice(None) if a == axis else slice(first[a], last[a] + 1) for a in range(3))
    inside = np.moveaxis(grid.values[lines] < 0.0, axis, -1)
    step = [max(1, -(-n // MOST_LINES)) for n in inside.shape[:2]]
    inside = inside[:: step[0], :: step[1]]
    edge = np.diff(np.pad(inside, ((0, 0), (0, 0), (1, 1))).astype(np.int8), axis=2)
    (row, column, start), end = np.nonzero(edge == 1), np.nonzero(edge == -1)[2]
    count = grid.values.shape[axis]
    length = np.where((start > 0) & (end < count), end - start, 2 * count)  # what is cut there goes on beyond
    thickness, example = np.full(count, np.inf), np.zeros((count, 3))
    least = max(1, int(LEAST_SHARE * len(np.unique(row * inside.shape[1] + column))))
    for index in range(first[axis], last[axis] + 1):
        there = np.flatnonzero((start <= index) & (index < end))
        if len(there) >= least:
            chosen = there[np.argsort(length[there], kind="stable")[int(THIN_SHARE * (len(there) - 1))]]
            thickness[index] = length[chosen] * grid.spacing if length[chosen] <= count else np.inf
            example[index, others] = first[others] + np.array([row[chosen] * step[0], column[chosen] * step[1]])
            example[index, axis] = 0.5 * (start[chosen] + end[chosen] - 1)
    along = grid.origin[axis] + grid.spacing * np.arange(count)
    return ThinProfile(along, thickness, grid.origin + grid.spacing * example)


def through_thin_parts(
    cells: Cells, grid: DistanceGrid, region: Array, budget: int, least: float
) -> tuple[Cells, list[UnderResolved]]:
    """Cells with THROUGH of them through what is thin in a box [m], shape (2, 3), at least `least` [m] each and at most
    ALLOWANCE times `budget` of them; and the places along each axis that stay thinner than that."""
    profiles = [thin_profile(grid, axis, region) for axis in range(3)]
    distance = sampler(grid)
    wanted = split_through(cells.planes, profiles, 1.0 / THROUGH, least)
    found = cells
    for eased in EASED:
        planes = split_through(cells.planes, profiles, eased / THROUGH, least)
        count = occupied(planes, distance)
        if count <= max(ALLOWANCE * budget, cells.count):
            found = Cells(planes, cells.size, count)
            break
    return found, [
        one
        for planes, without_budget, profile in zip(found.planes, wanted, profiles, strict=True)
        for one in too_thin(planes, without_budget, profile, least)
    ]


def split_through(planes: Planes, profiles: list[ThinProfile], share: float, least: float) -> Planes:
    """The planes along the three axes, split by the profiles along them."""
    x, y, z = (split(own, profile, share, least) for own, profile in zip(planes, profiles, strict=True))
    return x, y, z


def split(planes: Array, profile: ThinProfile, share: float, least: float) -> Array:
    """Planes whose intervals are at most `share` of the thickness of what they pass, but not finer than `least` [m]."""
    pieces = [planes[:1]]
    for low, high in pairwise(planes):
        wanted = max(share * thinnest(profile, low, high), least)
        count = int(np.clip(np.ceil((high - low) / wanted - 1e-6), 1, MOST_PIECES))
        pieces.append(np.linspace(low, high, count + 1)[1:])
    return np.concatenate(pieces)


def thinnest(profile: ThinProfile, low: float, high: float) -> float:
    """Smallest thickness between two places along the axis [m]."""
    between = (profile.place >= low) & (profile.place < high)  # as interval_at has it
    return float(profile.thickness[between].min(initial=np.inf))


def too_thin(planes: Array, without_budget: Array, profile: ThinProfile, least: float) -> list[UnderResolved]:
    """Where there are fewer cells through the thickness than are to be, and what keeps them from it: the budget if the
    planes without it have enough."""
    through = profile.thickness / interval_at(planes, profile.place)
    affordable = interval_at(without_budget, profile.place)
    return [
        UnderResolved(
            float(through[one]), float(profile.thickness[one]), profile.example[one],
            limit_of(float(profile.thickness[one]), float(affordable[one]), least),
        )
        for one in np.flatnonzero(through < NAMED * THROUGH)
    ]  # fmt: skip


def interval_at(planes: Array, place: Array) -> Array:
    """Length of the interval between planes in which each place (n,) along the axis lies [m], shape (n,)."""
    index = np.clip(np.searchsorted(planes, place, side="right") - 1, 0, len(planes) - 2)
    return np.asarray(np.diff(planes)[index])


def limit_of(thickness: float, interval: float, least: float) -> Limit:
    """Reason why something of a thickness has too few cells, where they are `interval` long with any budget
    and may be no finer than `least` [m]."""
    if thickness >= NAMED * THROUGH * interval:
        return Limit.BUDGET
    return Limit.FINEST if interval <= least * (1.0 + 1e-6) else Limit.PIECES
