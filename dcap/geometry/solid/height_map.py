"""Heights of a surface from straight above, and where it was torn: holes that a scan has and the thing has not.

In: faces of one thing. Out: heights on a regular grid, holes in them with their sizes, and the height of the surface
that closes each from its rim. A hole is a pit whose rim ends in the air: faces end there that nothing joins, and from
the surface to what is seen through it no wall leads down, as one would in a tub or between two cushions. What is closed
has no holes but its own, be it as thin as a slat. The rim has to go around a hole and to be about as flat as a surface:
the way between a seat and a back is no hole.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator
from scipy.ndimage import binary_dilation, find_objects, grey_closing, label
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from dcap.arrays import Array, Mask
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.open_edges import OpenEdges
from dcap.scene.types.mesh import Mesh

MARGIN = 2  # samples that a map is wider on each side than what is seen
ABOVE = 0.05  # rays begin this far above the surface [m]
DEEP = 0.01  # what is seen through a hole lies at least this far below its rim [m]: less is a dent, or scan noise
STEP = 0.02  # neighbouring places whose heights differ by less than this [m] are on one level
WIDTHS = (0.03, 0.08, 0.2, 0.5)  # pits up to these widths [m] are looked for one after the other, small ones first
ENCLOSED = 0.92  # share of a pit's border beyond which the surface lies higher
TORN = 0.6  # share of that border at which faces end and no wall leads down
NEAR_EDGE = 2.0  # samples from where a surface goes down to the edge at which it ends, at most
WALL_DEPTH = 0.04  # a wall is looked for this far down at most [m]
WALL_HEIGHTS = (0.25, 0.5, 0.75)  # shares of the depth at which it is looked for
STEEPEST = 1.0  # slope of the plane through a hole's rim at most [-]: beyond 45 degrees it is a side of the thing
UNEVEN = 0.2  # root mean square distance of a rim from its plane over its size at most [-]
LARGEST_SHARE = 0.5  # a hole is at most this share of the plan of the thing: beyond, the thing is a frame
BROADEST = 0.3  # a hole through which a surface is seen that looks up is at most this long [m]
RIM = 3  # samples around a hole that say how the surface goes on in it
TINY = 6  # a pit of so few samples is a crack: nothing can be put in there
ROUNDS, OUTLYING = 3, 4.0  # a rim sample farther off the plane than so many medians is none
MOST_RIM = 300  # of them
SMOOTH = 1e-3  # how far the closing surface may keep off single rim samples: they carry the scan's noise


@dataclass(frozen=True, eq=False, slots=True)
class HeightMap:
    """A surface seen from above."""

    origin: Array
    """World xy of sample (0, 0) [m], shape (2,)."""
    cell: float
    """Distance of neighbouring samples [m]."""
    height: Array
    """Of the first surface [m], -inf where there is none, shape (rows, columns)."""
    face: NDArray[np.int64]
    """That surface's face, -1 for none, shape (rows, columns)."""

    def world(self, index: NDArray[np.integer]) -> Array:
        """World xy of samples (n, 2) [m], shape (n, 2)."""
        return np.asarray(self.origin + self.cell * index)


@dataclass(frozen=True, eq=False, slots=True)
class TornHole:
    """A hole of a scan, closed from its rim."""

    place: tuple[slice, slice]
    """Rows and columns of the map that it lies in."""
    mask: Mask
    """Its samples among these."""
    low: Array
    """Lower corner of its box in plan [m], shape (2,)."""
    high: Array
    """Upper corner [m], shape (2,)."""
    sides: tuple[float, float]
    """Length and width of the smallest rectangle in plan about it [m]."""


def spacing_within(sides: Array, finest: float, most: int, margin: int) -> float:
    """Distance of the samples of a rectangle with these sides (2,) [m], `margin` more on each side, at least `finest`
    [m] and so that there are at most so many."""
    low, high = finest, max(finest, 2.0 * float(sides.max()) / max(np.sqrt(most) - 2 * margin - 2, 1.0))
    if float(np.prod(np.ceil(sides / low) + 2 * margin + 1)) <= most:
        return float(low)
    for _ in range(30):
        middle = 0.5 * (low + high)
        fits = float(np.prod(np.ceil(sides / middle) + 2 * margin + 1)) <= most
        low, high = (low, middle) if fits else (middle, high)
    return float(high)


def seen_from_above(caster: Raycaster, bounds: Array, cell: float) -> HeightMap:
    """The heights of a surface within bounds (2, 3) [m], MARGIN samples wider all around."""
    origin = bounds[0, :2] - MARGIN * cell
    rows, columns = np.ceil(np.ptp(bounds[:, :2], axis=0) / cell).astype(int) + 2 * MARGIN + 1
    index = np.indices((rows, columns)).reshape(2, -1).T
    start = np.c_[origin + cell * index, np.full(len(index), bounds[1, 2] + ABOVE)]
    hits = caster.cast(start, np.broadcast_to((0.0, 0.0, -1.0), start.shape))
    height = np.where(hits.face >= 0, start[:, 2] - hits.distance, -np.inf)
    return HeightMap(origin, cell, height.reshape(rows, columns), hits.face.astype(np.int64).reshape(rows, columns))


def holes_closed(seen: HeightMap, caster: Raycaster, mesh: Mesh) -> tuple[HeightMap, list[TornHole]]:
    """The map of a mesh with its holes closed, and these; the faces there stay those that are seen through them."""
    edges = OpenEdges(mesh, seen.cell)
    carrying = seen.face >= 0
    carrying[carrying] = mesh.face_normals[seen.face[carrying], 2] > 0.0
    floor = float(seen.height[np.isfinite(seen.height)].min(initial=np.inf)) - 1.0
    height = np.where(np.isfinite(seen.height), seen.height, floor)
    largest = LARGEST_SHARE * int(np.isfinite(seen.height).sum())
    found = np.zeros(height.shape, dtype=bool)
    for width in WIDTHS:
        around = closed_over(height, max(round(width / seen.cell), 2))
        number, _ = label(around - height > DEEP)
        tiny = (np.bincount(number.reshape(-1)) <= TINY)[number] & (number > 0)
        cracks = torn_cracks(seen, height, number, tiny, edges)
        height[cracks], found[cracks] = around[cracks], True
        number[tiny] = 0
        for window, pit in windows(number):
            part = HeightMap(
                seen.world(np.array([side.start for side in window])), seen.cell, height[window], seen.face
            )
            for hole in torn_off(part, pit, caster, edges):
                if hole.sum() > largest or is_a_place(hole, carrying[window], seen.cell):
                    continue
                closed = surface_across(part, hole)
                if closed is not None:
                    part.height[hole] = closed  # a view: the whole map is closed there
                    found[window] |= hole
    height[height <= floor] = -np.inf
    return HeightMap(seen.origin, seen.cell, height, seen.face), holes_of(found, seen)


def is_a_place(hole: Mask, carrying: Mask, cell: float) -> bool:
    """Whether most of what is seen in a hole looks up and it is so broad that it is a surface of its own: a seat whose
    sides a scan does not show. Inside of a thing one sees backs, or nothing."""
    broad = cell * float(np.ptp(np.argwhere(hole), axis=0).max() + 1) > BROADEST
    return broad and float(carrying[hole].mean()) > 0.5


def closed_over(height: Array, width: int) -> Array:
    """Heights with all places filled that are no wider than `width` samples [m], shape (rows, columns)."""
    padded = np.pad(height, width, mode="edge")
    return np.asarray(grey_closing(padded, size=(width + 1, width + 1))[width:-width, width:-width])


def windows(number: NDArray[np.integer]) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """For each numbered place a window, RIM samples wider, and its samples in it; not for those at the map's end."""
    for one, place in enumerate(find_objects(number), start=1):
        if place is None:
            continue
        if all(side.start > 0 and side.stop < size for side, size in zip(place, number.shape, strict=True)):
            rows, columns = (slice(max(side.start - RIM, 0), side.stop + RIM) for side in place)
            yield (rows, columns), number[rows, columns] == one


def torn_off(part: HeightMap, pit: Mask, caster: Raycaster, edges: OpenEdges) -> Iterator[Mask]:
    """Those places of a pit, shape (rows, columns), around which the surface ends in the air.

    What is seen in a pit falls into levels. One that walls or slopes lead down to, as to the way between two cushions,
    is no hole but what a hole may border on; levels that only others border on go with these.
    """
    level, count = levels_of(part.height, pit)
    inner, outer = neighbours_of(pit)
    drop = part.height[tuple(outer.T)] - part.height[tuple(inner.T)]
    higher = drop > DEEP
    air = higher.copy()
    air[higher] = edges.near(brinks(part, part.height, inner[higher], outer[higher]), NEAR_EDGE * part.cell)
    air[air] = ~walls_between(part, inner[air], outer[air], drop[air], caster)
    own, other = level[tuple(inner.T)], level[tuple(outer.T)]
    open_ = np.ones(count + 1, dtype=bool)
    open_[0] = False
    for _ in range(count):
        counts = ~open_[other]
        pairs, high, free = (
            np.bincount(own[counts], weights=kind[counts], minlength=count + 1)
            for kind in (np.ones(len(own)), higher, air)
        )
        kept = open_ & (high >= ENCLOSED * pairs) & (free >= TORN * high)
        if (kept == open_).all():
            break
        open_ = kept
    number, found = label(open_[level])
    for one in range(1, found + 1):
        yield number == one


def torn_cracks(seen: HeightMap, height: Array, number: NDArray[np.integer], tiny: Mask, edges: OpenEdges) -> Mask:
    """Those of the numbered places that are tiny around which faces end, shape (rows, columns)."""
    inner, outer = neighbours_of(tiny)
    down = height[tuple(outer.T)] - height[tuple(inner.T)] > DEEP
    inner, outer = inner[down], outer[down]
    own, count = number[tuple(inner.T)], int(number.max(initial=0)) + 1
    free = np.bincount(own, edges.near(brinks(seen, height, inner, outer), NEAR_EDGE * seen.cell), count)
    return np.asarray(tiny & (free >= TORN * np.maximum(np.bincount(own, minlength=count), 1))[number])


def brinks(seen: HeightMap, height: Array, inner: NDArray[np.int64], outer: NDArray[np.int64]) -> Array:
    """Where a surface goes down between places and higher ones next to them [m], shape (n, 3)."""
    return np.asarray(np.c_[0.5 * (seen.world(inner) + seen.world(outer)), height[tuple(outer.T)]])


def levels_of(height: Array, pit: Mask) -> tuple[NDArray[np.int64], int]:
    """The level that each place of a pit is on, 0 beyond it, shape (rows, columns), and how many there are."""
    number = np.where(pit, np.cumsum(pit).reshape(pit.shape), 0)
    count = int(pit.sum())
    start, end = [], []
    for near, far in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        alike = pit[near] & pit[far] & (np.abs(height[near] - height[far]) < STEP)
        start.append(number[near][alike])
        end.append(number[far][alike])
    rows, columns = np.concatenate(start), np.concatenate(end)
    link = coo_matrix((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(count + 1, count + 1))
    _, group = connected_components(link, directed=False)
    _, group = np.unique(np.where(np.arange(count + 1) == 0, -1, group), return_inverse=True)
    return group.reshape(-1)[number].astype(np.int64), int(group.max())


def neighbours_of(pit: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of neighbouring places, the first in a pit, each of shape (n, 2)."""
    index = np.argwhere(pit)
    inner = np.concatenate([index] * 4)
    outer = np.concatenate([index + step for step in ((0, 1), (1, 0), (0, -1), (-1, 0))])
    within = ((outer >= 0) & (outer < pit.shape)).all(axis=1)
    return inner[within], outer[within]


def walls_between(
    part: HeightMap, inner: NDArray[np.int64], outer: NDArray[np.int64], drop: Array, caster: Raycaster
) -> Mask:
    """Whether a wall leads down from a place to a lower one next to it, shape (n,)."""
    way = np.c_[(outer - inner).astype(float), np.zeros(len(inner))]
    blocked = np.zeros(len(inner), dtype=int)
    for share in WALL_HEIGHTS:
        height = part.height[tuple(outer.T)] - share * np.minimum(drop, WALL_DEPTH)
        start = np.c_[part.world(inner), height] - 0.5 * part.cell * way
        blocked += caster.occluded(start, way, 2.0 * part.cell)
    return np.asarray(blocked * 2 >= len(WALL_HEIGHTS))


def surface_across(part: HeightMap, pit: Mask) -> Array | None:
    """Heights [m] at a pit's samples, in their order, of the thin plate through its rim; None where the rim is no
    surface: too steep or too uneven."""
    level = float(np.median(part.height[binary_dilation(pit) & ~pit]))
    ring = binary_dilation(pit, iterations=RIM) & ~pit
    size = part.cell * max(float(np.ptp(np.argwhere(pit), axis=0).max()) + 1.0, 2.0 * RIM)
    index = np.argwhere(ring & (np.abs(part.height - level) < STEEPEST * size + DEEP))
    if len(index) < 3 * RIM:
        return None
    index = index[:: max(len(index) // MOST_RIM, 1)]
    points, rim = part.world(index), part.height[tuple(index.T)]
    middle = points.mean(axis=0)
    about = np.c_[points - middle, np.ones(len(points))]
    kept = np.ones(len(points), dtype=bool)
    for _ in range(ROUNDS):  # the hole may cut a gap, whose bottom is no rim
        plane, *_ = np.linalg.lstsq(about[kept], rim[kept], rcond=None)
        off = np.abs(rim - about @ plane)
        kept = off <= max(OUTLYING * float(np.median(off)), DEEP)
    points, rim, off = points[kept], rim[kept], off[kept]
    if np.linalg.matrix_rank(points - points.mean(axis=0)) < 2:
        return None  # what is left of the rim lies on a line
    if np.linalg.norm(plane[:2]) > STEEPEST or np.sqrt((off**2).mean()) > UNEVEN * size + DEEP:
        return None
    across = RBFInterpolator((points - middle) / size, rim, kernel="thin_plate_spline", smoothing=SMOOTH * len(points))
    bulge = 0.5 * np.ptp(rim)
    return np.asarray(
        np.clip(across((part.world(np.argwhere(pit)) - middle) / size), rim.min() - bulge, rim.max() + bulge)
    )


def holes_of(found: Mask, seen: HeightMap) -> list[TornHole]:
    """The holes, one for samples that touch: the last bits of one are found with a wider look than the others."""
    number, _ = label(found, np.ones((3, 3)))
    return [hole_of(place, number[place] == one, seen) for one, place in enumerate(find_objects(number), start=1)]


def hole_of(place: tuple[slice, slice], mask: Mask, seen: HeightMap) -> TornHole:
    """A hole with its size."""
    points = seen.world(np.argwhere(mask) + [side.start for side in place])
    low, high = points.min(axis=0) - 0.5 * seen.cell, points.max(axis=0) + 0.5 * seen.cell
    arm = points - points.mean(axis=0)
    turned = arm @ np.linalg.eigh(arm.T @ arm)[1]
    sides = min((high - low, np.ptp(turned, axis=0) + seen.cell), key=np.prod)
    return TornHole(place, mask, low, high, (float(sides.max()), float(sides.min())))
