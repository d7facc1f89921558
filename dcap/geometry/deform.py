"""Transfers the displacement of a simulated surface to the mesh from which it was made.

In: the whole mesh, the mask of its faces that may follow, and the simulated surface with its displacement. Out: the
mesh, finer where the surface bends, with the displacement of the nearest surface point added. Colours and far faces are
unchanged.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.pieces import welded
from dcap.geometry.raycast import tensor
from dcap.geometry.solid.repair import split_edges
from dcap.scene.types.mesh import Mesh

NEGLIGIBLE = 2e-5  # displacement [m] that no picture shows
FLAT = 5e-6  # a bend [m] over an edge of a few centimetres that shading does not show
CLOSE, FAR = (
    2e-3,
    5e-3,
)  # a vertex this near [m] to the simulated surface follows it; farther ones less, then not at all
MOST_ROUNDS = 10  # maximum number of halvings of an edge: from a 2 m mattress to 2 mm
COARSE = 6.0  # an edge longer than this, over the simulated edges, is split unseen: a dent may lie between its ends


@dataclass(frozen=True, eq=False, slots=True)
class Displaced:
    """A mesh that has followed a surface."""

    mesh: Mesh
    """The mesh, finer where it bends."""
    origin: NDArray[np.int64]
    """The face of the given mesh that each face came from, shape (m,)."""
    shift: NDArray[np.float64]
    """Displacement of each vertex [m], shape (n, 3)."""


def displaced(mesh: Mesh, movable: NDArray[np.bool_], surface: Mesh, displacement: NDArray[np.float64]) -> Displaced:
    """The mesh with its movable faces (m,) following the surface."""
    start = Mesh(surface.vertices - displacement, surface.faces, surface.colors)
    moving = np.linalg.norm(displacement, axis=1)[surface.faces].max(axis=1) > NEGLIGIBLE
    if not moving.any():
        return Displaced(mesh, np.arange(len(mesh.faces)), np.zeros_like(mesh.vertices))
    low, high = start.submesh(np.flatnonzero(moving)).bounds
    edge = float(np.quantile(edge_lengths(start)[moving], 0.25))
    field = DisplacementField(start, displacement)
    fine, origin = refined(mesh, movable, low, high, edge, field)
    used = np.unique(fine.faces[movable[origin]])
    near = used[((fine.vertices[used] >= low - FAR) & (fine.vertices[used] <= high + FAR)).all(axis=1)]
    shift = np.zeros_like(fine.vertices)
    shift[near] = field.at(fine.vertices[near])
    return Displaced(Mesh(fine.vertices + shift, fine.faces, fine.colors), origin, shift)


def following(mesh: Mesh, surface: Mesh, displacement: NDArray[np.float64]) -> Mesh:
    """A mesh moved with the nearest points of a simulated surface: the surface for pictures of a simplified body."""
    start = Mesh(surface.vertices - displacement, surface.faces, surface.colors)
    moved = mesh.vertices + DisplacementField(start, displacement, close=np.inf).at(mesh.vertices)
    return Mesh(moved, mesh.faces, mesh.colors)


def with_own_vertices(mesh: Mesh, some: NDArray[np.bool_]) -> Mesh:
    """The same faces, with some of them (m,) sharing no vertex with the others, so that they can move separately."""
    theirs = np.zeros(len(mesh.vertices), dtype=bool)
    theirs[mesh.faces[~some]] = True
    shared = np.unique(mesh.faces[some][theirs[mesh.faces[some]]])
    if not len(shared):
        return mesh
    number = np.arange(len(mesh.vertices), dtype=np.int32)
    number[shared] = len(mesh.vertices) + np.arange(len(shared), dtype=np.int32)
    faces = np.where(some[:, None], number[mesh.faces], mesh.faces)
    return Mesh(
        np.concatenate([mesh.vertices, mesh.vertices[shared]]), faces,
        np.concatenate([mesh.colors, mesh.colors[shared]]),
    )  # fmt: skip


def edge_lengths(mesh: Mesh) -> NDArray[np.float64]:
    """Longest edge of each face [m], shape (m,)."""
    corner = mesh.triangles
    lengths: NDArray[np.float64] = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).max(axis=1)
    return lengths


class DisplacementField:
    """Displacement of the nearest point of a surface, fading out beyond `close` [m]."""

    def __init__(self, start: Mesh, displacement: NDArray[np.float64], close: float = CLOSE) -> None:
        import open3d

        self._faces, self._displacement, self._close = start.faces, displacement, close
        self._shift = start.bounds.mean(axis=0)
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(tensor(start.vertices - self._shift, np.float32), tensor(start.faces, np.uint32))

    def at(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacement [m] at points (n, 3), of the same shape."""
        corner, weight, fade = self.carriers(points)
        return np.asarray(fade[:, None] * np.einsum("nk,nki->ni", weight, self._displacement[corner]))

    def carriers(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """Carriers of points (n, 3): three surface points each (n, 3), their weights (n, 3), and the fading (n,)."""
        found = self._scene.compute_closest_points(tensor(points - self._shift, np.float32))
        corner = self._faces[found["primitive_ids"].numpy().astype(np.int64)].astype(np.int64)
        u, v = found["primitive_uvs"].numpy().astype(np.float64).T
        weight = np.stack([1.0 - u - v, u, v], axis=1)
        distance = np.linalg.norm(found["points"].numpy() + self._shift - points, axis=1)
        return corner, weight, np.asarray(np.clip(1.0 - (distance - self._close) / (FAR - CLOSE), 0.0, 1.0))

    def bends(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Mask of the pairs of points (n, 3) between which the displacement differs visibly from the mean of both,
        shape (n,)."""
        off = self.at(0.5 * (a + b)) - 0.5 * (self.at(a) + self.at(b))
        return np.asarray(np.linalg.norm(off, axis=1) > FLAT)


def refined(
    mesh: Mesh,
    movable: NDArray[np.bool_],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    edge: float,
    field: DisplacementField,
) -> tuple[Mesh, NDArray[np.int64]]:
    """Movable faces in the box, split to edges of at most `edge` [m] where the field bends, with the origin of each
    face."""
    fresh = in_box(mesh.triangles, low, high) & movable
    region = touching(mesh, fresh)
    part, source, fresh = Mesh(mesh.vertices, mesh.faces[region], mesh.colors), np.flatnonzero(region), fresh[region]
    for _ in range(MOST_ROUNDS):
        candidate = np.flatnonzero(fresh & movable[source])
        corner = part.vertices[part.faces[candidate]]
        inside = in_box(corner, low, high)
        marked = np.zeros(part.faces.shape, dtype=bool)
        marked[candidate[inside]] = edges_to_split(corner[inside], edge, field)
        if not marked.any():
            break
        part, came_from = split_edges(part, marked)
        source = source[came_from]
        fresh = np.bincount(came_from)[came_from] > 1  # faces not split now never will be
    # the vertices of the whole mesh come first in those of the part
    origin = np.concatenate([np.flatnonzero(~region), source])
    order = np.argsort(origin, kind="stable")
    faces = np.concatenate([mesh.faces[~region], part.faces])[order]
    return Mesh(part.vertices, faces, part.colors), origin[order]


def in_box(corner: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the triangles (n, 3, 3) whose bounding boxes meet a box, shape (n,)."""
    return np.asarray(((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1))


def touching(mesh: Mesh, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask of the faces that share a corner with some faces (m,), including those, shape (m,)."""
    corner = welded(mesh.vertices)[mesh.faces]
    theirs = np.zeros(len(mesh.vertices), dtype=bool)
    theirs[corner[some]] = True
    return np.asarray(theirs[corner].any(axis=1))


def edges_to_split(corner: NDArray[np.float64], edge: float, field: DisplacementField) -> NDArray[np.bool_]:
    """Mask of the edges of triangles (n, 3, 3) that are long, or longer than `edge` [m] where the field bends, shape
    (n, 3)."""
    after = np.roll(corner, -1, axis=1)
    length = np.linalg.norm(corner - after, axis=2)
    split = np.asarray(length > COARSE * edge)
    doubtful = ~split & (length > 1.5 * edge)
    split[doubtful] = field.bends(corner[doubtful], after[doubtful])
    return split
