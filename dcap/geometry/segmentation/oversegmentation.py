"""Over-segmentation of surfaces: smooth patches that meet in ridges, regions of one colour, merged crumbs.

Over-segmentation of a fused surface: smooth patches, joined where they meet in a ridge and not in a groove.

Things that touch are fused into one surface by a scan, but still meet in grooves: a lamp and its table, a bed and the
floor. Patches grow by [F04] over the graph of faces, like ScanNet's segments; neighbours whose common border is convex
are one piece [S14].

[F04] Felzenszwalb, Huttenlocher: Efficient graph-based image segmentation. IJCV 59(2), 2004.
[S14] Stein, Schoeler, Papon, Woergoetter: Object partitioning using local convexity. CVPR 2014.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.geometry.segmentation.faces import FaceTable, connected_regions, pairs_among, renumbered

SMOOTHING = 4
"""Number of rounds in which a face takes the mean normal of its neighbours: scans are rough [-]."""
SCALE = 0.05
"""Preference for large patches, k of [F04], for weights of 1 - cosine [-]."""
SMALLEST = 60
"""Least number of faces of a patch; smaller ones join their nearest neighbour [-]."""
GROOVE = np.deg2rad(12.0)
"""Least mean inward fold of a border that is a groove [rad]."""
COLOR_STEP = 18.0
"""Difference of colours above which they belong to different materials [CIELAB]; wood grain and fabric stay below."""

MAX_COLORS = 6
"""Maximum number of materials distinguished in one thing [-]."""

LLOYD_ROUNDS = 12
"""Rounds of k-means, which has converged by then for so few clusters [-]."""


def convex_pieces(table: FaceTable, faces: IntArray) -> IntArray:
    """Index of the piece of each of the given faces (k,), shape (k,)."""
    pairs = pairs_among(table.pairs, faces, len(table.area))
    normal = _smoothed(table.normal[faces], table.area[faces], pairs)
    fold = _fold(table.center[faces], normal, pairs)
    weight = 1.0 - np.cos(fold)
    weight = np.where(fold > 0.0, weight * weight, weight)  # ridges hardly separate
    patch = grown(len(faces), pairs, weight, SCALE, SMALLEST)
    return _joined_at_ridges(patch, pairs, fold)


def _smoothed(normal: Array, area: Array, pairs: IntArray) -> Array:
    """Normals averaged over neighbouring faces, shape (k, 3)."""
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    result = normal
    for _ in range(SMOOTHING):
        total = area[:, None] * result
        for axis in range(3):
            total[:, axis] += np.bincount(a, area[b] * result[b, axis], len(normal))
        result = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)
    return result


def _fold(center: Array, normal: Array, pairs: IntArray) -> Array:
    """Angle between the normals of neighbours [rad], negative in grooves, shape (e,)."""
    a, b = pairs.T
    angle = np.arccos(np.clip(np.einsum("ei,ei->e", normal[a], normal[b]), -1.0, 1.0))
    ridge = np.einsum("ei,ei->e", normal[b] - normal[a], center[b] - center[a])
    return np.asarray(np.where(ridge >= 0.0, angle, -angle))


def grown(count: int, pairs: IntArray, weight: Array, scale: float, smallest: int) -> IntArray:
    """Index of the patch of each node of a weighted graph [F04, Alg. 1], shape (count,); patches below `smallest` join
    a neighbour."""
    parent = list(range(count))
    size = [1] * count
    limit = [scale] * count

    def root(i: int) -> int:
        while parent[i] != i:
            parent[i] = parent[parent[i]]
            i = parent[i]
        return i

    order = np.argsort(weight, kind="stable")
    edges = list(zip(pairs[order, 0].tolist(), pairs[order, 1].tolist(), weight[order].tolist(), strict=True))
    for least in (0, smallest):
        for a, b, w in edges:
            i, j = root(a), root(b)
            if i == j or not ((w <= limit[i] and w <= limit[j]) if least == 0 else min(size[i], size[j]) < least):
                continue
            if size[i] < size[j]:
                i, j = j, i
            parent[j] = i
            size[i] += size[j]
            limit[i] = max(w, 0.0) + scale / size[i]
    return renumbered(np.array([root(i) for i in range(count)], dtype=np.int64))


def _joined_at_ridges(patch: IntArray, pairs: IntArray, fold: Array) -> IntArray:
    """Patches merged where their common border is on average not a groove, shape (k,)."""
    a, b = patch[pairs[:, 0]], patch[pairs[:, 1]]
    border = a != b
    low, high = np.minimum(a, b)[border], np.maximum(a, b)[border]
    count = int(patch.max(initial=-1)) + 1
    key, inverse = np.unique(low * count + high, return_inverse=True)
    mean = np.bincount(inverse, fold[border]) / np.bincount(inverse)
    smooth = mean > -GROOVE
    edges = np.stack([key // count, key % count], axis=1)[smooth]
    joined = connected_regions(count, edges, np.ones(len(edges), dtype=bool))
    return renumbered(joined[patch])


def color_clusters(lab: NDArray[np.float64], area: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the material by colour: k-means with as many seeds as are farther than `COLOR_STEP` apart, shape
    (k,)."""
    seeds = [lab[int(np.argmin(((lab - np.average(lab, axis=0, weights=area + 1e-12)) ** 2).sum(axis=1)))]]
    while len(seeds) < MAX_COLORS:
        distance = np.min([np.linalg.norm(lab - seed, axis=1) for seed in seeds], axis=0)
        # The farthest tenth of a per cent of the area may be specks of noise.
        order = np.argsort(distance)
        beyond = np.cumsum(area[order][::-1]) > 0.01 * area.sum()
        far = int(order[::-1][int(np.argmax(beyond))])
        if distance[far] < COLOR_STEP:
            break
        seeds.append(lab[far])
    return _lloyd(lab, area, np.array(seeds))


def _lloyd(lab: NDArray[np.float64], area: NDArray[np.float64], centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """Centres of area-weighted k-means from given centres."""
    label = np.zeros(len(lab), dtype=np.int64)
    for _ in range(LLOYD_ROUNDS):
        label = np.argmin(((lab[:, None, :] - centers[None]) ** 2).sum(axis=2), axis=1)
        weight = np.bincount(label, area, len(centers))
        sums = np.stack([np.bincount(label, area * lab[:, i], len(centers)) for i in range(3)], axis=1)
        centers = np.where(weight[:, None] > 0, sums / np.maximum(weight, 1e-12)[:, None], centers)
    return label


def color_regions(
    lab: NDArray[np.float64], area: NDArray[np.float64], pairs: NDArray[np.int64], *, smallest: float
) -> NDArray[np.int64]:
    """Connected patches of one material; patches below `smallest` [share of the area] join a neighbour, shape (k,)."""
    cluster = color_clusters(lab, area)
    region = connected_regions(len(lab), pairs, cluster[pairs[:, 0]] == cluster[pairs[:, 1]])
    return merged_crumbs(region, area, pairs, smallest=smallest)


def merged_crumbs(
    region: NDArray[np.int64], area: NDArray[np.float64], pairs: NDArray[np.int64], *, smallest: float
) -> NDArray[np.int64]:
    """Regions where every small region has joined the neighbour with most shared edges, repeatedly, shape (k,)."""
    region = renumbered(region)
    for _ in range(8):
        count = int(region.max(initial=-1)) + 1
        size = np.bincount(region, area, count)
        a, b = region[pairs].T
        a, b = np.r_[a, b], np.r_[b, a]
        crossing = (a != b) & (size[a] < smallest * area.sum()) & (size[b] >= size[a])
        if not crossing.any():
            break
        target = _most_shared(a[crossing], b[crossing], count)
        region = renumbered(_followed(target)[region])
    return region


def _most_shared(a: NDArray[np.int64], b: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """For each region the neighbour with most shared edges, or itself if it has none, shape (count,)."""
    key, shared = np.unique(a * count + b, return_counts=True)
    order = np.lexsort((key, -shared))
    source, neighbour = key[order] // count, key[order] % count
    target = np.arange(count)
    first = np.unique(source, return_index=True)[1]
    target[source[first]] = neighbour[first]
    return target


def _followed(target: NDArray[np.int64]) -> NDArray[np.int64]:
    """Chains of targets followed to their end; a cycle (two equal crumbs) ends at its smallest member."""
    loop = target[target] == np.arange(len(target))
    target = np.where(loop, np.minimum(target, np.arange(len(target))), target)
    for _ in range(len(target).bit_length() + 1):
        target = target[target]
    return target


def majority(
    label: NDArray[np.int64], area: NDArray[np.float64], pairs: NDArray[np.int64], *, rounds: int
) -> NDArray[np.int64]:
    """A smoothed labelling: each face takes the most frequent label among its neighbours and itself, shape (k,)."""
    count = int(label.max(initial=0)) + 1
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    for _ in range(rounds):
        votes = np.bincount(a * count + label[b], area[b], len(label) * count).reshape(-1, count)
        votes[np.arange(len(label)), label] = votes[np.arange(len(label)), label] + area
        label = np.argmax(votes, axis=1)
    return label
