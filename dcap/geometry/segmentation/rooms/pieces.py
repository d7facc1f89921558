"""Supporting patches and the surfaces below them: divides a fused scan into pieces that can carry something.

In a scan that has made one surface of floor, furniture and clutter, the relevant primitive is the upward patch that
could carry something. Every patch owns the surface that hangs down from it: its sides and legs, reached over the
surface without climbing. Surfaces that no patch reaches (a thin back, a lamp) form separate pieces. Nothing is named
here.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from dcap.arrays import Array, IntArray
from dcap.geometry.segmentation.faces import connected_regions
from dcap.geometry.segmentation.rooms.contacts import VOXEL, Surfels

LEVEL = 0.8
"""Least normal z of a carrying surface [-]: 37 degrees from the vertical."""
SLOPE = 0.4
"""Largest slope between neighbouring surfels of a patch [-], in addition to NOISE."""
NOISE = 0.008
"""Largest difference in height between neighbouring surfels of one level [m]: the noise of phones and headsets."""
LEAST_PATCH = 0.02
"""Smallest patch, seen from above [m^2]: a stack of books."""
FLOORING = 0.06
"""Largest height above the floor of upward surfels that are the floor, or lie flat on it [m]."""
LEAST_FLAT = 0.25
"""Smallest area of a thing that lies flat on the floor [m^2]: a bath mat."""
RAISED = 0.005
"""Least height above the floor of such a thing [m]."""
REACH = 1.6
"""Longest path from a patch to a surface that hangs down from it [m]: from a desk's top to its feet, with some
margin."""
CLIMB = 4.0
"""Additional length of a path per metre of climb [-]."""
ABOVE = 0.05
"""Height above a patch beyond which surfels do not hang down from it [m]."""
OUTWARD = (0.06, 0.10)
"""Largest distance of hanging surfels outside their patch: a constant [m] and a share of the height below it [-]."""
LEAST_REST = 0.02
"""Surface of the smallest piece without a patch [m^2]."""
SIDEWAYS = 0.6
"""Least normal z of floor in the vicinity of the floor [-]."""
SMOOTH = 0.7
"""Least cosine between the normals of neighbours in one piece without a patch [-]: the front of a wardrobe ends at the
wall next to it."""
APART = 0.10
"""Least difference between levels of one rough patch that are the tops of two things, or of a thing and its back
[m]."""
BAND = 0.02
"""Step of height in the search for such levels [m]."""
LEVEL_SHARE = 0.1
"""Least share of the patch in each of its levels, seen from above [-]."""
VALLEY = 0.5
"""Largest share, between two levels, of the smaller level at one height [-]: with more it is one slope."""
ROUNDS = 3
"""Rounds in which surfels that a patch reached but may not keep are offered to the others [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Pieces:
    """Pieces of a fused scan."""

    owner: IntArray
    """Index of the piece of each surfel, -1 for none, shape (n,)."""
    patches: int
    """Number of pieces with a supporting patch, which come first, the largest first."""
    count: int
    level: Array
    """Height of each patch: the 95th percentile of its surfels [m], shape (patches,)."""


def carrying_pieces(surfels: Surfels, floor: float) -> Pieces:
    """Patches with the surfaces that hang down from them, then the rest; `floor` is its height [m]."""
    patch, count = _patches(surfels, floor)
    level = np.array([np.percentile(surfels.position[patch == i, 2], 95.0) for i in range(count)])
    owner = _hanging(surfels, patch, level)
    z = surfels.position[:, 2]
    owner[(patch < 0) & (z < floor + FLOORING) & (surfels.normal[:, 2] > SIDEWAYS)] = -1
    _drop_far(surfels, owner, patch, level)
    total = _add_rest(surfels, owner, count, floor)
    return Pieces(owner, count, total, level)


def _patches(surfels: Surfels, floor: float) -> tuple[IntArray, int]:
    """Index of the patch of each surfel, -1 for none, the largest first, and the number of patches."""
    z = surfels.position[:, 2]
    chosen = np.flatnonzero((surfels.normal[:, 2] > LEVEL) & (z > floor + RAISED))
    high = z[chosen] > floor + FLOORING
    number = np.full(len(z), -1)
    number[chosen] = np.arange(len(chosen))
    pairs = number[surfels.pairs]
    pairs = pairs[(pairs >= 0).all(axis=1)]
    a, b = surfels.position[chosen[pairs[:, 0]]], surfels.position[chosen[pairs[:, 1]]]
    across = np.linalg.norm((a - b)[:, :2], axis=1)
    joined = (np.abs(a[:, 2] - b[:, 2]) < SLOPE * across + NOISE) & (high[pairs[:, 0]] == high[pairs[:, 1]])
    region = connected_regions(len(chosen), pairs, joined)
    region = _levelled(surfels.position[chosen], pairs[joined], region)
    area = _plan_areas(surfels.position[chosen], region)
    low = np.ones(len(area), dtype=bool)
    low[region[high]] = False
    large = np.flatnonzero(area > np.where(low, LEAST_FLAT, LEAST_PATCH))
    large = large[np.argsort(-area[large], kind="stable")]
    rank = np.full(len(area), -1)
    rank[large] = np.arange(len(large))
    result = np.full(len(z), -1, dtype=np.int64)
    result[chosen] = rank[region]
    return result, len(large)


def _levelled(position: Array, pairs: IntArray, region: IntArray) -> IntArray:
    """The regions, shape (n,), cut where one of them has several levels: in a rough scan a ramp joins the back of a
    sofa to the table next to it. Surfels between two levels are not a patch, and hang from the higher one; surfels
    below or above all levels belong to the one nearest over the surface."""
    level = np.full(len(region), -1, dtype=np.int64)
    between = np.zeros(len(region), dtype=bool)
    count = 0
    order = np.argsort(region, kind="stable")
    for mine in np.split(order, np.flatnonzero(np.diff(region[order])) + 1):
        bands = _bands_of(position[mine])
        for low, high in bands:
            on = mine[(position[mine, 2] >= low) & (position[mine, 2] < high)]
            level[on] = count
            count += 1
        for (_, low), (high, _) in pairwise(bands):
            between[mine[(position[mine, 2] >= low) & (position[mine, 2] < high)]] = True
    if not count:
        return region
    inside = level[pairs]
    same = (inside[:, 0] == inside[:, 1]) & (inside[:, 0] >= 0)
    seed = connected_regions(len(region), pairs, same)
    area = _plan_areas(position, seed)
    seeds = np.flatnonzero((level >= 0) & (area[seed] > LEAST_PATCH))
    length = np.linalg.norm(np.diff(position[pairs], axis=1)[:, 0], axis=1) + 1e-6
    n = len(region)
    graph = coo_matrix((length, (pairs[:, 0], pairs[:, 1])), shape=(n, n)).tocsr()
    distance, _, origin = dijkstra(graph, directed=False, indices=seeds, min_only=True, return_predecessors=True)
    result = region.astype(np.int64)
    reached = np.isfinite(distance)
    result[reached] = int(region.max()) + 1 + seed[origin[reached]]
    result[between] = int(result.max()) + 1 + np.arange(int(between.sum()))
    return np.asarray(np.unique(result, return_inverse=True)[1], dtype=np.int64)


def _bands_of(position: Array) -> list[tuple[float, float]]:
    """Bounds of each level, [low, high) in metres, if there are several; else empty."""
    z = position[:, 2]
    if len(z) < 2 or np.ptp(z) < APART:
        return []
    first = float(z.min())
    band = np.floor((z - first) / BAND).astype(np.int64)
    total = np.convolve(np.bincount(band), np.ones(3), mode="same")
    peaks: list[int] = []
    for one in np.argsort(-total, kind="stable"):
        apart = all(abs(int(one) - other) * BAND > APART for other in peaks)
        if (
            total[one] > LEVEL_SHARE * len(z)
            and apart
            and all(
                total[min(one, other) : max(one, other) + 1].min() < VALLEY * min(total[one], total[other])
                for other in peaks
            )
        ):
            peaks.append(int(one))
    return [(first + (one - 1) * BAND, first + (one + 2) * BAND) for one in sorted(peaks)] if len(peaks) > 1 else []


def _plan_areas(position: Array, region: IntArray) -> Array:
    """Area of each region seen from above [m^2], by cells, so that rough surfaces do not count more."""
    cell = np.floor(position[:, :2] / (1.5 * VOXEL)).astype(np.int64)
    seen = np.unique(np.c_[region, cell], axis=0)
    count = np.bincount(seen[:, 0], minlength=int(region.max(initial=-1)) + 1)
    return np.asarray(count * (1.5 * VOXEL) ** 2, dtype=np.float64)


def _hanging(surfels: Surfels, patch: IntArray, level: Array) -> IntArray:
    """The patch from which each surfel hangs down, -1 for none, shape (n,)."""
    n, owner = len(patch), patch.copy()
    if not (patch >= 0).any():
        return owner
    step = surfels.position[surfels.pairs[:, 1]] - surfels.position[surfels.pairs[:, 0]]
    length = np.linalg.norm(step, axis=1)
    start, end = np.r_[surfels.pairs[:, 0], surfels.pairs[:, 1]], np.r_[surfels.pairs[:, 1], surfels.pairs[:, 0]]
    way = np.r_[length, length] + CLIMB * np.maximum(np.r_[step[:, 2], -step[:, 2]], 0.0) + 1e-6
    for _ in range(ROUNDS):
        free = owner[end] < 0
        graph = coo_matrix((way[free], (start[free], end[free])), shape=(n, n)).tocsr()
        source = np.flatnonzero(owner >= 0)
        distance, _, origin = dijkstra(
            graph, directed=True, indices=source, min_only=True, return_predecessors=True, limit=REACH
        )
        reached = np.flatnonzero(np.isfinite(distance) & (owner < 0))
        wanted = owner[origin[reached]]
        kept = surfels.position[reached, 2] < level[wanted] + ABOVE
        owner[reached[kept]] = wanted[kept]
        if kept.all():
            break
    return owner


def _drop_far(surfels: Surfels, owner: IntArray, patch: IntArray, level: Array) -> None:
    """Drop surfels too far outside the patch of their piece, seen from above: floor and wall fused by the scan."""
    order = np.argsort(owner, kind="stable")
    order = order[np.searchsorted(owner[order], 0) :]
    for i, mine in enumerate(np.split(order, np.searchsorted(owner[order], np.arange(1, len(level))))):
        top = mine[patch[mine] == i]
        if len(mine) and len(top):
            away = cKDTree(surfels.position[top, :2]).query(surfels.position[mine, :2])[0]
            below = np.maximum(level[i] - surfels.position[mine, 2], 0.0)
            owner[mine[away > OUTWARD[0] + OUTWARD[1] * below]] = -1


def _add_rest(surfels: Surfels, owner: IntArray, count: int, floor: float) -> int:
    """Number the surfels that no patch owns by smooth pieces, the largest first; returns the new number of pieces."""
    rest = (owner < 0) & (surfels.position[:, 2] > floor + FLOORING)
    a, b = surfels.pairs.T
    alike = np.einsum("ki,ki->k", surfels.normal[a], surfels.normal[b]) > SMOOTH
    joined = np.asarray(rest[a] & rest[b] & alike, dtype=bool)
    region = connected_regions(len(owner), surfels.pairs, joined)
    area = np.bincount(region, surfels.area * rest)
    large = np.flatnonzero(area > LEAST_REST)
    rank = np.full(len(area), -1)
    rank[large[np.argsort(-area[large], kind="stable")]] = count + np.arange(len(large))
    owner[rest] = rank[region[rest]]
    return count + len(large)
