"""Heights of a surface seen from above, and the holes that a scan has torn into it.

In: faces of one thing. Out: heights on a regular grid, holes in them with their sizes, and the height of the surface
that closes each from its rim. A hole is a pit whose rim ends in the air: faces end there without neighbours, and no
wall leads down to its bottom, as one does in a tub or between two cushions. A closed mesh has no such holes, even if it
is as thin as a slat. The rim must surround the hole and be about as flat as a surface: the gap between a seat and a
back is no hole.
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

MARGIN = 2  # samples added to a map on each side
ABOVE = 0.05  # rays begin this far above the surface [m]
DEEP = 0.01  # least depth of a hole below its rim [m]: less is a dent, or scan noise
STEP = 0.02  # neighbouring places whose heights differ by less than this [m] are on one level
WIDTHS = (0.03, 0.08, 0.2, 0.5)  # largest widths of the pits in each search [m], small ones first
ENCLOSED = 0.92  # least share of a hole's border that has a higher surface beyond it
TORN = 0.6  # least share of that border at which faces end and no wall leads down
NEAR_EDGE = 2.0  # largest distance from a drop in the surface to its open edge [samples]
WALL_DEPTH = 0.04  # largest depth of the search for a wall [m]
WALL_HEIGHTS = (0.25, 0.5, 0.75)  # shares of this depth at which rays search for it
STEEPEST = 1.0  # largest slope of the plane through a hole's rim [-]: beyond 45 degrees it is a side of the thing
UNEVEN = 0.2  # largest root mean square distance of a rim from its plane, as a share of its size [-]
LARGEST_SHARE = 0.5  # largest share of a thing's plan that a hole covers; a larger one is the opening of a frame
BROADEST = 0.3  # largest length of a hole with an upward surface below it [m]
RIM = 3  # width of the ring around a hole that determines its surface [samples]
TINY = 6  # a pit with at most this many samples is a crack, too small for any object
ROUNDS, OUTLYING = 3, 4.0  # in each round, samples farther off the plane than this many medians are dropped
MOST_RIM = 300  # approximate number of rim samples that are used
SMOOTH = 1e-3  # smoothing of the closing surface, because single rim samples carry the scan's noise [-]


@dataclass(frozen=True, eq=False, slots=True)
class HeightMap:
    """A surface seen from above."""

    origin: Array
    """World xy of sample (0, 0) [m], shape (2,)."""
    cell: float
    """Distance of neighbouring samples [m]."""
    height: Array
    """Height of the top surface [m], -inf where there is none, shape (rows, columns)."""
    face: NDArray[np.int64]
    """Face of that surface, -1 for none, shape (rows, columns)."""

    def world(self, index: NDArray[np.integer]) -> Array:
        """World xy of samples (n, 2) [m], shape (n, 2)."""
        return np.asarray(self.origin + self.cell * index)


@dataclass(frozen=True, eq=False, slots=True)
class TornHole:
    """A hole of a scan, closed from its rim."""

    place: tuple[slice, slice]
    """Rows and columns of the map that it lies in."""
    mask: Mask
    """Mask of the hole within them."""
    low: Array
    """Lower corner of its box in plan [m], shape (2,)."""
    high: Array
    """Upper corner [m], shape (2,)."""
    sides: tuple[float, float]
    """Length and width of the smallest rectangle in plan about it [m]."""


def spacing_within(sides: Array, finest: float, most: int, margin: int) -> float:
    """Spacing of the samples of a rectangle with these sides (2,) [m], `margin` more on each side: at least `finest`
    [m], and for at most `most` samples."""
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
    """The map of a mesh with its holes closed, and the holes; their faces stay those that are seen through them."""
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
                    part.height[hole] = closed  # a view: this changes the whole map
                    found[window] |= hole
    height[height <= floor] = -np.inf
    return HeightMap(seen.origin, seen.cell, height, seen.face), holes_of(found, seen)


def is_a_place(hole: Mask, carrying: Mask, cell: float) -> bool:
    """Whether a hole is a surface of its own, such as a seat whose sides a scan does not show: it is broad, and most of
    its faces look up. A torn hole shows the backs of faces, or nothing."""
    broad = cell * float(np.ptp(np.argwhere(hole), axis=0).max() + 1) > BROADEST
    return broad and float(carrying[hole].mean()) > 0.5


def closed_over(height: Array, width: int) -> Array:
    """Heights with all pits of at most `width` samples filled [m], shape (rows, columns)."""
    padded = np.pad(height, width, mode="edge")
    return np.asarray(grey_closing(padded, size=(width + 1, width + 1))[width:-width, width:-width])


def windows(number: NDArray[np.integer]) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """For each numbered place a window, RIM samples wider, and the place's mask in it; without places at the map's
    border."""
    for one, place in enumerate(find_objects(number), start=1):
        if place is None:
            continue
        if all(side.start > 0 and side.stop < size for side, size in zip(place, number.shape, strict=True)):
            rows, columns = (slice(max(side.start - RIM, 0), side.stop + RIM) for side in place)
            yield (rows, columns), number[rows, columns] == one


def torn_off(part: HeightMap, pit: Mask, caster: Raycaster, edges: OpenEdges) -> Iterator[Mask]:
    """Masks (rows, columns) of the holes in a pit, around which the surface ends in the air.

    The samples of a pit form levels. A level below walls or slopes, such as the gap between two cushions, is no hole,
    but a hole may border on it; levels that border only on holes belong to them.
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
    """Mask of the tiny numbered places around which faces end, shape (rows, columns)."""
    inner, outer = neighbours_of(tiny)
    down = height[tuple(outer.T)] - height[tuple(inner.T)] > DEEP
    inner, outer = inner[down], outer[down]
    own, count = number[tuple(inner.T)], int(number.max(initial=0)) + 1
    free = np.bincount(own, edges.near(brinks(seen, height, inner, outer), NEAR_EDGE * seen.cell), count)
    return np.asarray(tiny & (free >= TORN * np.maximum(np.bincount(own, minlength=count), 1))[number])


def brinks(seen: HeightMap, height: Array, inner: NDArray[np.int64], outer: NDArray[np.int64]) -> Array:
    """Points where a surface drops from higher samples to their neighbours [m], shape (n, 3)."""
    return np.asarray(np.c_[0.5 * (seen.world(inner) + seen.world(outer)), height[tuple(outer.T)]])


def levels_of(height: Array, pit: Mask) -> tuple[NDArray[np.int64], int]:
    """Number of each sample's level in a pit, 0 outside the pit, shape (rows, columns), and the number of levels."""
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
    """Heights [m] of the thin plate through a pit's rim at the pit's samples, in order; None if the rim is too steep or
    too uneven for a surface."""
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
        return None  # the rest of the rim lies on a line
    if np.linalg.norm(plane[:2]) > STEEPEST or np.sqrt((off**2).mean()) > UNEVEN * size + DEEP:
        return None
    across = RBFInterpolator((points - middle) / size, rim, kernel="thin_plate_spline", smoothing=SMOOTH * len(points))
    bulge = 0.5 * np.ptp(rim)
    return np.asarray(
        np.clip(across((part.world(np.argwhere(pit)) - middle) / size), rim.min() - bulge, rim.max() + bulge)
    )


def holes_of(found: Mask, seen: HeightMap) -> list[TornHole]:
    """The holes, one per group of touching samples, because searches with different widths find parts of the same
    hole."""
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
