"""Tetrahedra of the slab, finest at the middle of its top; numpy only."""

import numpy as np
from numpy.typing import NDArray

from perf.peers.reference import SLAB

LARGEST = 0.03
"""Largest cell [m]."""


def spaced(length: float, cell: float, growth: float) -> NDArray[np.float64]:
    """Distances from 0 to `length` [m], the first `cell` apart, growing geometrically; shape (n,)."""
    steps = [cell]
    while sum(steps) < length:
        steps.append(min(steps[-1] * growth, LARGEST))
    places: NDArray[np.float64] = np.concatenate([[0.0], np.cumsum(steps)])
    places *= length / places[-1]
    return places


def tetrahedra(count_x: int, count_y: int, count_z: int) -> NDArray[np.int64]:
    """Node indices of five tetrahedra per box of a grid, mirrored from box to box so that faces match, shape (n, 4)."""
    boxes = np.indices((count_x - 1, count_y - 1, count_z - 1)).reshape(3, -1)
    bits = np.indices((2, 2, 2)).reshape(3, -1)  # corner 4 a + 2 b + c lies at (a, b, c)
    corner = np.ravel_multi_index(tuple(boxes[:, :, None] + bits[:, None, :]), (count_x, count_y, count_z))
    inner = np.array([[0, 3, 5, 6]])
    cut_off = np.array([[1, 0, 3, 5], [2, 0, 3, 6], [4, 0, 5, 6], [7, 3, 5, 6]])
    even = np.concatenate([inner, cut_off])
    odd = even ^ 1  # mirrored along z
    tets: NDArray[np.int64] = np.where((boxes.sum(axis=0) % 2 == 0)[:, None, None], corner[:, even], corner[:, odd])
    return tets.reshape(-1, 4)


def slab(cell: float, growth: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Nodes [m] and tetrahedra of positive volume of a slab that is finest at the middle of its top."""
    half = spaced(SLAB[0] / 2, cell, growth)
    across = np.concatenate([-half[:0:-1], half])
    up = SLAB[2] - spaced(SLAB[2], cell, growth)[::-1]
    up[0] = 0.0
    nodes = np.stack(np.meshgrid(across, across, up, indexing="ij"), axis=-1).reshape(-1, 3)
    tets = tetrahedra(len(across), len(across), len(up))
    edges = nodes[tets[:, 1:]] - nodes[tets[:, :1]]
    inverted = np.linalg.det(edges) < 0
    tets[inverted] = tets[inverted][:, [0, 2, 1, 3]]
    return nodes, tets


def lumped(nodes: NDArray[np.float64], tets: NDArray[np.int64]) -> NDArray[np.float64]:
    """Volume of every node [m^3], shape (n,): a quarter of each tetrahedron that it is a corner of."""
    volume = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]]) / 6
    shares = np.zeros(len(nodes))
    np.add.at(shares, tets, volume[:, None] / 4)
    return shares
