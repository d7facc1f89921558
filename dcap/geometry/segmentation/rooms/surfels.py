"""A scanned surface as surfels: small discs, one per voxel and side, whatever the triangles are like.

Scans have slivers, holes, doubled sheets and millions of faces. What is asked of them here (what looks up, what is
near, how large is it) is asked of at most one disc per voxel and side [P00], with normals averaged over neighbours.

[P00] Pfister, Zwicker, van Baar, Gross: Surfels: surface elements as rendering primitives. SIGGRAPH 2000.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.segmentation.faces import FaceTable, surface_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

VOXEL = 0.02
"""Edge of a voxel [m]: what scans resolve, and finer than what carries."""
NEAR = 2.25 * VOXEL
"""Surfels this near are neighbours [m]: the next but one voxel, so that a missing one is bridged."""
SIDE = 0.5
"""Least normal z of a surfel that looks up, its negative of one that looks down [-]."""
SAME_SIDE = 0.3
"""Cosine from which on a neighbour's normal is averaged with one's own [-]."""
ROUNDS = 2
"""Of averaging [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Surfels:
    """Discs that stand for a surface."""

    position: Array
    """[m], shape (n, 3)."""
    normal: Array
    """Unit normals averaged over neighbours, shape (n, 3)."""
    area: Array
    """[m^2], shape (n,)."""
    lab: Array
    """Mean colour in CIELAB, shape (n, 3)."""
    pairs: Index
    """Neighbours, shape (e, 2)."""
    face: Index
    """Faces that they stand for, one entry per sample of the surface, shape (k,)."""
    of_sample: Index
    """The surfel of each sample, shape (k,)."""
    sample_area: Array
    """Area that a sample stands for [m^2], shape (k,)."""

    def faces_of(self, owner: Index, count: int) -> Index:
        """Owner of each of `count` faces by that of most of its surface, -1 for none; `owner` of shape (n,), -1: none.

        Shape (count,).
        """
        mine = owner[self.of_sample]
        most = int(owner.max(initial=-1)) + 2
        key, inverse = np.unique(self.face * most + mine + 1, return_inverse=True)
        area = np.bincount(inverse, self.sample_area, len(key))
        order = np.lexsort((-area, key // most))
        first = np.r_[True, np.diff(key[order] // most) > 0] if len(key) else np.zeros(0, dtype=bool)
        best = key[order][first]
        result = np.full(count, -1, dtype=np.int64)
        result[best // most] = best % most - 1
        return result


def surfels_of(table: FaceTable, faces: Index) -> Surfels:
    """Surfels of the given faces, shape (f,)."""
    points, owner = surface_points(table.corners[faces], table.area[faces], VOXEL)
    face = faces[owner]
    weight = table.area[face] / np.bincount(owner, minlength=len(faces))[owner] + 1e-15
    number = _numbers(points, table.normal[face])
    total = np.bincount(number, weight).astype(np.float64)
    position = _mean(number, weight, points) / total[:, None]
    normal = _unit(_mean(number, weight, table.normal[face]))
    lab = _mean(number, weight, table.lab[face]) / total[:, None]
    pairs = cKDTree(position).query_pairs(NEAR, output_type="ndarray").astype(np.int64)
    return Surfels(position, _averaged(normal, total, pairs), total, lab, pairs, face, number, weight)


def _numbers(points: Array, normal: Array) -> Index:
    """A number per voxel and side, shape (k,)."""
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    cell = np.floor(points / VOXEL).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    side = np.where(normal[:, 2] > SIDE, 0, np.where(normal[:, 2] < -SIDE, 1, 2))
    key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 3 + side
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def _mean(number: Index, weight: Array, values: Array) -> Array:
    """Weighted sums of rows (k, 3) per number, shape (n, 3)."""
    return np.stack([np.bincount(number, weight * values[:, axis]) for axis in range(3)], axis=1)


def _averaged(normal: Array, area: Array, pairs: Index) -> Array:
    """Normals averaged over neighbours that look the same way, shape (n, 3)."""
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    alike = np.einsum("ki,ki->k", normal[a], normal[b]) > SAME_SIDE
    a, b = a[alike], b[alike]
    result = normal
    for _ in range(ROUNDS):
        total = area[:, None] * result
        for axis in range(3):
            total[:, axis] += np.bincount(a, area[b] * result[b, axis], len(normal))
        result = _unit(total)
    return result


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30))
