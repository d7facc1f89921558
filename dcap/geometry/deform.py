"""Carry the displacement of a simulated surface over to the mesh that it was cut from.

In: the whole mesh, which of its faces may follow, and the simulated surface with its displacement. Out: the mesh,
finer where it bends, with the displacement of the nearest surface point added. Colours and far faces stay as they
are.
"""

import numpy as np
import open3d
from numpy.typing import NDArray

from dcap.geometry.raycast import tensor
from dcap.geometry.solid.repair import split_edges
from dcap.scene.types.mesh import Mesh

NEGLIGIBLE = 2e-5  # displacement [m] that no picture shows
CLOSE, FAR = (
    2e-3,
    5e-3,
)  # a vertex this near [m] to the simulated surface follows it; farther ones less, then not at all
MOST_ROUNDS = 10  # halvings of an edge: from a 2 m mattress to 2 mm


def displaced(
    mesh: Mesh, movable: NDArray[np.bool_], surface: Mesh, displacement: NDArray[np.float64]
) -> tuple[Mesh, NDArray[np.int64]]:
    """The mesh with its movable faces (m,) following the surface, and the face of the given mesh that each face
    came from.
    """
    start = Mesh(surface.vertices - displacement, surface.faces, surface.colors)
    moving = np.linalg.norm(displacement, axis=1)[surface.faces].max(axis=1) > NEGLIGIBLE
    if not moving.any():
        return mesh, np.arange(len(mesh.faces))
    low, high = start.submesh(np.flatnonzero(moving)).bounds
    edge = float(np.quantile(edge_lengths(start)[moving], 0.25))
    fine, origin = refined(mesh, movable, low, high, edge)
    used = np.unique(fine.faces[movable[origin]])
    near = used[((fine.vertices[used] >= low - FAR) & (fine.vertices[used] <= high + FAR)).all(axis=1)]
    vertices = fine.vertices.copy()
    vertices[near] += interpolated(start, displacement, vertices[near])
    return Mesh(vertices, fine.faces, fine.colors), origin


def following(mesh: Mesh, surface: Mesh, displacement: NDArray[np.float64]) -> Mesh:
    """A mesh that moves with the nearest points of a simulated surface: the picture's surface of a simplified body."""
    start = Mesh(surface.vertices - displacement, surface.faces, surface.colors)
    moved = mesh.vertices + interpolated(start, displacement, mesh.vertices, close=np.inf)
    return Mesh(moved, mesh.faces, mesh.colors)


def edge_lengths(mesh: Mesh) -> NDArray[np.float64]:
    """Longest edge of each face [m], shape (m,)."""
    corner = mesh.triangles
    lengths: NDArray[np.float64] = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).max(axis=1)
    return lengths


def refined(
    mesh: Mesh, movable: NDArray[np.bool_], low: NDArray[np.float64], high: NDArray[np.float64], edge: float
) -> tuple[Mesh, NDArray[np.int64]]:
    """Movable faces in the box split to edges of at most `edge` [m]; with each face's origin."""
    origin = np.arange(len(mesh.faces))
    for _ in range(MOST_ROUNDS):
        corner = mesh.triangles
        near = ((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1) & movable[origin]
        length = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
        long = near[:, None] & (length > 1.5 * edge)
        if not long.any():
            break
        mesh, came_from = split_edges(mesh, long)
        origin = origin[came_from]
    return mesh, origin


def interpolated(
    start: Mesh, displacement: NDArray[np.float64], points: NDArray[np.float64], close: float = CLOSE
) -> NDArray[np.float64]:
    """Displacement at points (n, 3): that of the nearest surface point, fading out beyond `close` [m]."""
    shift = start.bounds.mean(axis=0)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(start.vertices - shift, np.float32), tensor(start.faces, np.uint32))
    found = scene.compute_closest_points(tensor(points - shift, np.float32))
    corner = start.faces[found["primitive_ids"].numpy().astype(np.int64)]
    u, v = found["primitive_uvs"].numpy().astype(np.float64).T
    weight = np.stack([1.0 - u - v, u, v], axis=1)
    distance = np.linalg.norm(found["points"].numpy() + shift - points, axis=1)
    fade = np.clip(1.0 - (distance - close) / (FAR - CLOSE), 0.0, 1.0)
    return np.asarray(fade[:, None] * np.einsum("nk,nki->ni", weight, displacement[corner]))
