"""Shading normals: smooth where a surface bends gently, sharp where it has an edge.

In: a mesh, welded or not, wound consistently or not. Out: unit normals per face corner. A face averages its
neighbours' normals at each corner, weighted by area and by how little they turn against its own.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.boundary import welded
from dcap.scene.types.mesh import Mesh

SHARP_COS, SMOOTH_COS = 0.5, 0.85  # 60 degrees and more: an edge; 32 degrees and less: a bend; blended in between


class ShadingNormals:
    """Corner normals of a mesh, computed for the faces that are asked for and kept."""

    def __init__(self, mesh: Mesh) -> None:
        area_normal = mesh.face_normals
        self._length = np.sqrt(np.einsum("ij,ij->i", area_normal, area_normal))
        self._unit = area_normal / np.maximum(self._length, 1e-300)[:, None]
        self._corner = welded(mesh.vertices)[mesh.faces]
        self._order = np.argsort(self._corner.ravel(), kind="stable")
        self._start = np.concatenate([[0], np.cumsum(np.bincount(self._corner.ravel()))])
        self._known = np.zeros(len(mesh.faces), dtype=bool)
        self._normal = np.zeros((len(mesh.faces), 3, 3), dtype=np.float32)

    def of_corners(self, face: NDArray[np.integer]) -> NDArray[np.float32]:
        """Unit normals at the three corners of all faces, shape (m, 3, 3); made for the faces (n,) and earlier ones."""
        wanted = np.zeros(len(self._known), dtype=bool)
        wanted[face] = True
        fresh = np.flatnonzero(wanted & ~self._known)
        if len(fresh):
            self._normal[fresh] = self._averaged(fresh)
            self._known[fresh] = True
        return self._normal

    def _averaged(self, face: NDArray[np.integer]) -> NDArray[np.float32]:
        """Weighted means over the faces around each corner."""
        vertex = self._corner[face].ravel()
        count = self._start[vertex + 1] - self._start[vertex]
        own = np.repeat(np.repeat(face, 3), count)
        slot = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        other = self._order[np.repeat(self._start[vertex], count) + slot] // 3
        cos = np.einsum("ij,ij->i", self._unit[own], self._unit[other])
        weight = self._length[other] * np.sign(cos)  # a neighbour wound the other way counts turned around
        weight *= np.clip((np.abs(cos) - SHARP_COS) / (SMOOTH_COS - SHARP_COS), 0.0, 1.0)
        target = np.repeat(np.arange(len(vertex)), count)
        parts = [np.bincount(target, weight * self._unit[other, a], minlength=len(vertex)) for a in range(3)]
        total = np.stack(parts, axis=1)
        size = np.sqrt(np.einsum("ij,ij->i", total, total))[:, None]
        total = np.divide(total, size, out=np.repeat(self._unit[face], 3, axis=0), where=size > 0.0)
        return np.asarray(total.reshape(-1, 3, 3), dtype=np.float32)
