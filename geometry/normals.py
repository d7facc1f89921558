"""Shading normals: smooth where a surface bends gently, sharp where it has an edge.

In: a mesh, welded or not, wound consistently or not. Out: unit normals per face corner. A face averages its neighbours' normals
at each corner, weighted by area and by how little they turn against its own.
"""

import numpy as np
from numpy.typing import NDArray

from scene.mesh import Mesh

WELD = 1e-6  # vertices nearer than this [m] are one: duplicates at texture seams are exact, real detail is far larger
SHARP_COS, SMOOTH_COS = 0.5, 0.85  # 60 degrees and more: an edge; 32 degrees and less: a bend; blended in between


def welded(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of the distinct position of each vertex, shape (n,): equal after rounding to WELD."""
    steps = np.round(vertices / WELD).astype(np.int64).astype(np.uint64)
    with np.errstate(over="ignore"):
        key = steps[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        key ^= (steps[:, 1] + np.uint64(0x7F4A7C15)) * np.uint64(0xC2B2AE3D27D4EB4F)
        key ^= (steps[:, 2] + np.uint64(0x165667B1)) * np.uint64(0x27D4EB2F165667C5)
        key ^= key >> np.uint64(29)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def corner_normals(mesh: Mesh, wanted: NDArray[np.integer]) -> NDArray[np.float32]:
    """Unit shading normals at the three corners of the wanted faces, shape (len(wanted), 3, 3)."""
    area_normal = mesh.face_normals
    length = np.linalg.norm(area_normal, axis=1)
    unit = np.divide(area_normal, length[:, None], out=np.zeros_like(area_normal), where=length[:, None] > 0.0)
    corner = welded(mesh.vertices)[mesh.faces]
    order = np.argsort(corner.ravel(), kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(corner.ravel()))])
    vertex = corner[wanted].ravel()
    count = start[vertex + 1] - start[vertex]
    own = np.repeat(np.repeat(wanted, 3), count)
    slot = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    other = order[np.repeat(start[vertex], count) + slot] // 3
    cos = np.einsum("ij,ij->i", unit[own], unit[other])
    weight = length[other] * np.clip((np.abs(cos) - SHARP_COS) / (SMOOTH_COS - SHARP_COS), 0.0, 1.0) * np.sign(cos)
    target = np.repeat(np.arange(len(vertex)), count)
    total = np.stack([np.bincount(target, weight * unit[other, a], minlength=len(vertex)) for a in range(3)], axis=1)
    size = np.linalg.norm(total, axis=1, keepdims=True)
    total = np.divide(total, size, out=np.repeat(unit[wanted], 3, axis=0), where=size > 0.0)
    return total.astype(np.float32).reshape(-1, 3, 3)
