"""Cuts of a face set by colour, and the merging of crumbs into their neighbours."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import connected_regions, renumbered

COLOR_STEP = 18.0
"""Colours farther apart than this belong to different materials [CIELAB]; wood grain and fabric stay below."""

MAX_COLORS = 6
"""Materials told apart in one thing [-]."""

LLOYD_ROUNDS = 12
"""Rounds of k-means; it has converged by then for so few clusters [-]."""


def color_clusters(lab: NDArray[np.float64], area: NDArray[np.float64]) -> NDArray[np.int64]:
    """Materials by colour: k-means with as many seeds as lie farther than `COLOR_STEP` apart, shape (k,)."""
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
    """Area-weighted k-means from given centres."""
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
    """Give every small region to the neighbour that it shares most edges with, until none has one, shape (k,)."""
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
    """For each region the neighbour with most shared edges, itself where it has none, shape (count,)."""
    key, shared = np.unique(a * count + b, return_counts=True)
    order = np.lexsort((key, -shared))
    source, neighbour = key[order] // count, key[order] % count
    target = np.arange(count)
    first = np.unique(source, return_index=True)[1]
    target[source[first]] = neighbour[first]
    return target


def _followed(target: NDArray[np.int64]) -> NDArray[np.int64]:
    """Chains of targets followed to their end; a cycle (two equal crumbs) is broken at its smallest member."""
    loop = target[target] == np.arange(len(target))
    target = np.where(loop, np.minimum(target, np.arange(len(target))), target)
    for _ in range(len(target).bit_length() + 1):
        target = target[target]
    return target


def majority(
    label: NDArray[np.int64], area: NDArray[np.float64], pairs: NDArray[np.int64], *, rounds: int
) -> NDArray[np.int64]:
    """Smooth a labelling: each face takes the label that its neighbours and itself carry most, shape (k,)."""
    count = int(label.max(initial=0)) + 1
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    for _ in range(rounds):
        votes = np.bincount(a * count + label[b], area[b], len(label) * count).reshape(-1, count)
        votes[np.arange(len(label)), label] = votes[np.arange(len(label)), label] + area
        label = np.argmax(votes, axis=1)
    return label
