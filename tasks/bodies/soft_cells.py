"""Background grids of soft bodies: cell sizes from the contact, from thickness, within a budget.

In: signed distances and boxes. Out: node planes. Cells are uniform per axis for free bodies, graded for supports.

Cell sizes that a soft body needs where contacts are predicted, separately along each axis.

Cells are a fifth of half the patch's width: fine across a line of contact, coarse along it, and fine again where a long
contact ends, since pressure falls to zero there over about its width.

Cells through thin parts of a soft support: a cushion of one cell can neither bend nor be compressed.

In: the sampled distance of a solid and the planes that the contact requires. Out: planes with enough cells through thin
parts, as far as a budget allows, and the places where it does not. Thickness is the length of an uninterrupted stretch
of material on a line along an axis; rims and rounded edges are shorter than the part that they belong to, so a low
quantile counts, not the minimum.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import Distance, sampler
from dcap.scene.types.particles import DistanceGrid
from solver.model.grid import sized_planes
from tasks.bodies.plan_contact import BESIDE, PlanContact

Planes = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

THIN_SHARE = 0.2  # chords shorter than all but this share count as the thinnest: rims and tips are always shorter
MOST_ASPECT = 3.0  # longest over shortest cell edge: beyond it trilinear cells lock
COARSENING = 1.06  # factor per round when a grid exceeds its budget
MOST_LOOKED_AT = 4_000_000  # cells of a grid that are checked one by one: half a gigabyte meanwhile
PADDING = 2  # cells beyond the surface of a free body, so that its displacement extends past it
CELLS_ACROSS = 5.0  # cells in half the width of a predicted contact
CELLS_AT_ENDS = 2.0  # and in the shorter half width where a long contact ends: pressure falls over that length
CELLS_AT_EDGES = 11.0  # and where it ends at an edge: a flat cylinder on a thin layer is 1.5 to 3 % short so
MOST_FACTOR = 1e3  # on the wanted sizes: a grid that is still over budget would be so without any contact
GROWTH = 1.6  # ratio of neighbouring cells away from a contact
THROUGH = 2.0  # least number of cells through a part that bends
ALLOWANCE = 1.25  # times the budget of the contact's cells, for thin parts too
EASED = (1.0, 1.25, 1.5, 2.0, 3.0)  # factors on the wanted size of cells, tried in this order to meet the allowance
MOST_PIECES = 4  # of an interval between two planes: a sliver must not use up the budget of other parts
LEAST_SHARE = 0.05  # least share of the solid's lines through a place: below it is a rim or a knob, which does not bend
MOST_LINES = 60  # lines across a solid along each of the two other axes
NAMED = 0.95  # share of the wanted number of cells below which a part is named


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """A chosen grid."""

    planes: Planes
    size: float
    """Cell size at the contact, or the smallest of a uniform grid [m]."""
    count: int
    """Number of cells with material."""


def thickness(grid: DistanceGrid) -> NDArray[np.float64]:
    """Typical small thickness of a solid along x, y and z [m]: a low quantile of its chords, shape (3,)."""
    inside = grid.values < 0.0
    result = np.empty(3)
    for axis in range(3):
        lines = np.moveaxis(inside, axis, -1).reshape(-1, inside.shape[axis])
        step = np.diff(np.pad(lines, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        start, end = np.nonzero(step == 1)[1], np.nonzero(step == -1)[1]
        chords = (end - start) * grid.spacing
        result[axis] = np.quantile(chords, THIN_SHARE) if len(chords) else grid.spacing
    return result


def uniform_cells(
    distance: Distance,
    bounds: NDArray[np.float64],
    thin: NDArray[np.float64],
    contact: float,
    through: int,
    budget: int,
) -> Cells:
    """A uniform grid around a free body: `through` cells along the thin chords (3,), at most `contact` [m], at most
    `budget`.
    """
    wanted = np.minimum(thin / through, contact)
    wanted = np.minimum(wanted, MOST_ASPECT * wanted.min())
    scale = 1.0
    while True:
        planes = uniform_planes(bounds, scale * wanted)
        count = occupied(planes, distance)
        if count <= budget:
            return Cells(planes, float(scale * wanted.min()), count)
        scale *= max(COARSENING, min((count / budget) ** (1 / 3), 1.5))


def uniform_planes(bounds: NDArray[np.float64], cell: NDArray[np.float64]) -> Planes:
    """Planes of uniform cells (3,) centred on a box, PADDING cells beyond it on each side."""
    planes = []
    for axis in range(3):
        low, high = bounds[:, axis]
        count = int(np.ceil((high - low) / cell[axis] - 1e-9)) + 2 * PADDING
        middle = 0.5 * (low + high)
        planes.append(middle + cell[axis] * (np.arange(count + 1) - 0.5 * count))
    return planes[0], planes[1], planes[2]


def occupied(planes: Planes, distance: Distance) -> int:
    """Number of cells that may hold material: their middle is inside, or nearer to the surface than half their
    diagonal; for a grid far beyond any budget the number of all cells, without checking them.
    """
    total = int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))
    if total > MOST_LOOKED_AT:
        return total
    middle = np.stack(np.meshgrid(*[0.5 * (p[:-1] + p[1:]) for p in planes], indexing="ij"), axis=-1).reshape(-1, 3)
    half = 0.5 * np.linalg.norm(
        np.stack(np.meshgrid(*[np.diff(p) for p in planes], indexing="ij"), axis=-1).reshape(-1, 3), axis=1
    )
    return int((distance(middle) < half).sum())


def nodes(planes: Planes) -> NDArray[np.float64]:
    """Node positions [m], shape (kx ky kz, 3)."""
    return np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False, slots=True)
class WantedCells:
    """Largest cells along an axis in some intervals."""

    begin: Array
    """Lower end of each interval [m], shape (k,)."""
    end: Array
    """Upper end of each interval [m], shape (k,)."""
    size: Array
    """Largest cell in each interval [m], shape (k,)."""

    @classmethod
    def joined(cls, several: Sequence["WantedCells"]) -> "WantedCells":
        """The wanted cells of several contacts together."""
        nothing = np.zeros(0)
        return cls(
            np.concatenate([nothing, *(one.begin for one in several)]),
            np.concatenate([nothing, *(one.end for one in several)]),
            np.concatenate([nothing, *(one.size for one in several)]),
        )

    def resized(self, *, size: float | None = None, scale: float = 1.0, away: float = 0.0) -> "WantedCells":
        """A copy with a new size [m], or sizes multiplied by `scale`, grown over a distance `away` [m] to the body."""
        asked = np.full(len(self.size), size) if size is not None else self.size
        return WantedCells(self.begin, self.end, scale * asked + np.log(GROWTH) * away)


def wanted_in_plan(contact: PlanContact, axis: int) -> WantedCells:
    """The cells that a contact needs along x (0) or y (1)."""
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
    is half under an edge deflects too little."""
    place, size = contact.edges(axis), contact.half_width / CELLS_AT_EDGES
    return WantedCells(place - size, place + size, np.full(len(place), size))


def wanted_in_height(contact: PlanContact, low: float, high: float) -> WantedCells:
    """The cells that a contact needs along z if it lies between two heights [m] on the body."""
    half = contact.half_width
    return WantedCells(np.array([low - half]), np.array([high + half]), np.array([half / CELLS_ACROSS]))


def cells_within(
    box: Array, wanted: Callable[[float], Sequence[WantedCells]], count: Callable[[Planes], int], budget: int | None
) -> tuple[Cells, float]:
    """Cells over a box (2, 3) [m] as wanted along x, y and z, or larger by the least factor with which their `count`
    meets a budget, if one exists; and that factor. `wanted` takes the factor."""
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


@dataclass(frozen=True, eq=False, slots=True)
class ThinProfile:
    """Thickness of a solid along one axis, at places along it."""

    place: Array
    """Coordinates along the axis [m], shape (n,)."""
    thickness: Array
    """Typical small thickness there [m], inf where nothing is, shape (n,)."""
    example: Array
    """The middle of a stretch of material of that thickness [m], shape (n, 3)."""


class Limit(StrEnum):
    """Reason why cells are coarser than something thin needs."""

    BUDGET = "budget"
    """A larger budget of cells would provide enough."""
    FINEST = "finest"
    """Cells are as fine as they may be."""
    PIECES = "pieces"
    """A cell of the contact is already cut into MOST_PIECES."""


@dataclass(frozen=True, eq=False, slots=True)
class UnderResolved:
    """A place that is too thin for its cells."""

    cells: float
    """Cells through it [-]."""
    thickness: float
    """Thickness of the place [m]."""
    place: Array
    """A point in it [m], shape (3,)."""
    limit: Limit
    """Reason why there are no more."""


def thin_profile(grid: DistanceGrid, axis: int, region: Array) -> ThinProfile:
    """The profile of a sampled solid along an axis, for material inside the box `region` [m], shape (2, 3)."""
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
    length = np.where((start > 0) & (end < count), end - start, 2 * count)  # cut material continues beyond
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
    """Cells with at least THROUGH of them through thin parts in a box [m], shape (2, 3), each at least `least` [m] and
    at most ALLOWANCE times `budget` in all; and the places along each axis that still have fewer."""
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
    """Planes whose intervals are at most `share` of the thickness of the material there, but not finer than `least`
    [m]."""
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
    """Places with too few cells through the thickness, and the reason: the budget if the planes without a budget have
    enough."""
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
    """Reason why a part of a thickness has too few cells, if they are `interval` long without a budget and may be no
    finer than `least` [m]."""
    if thickness >= NAMED * THROUGH * interval:
        return Limit.BUDGET
    return Limit.FINEST if interval <= least * (1.0 + 1e-6) else Limit.PIECES
