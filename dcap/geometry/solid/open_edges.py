"""Where a surface that is seen from above ends in the air: the edges of one face only.

In: the faces of a thing, welded or not. Out: whether points lie at such an edge. A thing that is closed has none,
however thin it is; the lower border of a side that was not scanned further is none: it is not seen from above.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.pieces import welded
from dcap.scene.types.mesh import Mesh

SEEN = 0.3  # vertical component of the unit normal of a face, either way, whose edges are seen from above
MOST_POINTS = 2_000_000  # along all edges: beyond, they lie farther apart


class OpenEdges:
    """The edges of one face only, as points at most `spacing` [m] apart."""

    def __init__(self, mesh: Mesh, spacing: float) -> None:
        points = points_along(mesh, spacing)
        self._tree = cKDTree(points) if len(points) else None

    def near(self, points: Array, reach: float) -> NDArray[np.bool_]:
        """Which points (n, 3) lie within `reach` [m] of an open edge, shape (n,)."""
        if self._tree is None or len(points) == 0:
            return np.zeros(len(points), dtype=bool)
        return np.asarray(np.isfinite(self._tree.query(points, distance_upper_bound=reach)[0]))


def points_along(mesh: Mesh, spacing: float) -> Array:
    """Points along the open edges of faces that do not stand upright [m], shape (n, 3)."""
    place = welded(mesh.vertices)[mesh.faces]
    _, once = np.unique(np.sort(place, axis=1), axis=0, return_index=True)  # a sheet may have both its sides
    edge = place[once][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    number = np.sort(edge, axis=1) @ (int(place.max(initial=0)) + 1, 1)
    _, group, count = np.unique(number, return_inverse=True, return_counts=True)
    normal = mesh.face_normals[once]
    flat = np.abs(normal[:, 2]) > SEEN * np.maximum(np.linalg.norm(normal, axis=1), np.finfo(float).tiny)
    open_ = (count[group.reshape(-1)] == 1) & (edge[:, 0] != edge[:, 1]) & np.repeat(flat, 3)
    start, end = np.swapaxes(mesh.vertices[mesh.faces[once][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)[open_]], 0, 1)
    length = np.linalg.norm(end - start, axis=1)
    steps = np.ceil(length / max(spacing, float(length.sum()) / MOST_POINTS)).astype(int) + 1
    share = np.arange(steps.sum()) - np.repeat(np.cumsum(steps) - steps, steps)
    along = share / np.repeat(np.maximum(steps - 1, 1), steps)
    return np.asarray(np.repeat(start, steps, axis=0) + along[:, None] * np.repeat(end - start, steps, axis=0))
