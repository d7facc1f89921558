"""Rays against a triangle mesh: where they hit first, and whether something is in their way.

In: a mesh and rays in its frame. Out: hits with geometric normals as wound in the mesh. A surface is hit from both
sides. Ray tracing is Embree's, in single precision: hits are accurate to about 1e-6 of the distance.
"""

from dataclasses import dataclass

import numpy as np
import open3d
from numpy.typing import NDArray

from dcap.scene.types.mesh import Mesh

FloatArray = NDArray[np.floating]


@dataclass(frozen=True, eq=False, slots=True)
class Hits:
    """First hits of n rays."""

    distance: NDArray[np.float64]
    """Distance along the ray [m], inf on a miss, shape (n,)."""
    face: NDArray[np.int32]
    """Index of the face hit, -1 on a miss, shape (n,)."""
    normal: NDArray[np.float64]
    """Unit geometric normal as wound, zero on a miss, shape (n, 3)."""
    position: NDArray[np.float64]
    """Hit point [m], nan on a miss, shape (n, 3)."""
    barycentric: NDArray[np.float64]
    """Weights of the face's three corners, shape (n, 3)."""


class Raycaster:
    """A mesh prepared for many rays; holds the acceleration structure."""

    def __init__(self, mesh: Mesh) -> None:
        self._empty = len(mesh.faces) == 0
        self._scene = open3d.t.geometry.RaycastingScene()
        if not self._empty:
            self._scene.add_triangles(tensor(mesh.vertices, np.float32), tensor(mesh.faces, np.uint32))

    def cast(self, origins: FloatArray, directions: FloatArray) -> Hits:
        """First hits of rays with origins [m] and unit directions, each of shape (n, 3)."""
        count = len(origins)
        if self._empty or count == 0:
            return misses(count)
        found = self._scene.cast_rays(rays(origins, directions))
        distance = found["t_hit"].numpy().astype(np.float64)
        hit = np.isfinite(distance)
        face = np.where(hit, found["primitive_ids"].numpy().astype(np.int64), -1).astype(np.int32)
        normal = np.where(hit[:, None], found["primitive_normals"].numpy(), 0.0).astype(np.float64)
        u, v = found["primitive_uvs"].numpy().astype(np.float64).T
        position = np.full((count, 3), np.nan)
        position[hit] = origins[hit] + distance[hit, None] * directions[hit]
        return Hits(distance, face, normal, position, np.stack([1.0 - u - v, u, v], axis=1))

    def occluded(
        self, origins: FloatArray, directions: FloatArray, distance: float | FloatArray = np.inf
    ) -> NDArray[np.bool_]:
        """Which rays hit anything nearer than `distance` [m] (a number or shape (n,)), shape (n,)."""
        count = len(origins)
        if self._empty or count == 0:
            return np.zeros(count, dtype=bool)
        limit = np.asarray(distance, dtype=np.float32)
        if limit.ndim == 0:
            blocked = self._scene.test_occlusions(rays(origins, directions), 0.0, float(limit))
            return np.asarray(blocked.numpy(), dtype=bool)
        # rays scaled by their own limit reach it at t = 1
        blocked = self._scene.test_occlusions(rays(origins, directions * limit[:, None]), 0.0, 1.0)
        return np.asarray(blocked.numpy(), dtype=bool)


def misses(count: int) -> Hits:
    """Hits of rays that meet nothing."""
    return Hits(
        np.full(count, np.inf),
        np.full(count, -1, dtype=np.int32),
        np.zeros((count, 3)),
        np.full((count, 3), np.nan),
        np.zeros((count, 3)),
    )


def rays(origins: FloatArray, directions: FloatArray) -> open3d.core.Tensor:
    """Origins and directions as the six columns that the ray tracer wants."""
    packed = np.empty((len(origins), 6), dtype=np.float32)
    packed[:, :3], packed[:, 3:] = origins, directions
    return open3d.core.Tensor.from_numpy(packed)


def tensor(array: NDArray[np.generic], kind: type[np.generic]) -> open3d.core.Tensor:
    """An array of the wanted type, without a copy where it has it."""
    return open3d.core.Tensor.from_numpy(np.ascontiguousarray(array, dtype=kind))
