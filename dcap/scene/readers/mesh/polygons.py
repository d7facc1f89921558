"""Polygons to triangles: convex ones as fans, concave ones by constrained triangulation of their plane."""

import manifold3d
import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError

MOST_CORNERS = 4096
"""Of a concave polygon: the triangulation takes memory with the square of their number, 16 bytes each."""


def triangulate(
    vertices: NDArray[np.float64], polygons: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangulate polygons of one corner count.

    Returns corner triples (t, 3) that index the corners 0..k-1 of each polygon, and the polygon (t,) of each.
    """
    count, corners = polygons.shape
    fan = np.array([[0, i, i + 1] for i in range(1, corners - 1)], dtype=np.int64).reshape(-1, 3)
    triples = np.broadcast_to(fan, (count, len(fan), 3)).copy()
    owner = np.repeat(np.arange(count), len(fan))
    if corners == 3:
        return triples.reshape(-1, 3), owner
    points = vertices[polygons]
    normals = _newell_normals(points)
    for index in np.flatnonzero(_concave(points, normals)):
        triples[index] = _cut_concave(points[index], normals[index], fan)
    return triples.reshape(-1, 3), owner


def _newell_normals(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Area vectors of polygons (p, k, 3) by Newell's sum, shape (p, 3)."""
    shifted = points - points[:, :1]
    return np.asarray(np.cross(shifted, np.roll(shifted, -1, axis=1)).sum(axis=1))


def _concave(points: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which polygons have a corner that turns against their normal, shape (p,)."""
    edges = np.roll(points, -1, axis=1) - points
    turn = np.cross(np.roll(edges, 1, axis=1), edges)
    along = np.einsum("pki,pi->pk", turn, normals)
    scale = np.einsum("pi,pi->p", normals, normals)[:, None]
    return np.asarray((along < -1e-9 * scale).any(axis=1))


def _cut_concave(points: NDArray[np.float64], normal: NDArray[np.float64], fan: NDArray[np.int64]) -> NDArray[np.int64]:
    """Corner triples of one concave polygon; the fan where the outline crosses itself."""
    if len(points) > MOST_CORNERS:
        raise GeometryError(f"a concave face has {len(points)} corners > {MOST_CORNERS}; cut it into triangles")
    across = np.linalg.svd(normal[None, :])[2][1:]
    if np.dot(np.cross(across[0], across[1]), normal) < 0:
        across = across[::-1]
    flat = points @ across.T
    triangles = np.asarray(manifold3d.triangulate([flat]), dtype=np.int64)
    return triangles if triangles.shape == fan.shape else fan
