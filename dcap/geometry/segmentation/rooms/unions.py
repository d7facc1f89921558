"""Which pieces of a fused scan may be one thing: connected unions, and what can be measured of each.

In: the pieces of `pieces`. Out: unions of pieces that touch, no longer than a thing in a room, with rough measures, and
the choice of unions without overlap that are worth most together. What a union is worth is said by the caller: here
nothing is named. Undersides and backs are missing in scans: what has nothing below it but the floor stands on it.
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
"""Cell in which what is seen from above is counted [m]."""
BAND = 0.015
"""Step of height in which levels are looked for [m]."""
THICK = 3
"""Bands that one level may fill [-]: surfaces of scans are rough, and cushions are not flat."""
LEVEL_SHARE = 0.15
"""Share of the plan from which on what looks up at one height is a level [-]: books hide the boards of a shelf."""
STRAY = 0.5
"""So much of a piece, at either end of each axis, may be stray [per cent]."""
TOUCHING = 8
"""Fewer surfels of a piece next to another one are no contact [-]."""
MOST_PIECES = 6
"""Pieces of one union [-]: a seat, a back, two arms, two cushions."""
NEXT = 5
"""Neighbours that a union is extended by: those that touch it most [-]."""
MOST_UNIONS = 4000
SLACK = 0.05
"""Tolerance for counting a piece as inside a union's bounds [m]."""
LONGEST = 4.0
"""Of one thing [m]: a long sofa."""
LYING = 0.08
"""Pieces that rise no higher above the floor lie on it like rugs: they are part of nothing, and things on them stand on
the floor [m]."""
COVERED = 0.3
"""Share of its plan over a lower patch from which on a piece stands there [-]."""
SINK = 0.08
"""So deep below a patch may what stands on it begin [m]: cushions give way, and patches are rough."""
LOW_ENOUGH = 1.2
"""Unions that begin lower than this above the floor, with nothing below them, stand on the floor [m]."""
BY_WALL = 0.15
"""Unions this near to a wall may hang there [m]."""
ONE_COLOUR = 1.0
"""Colours that differ by less are one [CIELAB units]."""
EYES = 1.5
"""The top of what is higher than people hold a camera is not seen [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class RoughShape:
    """Measures of a union of pieces in a scan. Lengths in metres, heights above the floor."""

    length: float
    """Longer side of its upright rectangle."""
    width: float
    bottom: float | None
    """None where it stands on the floor: feet are hardly ever seen."""
    top: float
    level_height: float | None
    """Height of the level with most surface seen from above; None where nothing looks up."""
    level_area: float
    """Seen from above [m^2]."""
    buried: float
    """Share of that level over which the surface goes on upwards as something else [-]."""
    cut: float
    """Length along which its surface goes on next to it as a patch, or what hangs from one, that is not in it [m]."""
    levels: int
    """Heights at which a good part of the plan looks up."""
    wall_gap: float | None
    """To the nearest wall; None without walls."""
    holder: int
    """The piece that it stands on, -1: none."""
    held_by: str
    """floor, wall, ceiling, nothing, or empty: the holder."""
    color: tuple[float, float, float] | None
    """Mean sRGB colour, 0..1; None where the scan has but one."""

    @property
    def top_seen(self) -> bool:
        """Whether a camera that people hold has seen its top: else the level is that of some board below it."""
        return self.top <= EYES


@dataclass(frozen=True, eq=False, slots=True)
class _Piece:
    """Measures of a piece that are kept so that unions are measured fast."""

    corners: Array
    """Corners of its convex hull seen from above, without strays, shape (h, 2)."""
    low: float
    high: float
    windows: IntArray
    """Lowest bands of the levels in which something looks up, shape (b,)."""
    areas: Array
    """Area of each, seen from above [m^2], shape (b,)."""
    heights: Array
    """Mean height of each above the floor [m], shape (b,)."""
    wall_gap: float
    cells: int
    """It is seen from above in so many cells."""
    area: float
    """[m^2]."""
    lab: Array
    """Mean colour in CIELAB, shape (3,)."""


@dataclass(frozen=True, eq=False, slots=True)
class PieceGraph:
    """Pieces and what touches what."""

    pieces: dict[int, _Piece]
    touching: dict[int, dict[int, int]]
    """Surfels in contact, by the numbers of the two pieces."""
    over: dict[int, dict[int, int]]
    """Cells of a piece that are over the patch of another one, by the numbers of the two."""
    patches: int
    """The first so many pieces have a patch that carries."""
    ceiling: float
    """Above the floor [m]; inf where there is none."""
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
        """Connected unions of at most MOST_PIECES pieces, the smaller first, and these with all that lies within."""
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
        """With all pieces that touch it and lie within its bounds: what stands on the boards of a shelf."""
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
    """Corners of the convex hull of points (n, 2), the points themselves where they have none."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):
        return points


def _windows(height: Array, plan: Array) -> tuple[IntArray, Array, Array]:
    """Of what looks up, for every level of THICK bands: its lowest band, its area seen from above and mean height."""
    band = np.repeat(np.floor(height / BAND).astype(np.int64), THICK) - np.tile(np.arange(THICK), len(height))
    cell = np.repeat(np.floor(plan / CELL).astype(np.int64), THICK, axis=0)
    seen = np.unique(np.c_[band, cell], axis=0)
    windows, count = np.unique(seen[:, 0], return_counts=True)
    place = np.searchsorted(windows, band)
    mean = np.bincount(place, np.repeat(height, THICK), len(windows)) / np.maximum(np.bincount(place), 1)
    return windows.astype(np.int64), (count * CELL**2).astype(np.float64), np.asarray(mean, dtype=np.float64)


def _levels(members: Sequence[_Piece], plan: float) -> tuple[float | None, float, int]:
    """Height and area of the level with most surface seen from above, and how many cover a good part of the plan."""
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
    """Surfels of the smaller side of every contact."""
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
    """In how many cells each piece lies over a patch that is lower than it begins."""
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
    """Unions without overlap whose worth adds up to as much as can be found by exchange; those worth nothing are out.

    Greedy, then every union that is worth more than those that it overlaps takes their place, until none does.
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
