"""Connected unions of the pieces of a fused scan that may be one thing, and their measures.

In: the pieces of `pieces`. Out: unions of pieces that touch, no longer than a thing in a room, with rough measures, and
the choice of disjoint unions with the largest total worth. The caller defines the worth of a union: nothing is named
here. Undersides and backs are missing in scans: a union with only the floor below it stands on the floor.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from skimage.color import lab2rgb

from dcap.arrays import Array, IntArray
from dcap.geometry.segmentation.rooms.contacts import VOXEL, Surfels
from dcap.geometry.segmentation.rooms.pieces import Pieces
from dcap.scene.types.boxes import min_area_box

CELL = 1.5 * VOXEL
"""Size of the cells for counting surfaces visible from above [m]."""
BAND = 0.015
"""Step of height in the search for levels [m]."""
THICK = 3
"""Number of bands that one level may fill [-]: surfaces of scans are rough, and cushions are not flat."""
LEVEL_SHARE = 0.15
"""Least share of the plan that faces up at one height for a level [-]: books hide the boards of a shelf."""
STRAY = 0.5
"""Share of a piece, at either end of each axis, that may be stray [per cent]."""
TOUCHING = 8
"""Least number of surfels of a piece next to another one in a contact [-]."""
MOST_PIECES = 6
"""Maximum number of pieces of one union [-]: a seat, a back, two arms, two cushions."""
NEXT = 5
"""Number of neighbours by which a union is extended: those with most contact [-]."""
MOST_UNIONS = 4000
SLACK = 0.05
"""Tolerance for counting a piece as inside a union's bounds [m]."""
LONGEST = 4.0
"""Largest length of one thing [m]: a long sofa."""
LYING = 0.08
"""Largest height above the floor of pieces that lie on it like rugs: they are part of nothing, and things on them stand
on the floor [m]."""
COVERED = 0.3
"""Least share of its plan over a lower patch for a piece to stand on it [-]."""
SINK = 0.08
"""Largest depth below a patch at which a thing on it may begin [m]: cushions yield, and patches are rough."""
LOW_ENOUGH = 1.2
"""Height above the floor below which unions with nothing below them stand on the floor [m]."""
BY_WALL = 0.15
"""Largest distance from a wall of unions that may hang there [m]."""
ONE_COLOUR = 1.0
"""Difference below which colours are equal [CIELAB units]."""
EYES = 1.5
"""Height of a hand-held camera, above which the top of a thing is not visible [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class RoughShape:
    """Measures of a union of pieces in a scan. Lengths in metres, heights above the floor."""

    length: float
    """Longer side of the upright rectangle around it."""
    width: float
    bottom: float | None
    """Height of the bottom; None if it stands on the floor: feet are hardly ever visible."""
    top: float
    level_height: float | None
    """Height of the level with most surface visible from above; None if nothing faces up."""
    level_area: float
    """Area of that level, seen from above [m^2]."""
    buried: float
    """Share of that level over which the surface continues upwards as something else [-]."""
    cut: float
    """Length of the border along which its surface continues as a patch, or a surface hanging from one, outside the
    union [m]."""
    levels: int
    """Number of heights at which a good part of the plan faces up."""
    wall_gap: float | None
    """Distance to the nearest wall; None without walls."""
    holder: int
    """Index of the piece on which it stands, -1: none."""
    held_by: str
    """floor, wall, ceiling, nothing, or empty if it is `holder`."""
    color: tuple[float, float, float] | None
    """Mean sRGB colour, 0..1; None if the scan has only one colour."""

    @property
    def top_seen(self) -> bool:
        """Whether a hand-held camera has seen its top; otherwise the level is that of some board below it."""
        return self.top <= EYES


@dataclass(frozen=True, eq=False, slots=True)
class _Piece:
    """Measures of a piece, stored so that unions are measured fast."""

    corners: Array
    """Corners of its convex hull seen from above, without strays, shape (h, 2)."""
    low: float
    high: float
    windows: IntArray
    """Lowest bands of the levels with upward surfaces, shape (b,)."""
    areas: Array
    """Area of each level, seen from above [m^2], shape (b,)."""
    heights: Array
    """Mean height of each level above the floor [m], shape (b,)."""
    wall_gap: float
    cells: int
    """Number of cells that it covers, seen from above."""
    area: float
    """Area [m^2]."""
    lab: Array
    """Mean colour in CIELAB, shape (3,)."""


@dataclass(frozen=True, eq=False, slots=True)
class PieceGraph:
    """Pieces and their contacts."""

    pieces: dict[int, _Piece]
    touching: dict[int, dict[int, int]]
    """Number of surfels in contact, by the indices of the two pieces."""
    over: dict[int, dict[int, int]]
    """Number of cells of a piece over the patch of another one, by the indices of the two."""
    patches: int
    """Number of pieces with a carrying patch, which come first."""
    ceiling: float
    """Height of the ceiling above the floor [m]; inf if there is none."""
    colored: bool
    """Whether the scan has more than one colour."""

    def shape(self, union: frozenset[int]) -> RoughShape:
        """Measure a union."""
        members = [self.pieces[i] for i in sorted(union)]
        corners = np.concatenate([one.corners for one in members])
        box = min_area_box(np.c_[corners, np.zeros(len(corners))])
        width, length = sorted(2.0 * box.half_extents[:2])
        low, top = min(one.low for one in members), max(one.high for one in members)
        gap = min(one.wall_gap for one in members)
        holder, held_by = self._holder(union, low, top, gap)
        level, area, levels = _levels(members, float(length * width))
        return RoughShape(
            length=float(length), width=float(width), bottom=None if held_by == "floor" else low, top=top,
            level_height=level, level_area=area, buried=self._buried(union, area), cut=self._cut(union), levels=levels,
            wall_gap=gap if np.isfinite(gap) else None,
            holder=holder, held_by=held_by, color=_color(members) if self.colored else None,
        )  # fmt: skip

    def _holder(self, union: frozenset[int], low: float, top: float, gap: float) -> tuple[int, str]:
        cells = sum(self.pieces[i].cells for i in union)
        below: dict[int, int] = {}
        for i in union:
            for other, count in self.over[i].items():
                if other not in union:
                    below[other] = below.get(other, 0) + count
        best = max(below, key=lambda other: (below[other], -other), default=-1)
        if best >= 0 and sum(below.values()) > COVERED * cells:
            return best, ""
        if low < LOW_ENOUGH:
            return -1, "floor"
        if gap < BY_WALL:
            return -1, "wall"
        return -1, "ceiling" if top > self.ceiling - BY_WALL else "nothing"

    def _buried(self, union: frozenset[int], area: float) -> float:
        above = {other for i in union for other in self.touching[i] if other not in union}
        cells = sum(self.over[other].get(i, 0) for other in above for i in union)
        return min(cells * CELL**2 / area, 1.0) if area > 0.0 else 0.0

    def _cut(self, union: frozenset[int]) -> float:
        return VOXEL * sum(
            count for i in union for other, count in self.touching[i].items()
            if other not in union and max(i, other) < self.patches
            and not self._stands_on(other, i) and not self._stands_on(i, other)
        )  # fmt: skip

    def _stands_on(self, piece: int, other: int) -> bool:
        return self.over[piece].get(other, 0) > 0.5 * self.pieces[piece].cells

    def unions(self) -> list[frozenset[int]]:
        """Connected unions of at most MOST_PIECES pieces, the smaller first, each also with all pieces inside it."""
        found: dict[frozenset[int], None] = {}
        frontier = [frozenset([i]) for i in self.pieces if self._extent(frozenset([i])) < LONGEST]
        while frontier and len(found) < MOST_UNIONS:
            found.update(dict.fromkeys(frontier))
            larger: dict[frozenset[int], None] = {}
            for union in frontier:
                if len(union) < MOST_PIECES:
                    larger.update(dict.fromkeys(self._extended(union)))
            frontier = [union for union in larger if union not in found]
        found.update(dict.fromkeys([self._closed(union) for union in found]))
        return list(found)

    def _closed(self, union: frozenset[int]) -> frozenset[int]:
        """The union with all pieces that touch it and lie within its bounds: things on the boards of a shelf."""
        low, high = self._bounds(union)
        while more := [other for i in union for other in self.touching[i]
                       if other not in union and self._within(other, low, high)]:  # fmt: skip
            union |= frozenset(more)
        return union

    def _within(self, piece: int, low: Array, high: Array) -> bool:
        first, last = self._bounds(frozenset([piece]))
        return bool((first > low - SLACK).all() and (last < high + SLACK).all())

    def _bounds(self, union: frozenset[int]) -> tuple[Array, Array]:
        """Lowest and highest corner of the axis-aligned bounds, heights above the floor, each of shape (3,)."""
        corners = np.concatenate([self.pieces[i].corners for i in union])
        low, high = min(self.pieces[i].low for i in union), max(self.pieces[i].high for i in union)
        return np.append(corners.min(axis=0), low), np.append(corners.max(axis=0), high)

    def _extended(self, union: frozenset[int]) -> list[frozenset[int]]:
        contact: dict[int, int] = {}
        for i in union:
            for other, count in self.touching[i].items():
                if other not in union:
                    contact[other] = contact.get(other, 0) + count
        nearest = sorted(contact, key=lambda other: (-contact[other], other))[:NEXT]
        return [larger for other in nearest if self._extent(larger := union | {other}) < LONGEST]

    def _extent(self, union: frozenset[int]) -> float:
        corners = np.concatenate([self.pieces[i].corners for i in union])
        return float(np.ptp(corners, axis=0).max())


def piece_graph(surfels: Surfels, pieces: Pieces, planes: Array, floor: float, ceiling: float) -> PieceGraph:
    """Measure the pieces; `planes` are the walls, shape (w, 4); heights of floor and ceiling (nan: none) [m]."""
    number = np.arange(pieces.count)
    order = np.argsort(pieces.owner, kind="stable")
    start = np.searchsorted(pieces.owner[order], np.append(number, pieces.count))
    members = {int(i): order[start[i] : start[i + 1]] for i in number if start[i + 1] - start[i] >= TOUCHING}
    gap = _wall_gaps(surfels.position, planes)
    known = {i: _piece(surfels, mine, gap[mine], floor) for i, mine in members.items()}
    return PieceGraph(
        known, _touching(surfels, pieces.owner, known), _over(surfels, pieces, members, known, floor), pieces.patches,
        float("inf") if np.isnan(ceiling) else ceiling - floor,
        bool(np.ptp(surfels.lab, axis=0).max(initial=0.0) > ONE_COLOUR),
    )  # fmt: skip


def _wall_gaps(position: Array, planes: Array) -> Array:
    """Distance to the nearest wall [m], inf without walls, shape (n,)."""
    return np.asarray(np.abs(position @ planes[:, :3].T - planes[:, 3]).min(axis=1, initial=np.inf), dtype=np.float64)


def _piece(surfels: Surfels, mine: IntArray, gap: Array, floor: float) -> _Piece:
    position, up = surfels.position[mine], surfels.normal[mine, 2] > 0.75
    height = position[:, 2] - floor
    low, high = np.percentile(position, [STRAY, 100.0 - STRAY], axis=0)
    kept = ((position >= low) & (position <= high))[:, :2].all(axis=1)
    windows, areas, heights = _windows(height[up], position[up, :2])
    cells = np.unique(np.floor(position[:, :2] / CELL).astype(np.int64), axis=0)
    return _Piece(
        _outline(position[kept, :2] if kept.sum() > 2 else position[:, :2]),
        float(low[2] - floor), float(high[2] - floor), windows, areas, heights,
        float(np.percentile(gap, STRAY)), len(cells),
        float(surfels.area[mine].sum()), np.average(surfels.lab[mine], axis=0, weights=surfels.area[mine]),
    )  # fmt: skip


def _color(members: Sequence[_Piece]) -> tuple[float, float, float]:
    """Mean sRGB colour, 0..1."""
    red, green, blue = lab2rgb(np.average([one.lab for one in members], axis=0, weights=[one.area for one in members]))
    return float(red), float(green), float(blue)


def _outline(points: Array) -> Array:
    """Corners of the convex hull of points (n, 2), or the points themselves if there is no hull."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points


def _windows(height: Array, plan: Array) -> tuple[IntArray, Array, Array]:
    """Lowest band, area seen from above and mean height of every level, of THICK bands, of the upward surface."""
    band = np.repeat(np.floor(height / BAND).astype(np.int64), THICK) - np.tile(np.arange(THICK), len(height))
    cell = np.repeat(np.floor(plan / CELL).astype(np.int64), THICK, axis=0)
    seen = np.unique(np.c_[band, cell], axis=0)
    windows, count = np.unique(seen[:, 0], return_counts=True)
    place = np.searchsorted(windows, band)
    mean = np.bincount(place, np.repeat(height, THICK), len(windows)) / np.maximum(np.bincount(place), 1)
    return windows.astype(np.int64), (count * CELL**2).astype(np.float64), np.asarray(mean, dtype=np.float64)


def _levels(members: Sequence[_Piece], plan: float) -> tuple[float | None, float, int]:
    """Height and area of the level with most surface visible from above, and the number of levels that cover a good
    part of the plan."""
    windows = np.concatenate([one.windows for one in members])
    if not len(windows):
        return None, 0.0, 0
    areas = np.concatenate([one.areas for one in members])
    first = int(windows.min())
    total = np.bincount(windows - first, areas)
    best = int(np.argmax(total))
    mine = windows - first == best
    heights = np.concatenate([one.heights for one in members])
    height, area = float(np.average(heights[mine], weights=areas[mine])), float(total[best])
    levels = 0
    while total.max() > LEVEL_SHARE * plan:
        levels += 1
        highest = int(np.argmax(total))
        total[max(highest - 2 * THICK, 0) : highest + 2 * THICK + 1] = 0.0
    return height, area, levels


def _touching(surfels: Surfels, owner: IntArray, known: dict[int, _Piece]) -> dict[int, dict[int, int]]:
    """Number of surfels on the smaller side of every contact."""
    a, b = owner[surfels.pairs].T
    apart = np.flatnonzero((a != b) & (a >= 0) & (b >= 0))
    result: dict[int, dict[int, int]] = {i: {} for i in known}
    count: dict[tuple[int, int], int] = {}
    for this, other, end in ((a, b, 0), (b, a, 1)):
        rows = np.unique(np.c_[this[apart], other[apart], surfels.pairs[apart, end]], axis=0)
        keys, number = np.unique(rows[:, :2], axis=0, return_counts=True)
        count |= {(int(i), int(j)): int(n) for (i, j), n in zip(keys, number, strict=True)}
    for (i, j), n in count.items():
        least = min(n, count.get((j, i), 0))
        if i in known and j in known and least >= TOUCHING and min(known[i].high, known[j].high) > LYING:
            result[i][j] = least
    return result


def _over(
    surfels: Surfels, pieces: Pieces, members: dict[int, IntArray], known: dict[int, _Piece], floor: float
) -> dict[int, dict[int, int]]:  # fmt: skip
    """Number of cells in which each piece lies over a patch that is lower than its bottom."""
    cell = np.floor(surfels.position[:, :2] / CELL).astype(np.int64)
    cell -= cell.min(axis=0, initial=0)
    key = cell[:, 0] * (int(cell[:, 1].max(initial=0)) + 1) + cell[:, 1]
    level = pieces.level - floor
    tops = {
        j: np.unique(key[members[j]][surfels.position[members[j], 2] > pieces.level[j] - SINK])
        for j in members if j < pieces.patches and level[j] > LYING
    }  # fmt: skip
    result: dict[int, dict[int, int]] = {}
    for i, mine in members.items():
        seen = np.unique(key[mine])
        below = [j for j in tops if j != i and level[j] < known[i].low + SINK]
        shared = {j: int(np.isin(seen, tops[j], assume_unique=True).sum()) for j in below}
        result[i] = {j: n for j, n in shared.items() if n}
    return result


def worth_most(
    unions: Sequence[frozenset[int]], worth: Sequence[float], order: Callable[[frozenset[int]], object] = sorted
) -> list[frozenset[int]]:
    """Disjoint unions with the largest total worth found by exchange; unions without worth are left out.

    First greedily; then every union that is worth more than those that it overlaps replaces them, until none does.
    """
    value = {union: w for union, w in zip(unions, worth, strict=True) if w > 0.0}
    ranked = sorted(value, key=lambda union: (-value[union], order(union)))
    chosen: dict[int, frozenset[int]] = {}
    changed = True
    while changed:
        changed = False
        for union in ranked:
            rivals = {chosen[i] for i in union if i in chosen}
            if union in rivals or value[union] <= sum(value[one] for one in rivals) + 1e-9:
                continue
            for i in [i for one in rivals for i in one]:
                del chosen[i]
            chosen |= dict.fromkeys(union, union)
            changed = True
    return list(dict.fromkeys(chosen[i] for i in sorted(chosen)))
