"""An object's surface as Gaussians: flat discs in its colours, close enough together to be opaque.

Unlike `on_mesh`, whose splats imitate a scan, these are all alike and dense: what is behind them does not show through.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.raycast import tensor
from dcap.geometry.splatting.on_mesh import even_points, quaternions_along
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

FaceColors = Callable[[NDArray[np.int64], Array], Array]
"""sRGB colours 0 to 1 (n, 3) at faces (n,) and barycentric weights (n, 3)."""

OVERLAP = 0.8
"""Standard deviation along the surface over the distance of neighbours [-]."""
FLATNESS = 0.1
"""Standard deviation along the normal over that along the surface [-]."""
OPACITY = 0.99
"""Largest opacity that renderers take from one Gaussian [-]."""
ROUNDS, NEAR_BY = 6, 8
"""How often discs are pushed apart, and by how many around each [-]."""
PUSH, RADIUS = 0.15, 1.2
"""How far of the way, and from nearer than this many spacings [-]: in a regular lattice they are 1.07 apart."""
DETAIL = 400.0
"""The object's diagonal over the distance of discs [-]: two pixels of the close-up, which shows the whole object."""
MOST = 300_000
"""Discs of one object [-]; of more surface they are larger."""


def disc_spacing(mesh: Mesh) -> float:
    """Distance of discs [m] by the object's size, but no more than MOST of them."""
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    return max(size / DETAIL, float(np.sqrt(mesh.face_areas.sum() / MOST)))


def discs_on(mesh: Mesh, spacing: float, colors: FaceColors | None = None) -> Gaussians:
    """Discs about `spacing` [m] apart on a mesh, in its vertices' colours or others; same input, same bytes."""
    area = mesh.face_areas
    count = max(round(float(area.sum()) / spacing**2), 1)
    face, weight = relaxed(mesh, *even_points(area, count, np.random.default_rng(0)), spacing)
    color = (colors or vertex_colors(mesh))(face, weight)
    normal = mesh.face_normals[face] / np.maximum(2.0 * area[face], 1e-30)[:, None]
    size = np.log(spacing * OVERLAP * np.array([1.0, 1.0, FLATNESS]))
    return Gaussians(
        np.einsum("nk,nki->ni", weight, mesh.corners(face)).astype(np.float32),
        np.tile(size.astype(np.float32), (count, 1)),
        quaternions_along(normal, np.zeros(count)).astype(np.float32),
        np.full(count, np.log(OPACITY / (1.0 - OPACITY)), dtype=np.float32),
        ((color - 0.5) / DC).astype(np.float32),
        np.zeros((count, 3, 0), dtype=np.float32),
    )


def relaxed(mesh: Mesh, face: NDArray[np.int64], weight: Array, spacing: float) -> tuple[NDArray[np.int64], Array]:
    """The same number of points on a mesh, pushed apart where they are nearer than others on their side of it."""
    import open3d

    scene, middle = open3d.t.geometry.RaycastingScene(), mesh.bounds.mean(axis=0)
    corner = mesh.vertices - middle
    scene.add_triangles(tensor(corner), tensor(mesh.faces, np.uint32))
    unit = mesh.face_normals / np.maximum(np.linalg.norm(mesh.face_normals, axis=1, keepdims=True), 1e-30)
    for _ in range(ROUNDS):
        place = np.einsum("nk,nki->ni", weight, corner[mesh.faces[face]])
        distance, near = cKDTree(place).query(place, k=NEAR_BY + 1)
        away = place[:, None] - place[near[:, 1:]]
        distance = np.maximum(distance[:, 1:], 1e-3 * spacing)
        same = np.einsum("ni,nki->nk", unit[face], unit[face[near[:, 1:]]]) > 0.0
        push = np.where(same, np.maximum(RADIUS * spacing / distance - 1.0, 0.0), 0.0)
        step = PUSH * np.einsum("nk,nki->ni", push, away)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(0.5 * spacing / np.maximum(length, 1e-30), 1.0)
        found = scene.compute_closest_points(tensor(place + step))
        face = found["primitive_ids"].numpy().astype(np.int64)
        u, v = found["primitive_uvs"].numpy().astype(np.float64).T
        weight = np.stack([1.0 - u - v, u, v], axis=1)
    return face, weight


def vertex_colors(mesh: Mesh) -> FaceColors:
    """The colours of a mesh's vertices, linear over each face."""

    def colors(face: NDArray[np.int64], weight: Array) -> Array:
        return np.asarray(np.einsum("nk,nkc->nc", weight, mesh.colors[mesh.faces[face]] / 255.0))

    return colors
