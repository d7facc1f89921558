"""Surfaces with the flaws of scans: sheets on a grid of faces, holes, scraps, patches wound the wrong way round."""

import numpy as np
import trimesh
from numpy.typing import NDArray

from dcap.scene.types.mesh import Mesh


def fine_box(low: tuple[float, float, float], high: tuple[float, float, float], rounds: int = 5) -> Mesh:
    """A closed box of small faces."""
    mesh = trimesh.creation.box(np.subtract(high, low))
    for _ in range(rounds):
        mesh = mesh.subdivide()
    return Mesh.of(np.asarray(mesh.vertices) + 0.5 * np.add(low, high), np.asarray(mesh.faces))


def ball(radius: float = 0.1) -> Mesh:
    """A closed ball about the origin."""
    mesh = trimesh.creation.icosphere(4, radius)
    return Mesh.of(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def where(mesh: Mesh, keep: NDArray[np.bool_]) -> Mesh:
    """Some of the faces."""
    return mesh.submesh(np.flatnonzero(keep))


def middles(mesh: Mesh) -> NDArray[np.float64]:
    """Middles of faces, shape (m, 3)."""
    return np.asarray(mesh.triangles.mean(axis=1))


def normals(mesh: Mesh) -> NDArray[np.float64]:
    """Unit normals of faces, shape (m, 3)."""
    return np.asarray(mesh.face_normals / np.linalg.norm(mesh.face_normals, axis=1, keepdims=True))


def with_hole(mesh: Mesh, at: tuple[float, float], size: tuple[float, float]) -> Mesh:
    """Without the faces that look up in a rectangle in plan."""
    inside = (np.abs(middles(mesh)[:, :2] - at) < 0.5 * np.array(size)).all(axis=1)
    return where(mesh, ~(inside & (normals(mesh)[:, 2] > 0.5)))


def scrap(at: tuple[float, float, float]) -> Mesh:
    """Two faces of 2 cm."""
    corner = np.array([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0.005], [0, 0.02, 0]])
    return Mesh.of(corner + np.array(at), [[0, 1, 2], [0, 2, 3]])


def turned(mesh: Mesh, which: NDArray[np.bool_]) -> Mesh:
    """With some faces wound the other way round."""
    faces = mesh.faces.copy()
    faces[which] = faces[which][:, ::-1]
    return Mesh.of(mesh.vertices, faces)
