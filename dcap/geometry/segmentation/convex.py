"""Over-segmentation of a fused surface: smooth patches, joined where they meet in a ridge and not in a groove.

Where a scan has made one surface of things that touch, they still meet in grooves: a lamp and its table, a bed and the
floor. Patches grow by [F04] over the graph of faces, as ScanNet's segments do; neighbours whose common border is convex
are one piece [S14].

[F04] Felzenszwalb, Huttenlocher: Efficient graph-based image segmentation. IJCV 59(2), 2004.
[S14] Stein, Schoeler, Papon, Woergoetter: Object partitioning using local convexity. CVPR 2014.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import FaceTable, connected_regions, pairs_among, renumbered

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SMOOTHING = 4
"""Rounds in which a face takes over the mean normal of its neighbours: scans are rough [-]."""
SCALE = 0.05
"""Preference for large patches, k of [F04], for weights of 1 - cosine [-]."""
SMALLEST = 60
"""Patches of fewer faces join their nearest neighbour [-]."""
GROOVE = np.deg2rad(12.0)
"""Borders that fold inwards by more than this on average are grooves [rad]."""


def convex_pieces(table: FaceTable, faces: Index) -> Index:
    """Number of the piece of each of the given faces (k,), shape (k,)."""
    pairs = pairs_among(table.pairs, faces, len(table.area))
    normal = _smoothed(table.normal[faces], table.area[faces], pairs)
    fold = _fold(table.center[faces], normal, pairs)
    weight = 1.0 - np.cos(fold)
    weight = np.where(fold > 0.0, weight * weight, weight)  # ridges hardly separate
    patch = grown(len(faces), pairs, weight, SCALE, SMALLEST)
    return _joined_at_ridges(patch, pairs, fold)


def _smoothed(normal: Array, area: Array, pairs: Index) -> Array:
    """Normals averaged over neighbouring faces, shape (k, 3)."""
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    result = normal
    for _ in range(SMOOTHING):
        total = area[:, None] * result
        for axis in range(3):
            total[:, axis] += np.bincount(a, area[b] * result[b, axis], len(normal))
        result = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)
    return result


def _fold(center: Array, normal: Array, pairs: Index) -> Array:
    """Angle between the normals of neighbours [rad], negative in grooves, shape (e,)."""
    a, b = pairs.T
    angle = np.arccos(np.clip(np.einsum("ei,ei->e", normal[a], normal[b]), -1.0, 1.0))
    ridge = np.einsum("ei,ei->e", normal[b] - normal[a], center[b] - center[a])
    return np.asarray(np.where(ridge >= 0.0, angle, -angle))


def grown(count: int, pairs: Index, weight: Array, scale: float, smallest: int) -> Index:
    """Patches of a weighted graph [F04, Alg. 1], shape (count,); those below `smallest` join a neighbour."""
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


def _joined_at_ridges(patch: Index, pairs: Index, fold: Array) -> Index:
    """Patches whose common border is no groove on average become one, shape (k,)."""
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
