"""Surfaces for the page: with normals and textures, and a limited number of faces.

In: meshes of the pipeline and their paint. Out: `DrawnSurface`, and meshes with fewer faces.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.rendering.surface import ShadingNormals
from dcap.scene.types.mesh import CornerPaint, Mesh, PaintedMesh

Number = TypeVar("Number", bound=np.generic)
MOST_ROUNDS = 20
"""Most rounds in which cells grow to reduce the number of faces [-]."""
GROWTH = 1.25


@dataclass(frozen=True, eq=False, slots=True)
class DrawnSurface:
    """Triangles with normals, and perhaps with textures."""

    mesh: Mesh
    normals: NDArray[np.float32]
    """Unit normals at the corners of the faces, shape (m, 3, 3)."""
    paint: CornerPaint | None = None
    """None: the vertex colours say all."""

    def colored(self, colors: NDArray[np.uint8]) -> "DrawnSurface":
        """The surface in other vertex colours (n, 3), without textures."""
        return DrawnSurface(replace(self.mesh, colors=colors), self.normals)


def drawn(thing: PaintedMesh, faces: NDArray[np.integer], normals: NDArray[np.float32] | None = None) -> DrawnSurface:
    """Some faces of a surface; `normals` (m, 3, 3) are those of all its corners, if they are known."""
    if normals is None:
        normals = ShadingNormals(thing.mesh).of_corners(faces)
    part = thing.submesh(faces)
    return DrawnSurface(part.mesh, normals[faces], part.paint)


def whole(thing: PaintedMesh) -> DrawnSurface:
    """All faces of a surface."""
    every = np.arange(len(thing.mesh.faces))
    return DrawnSurface(thing.mesh, ShadingNormals(thing.mesh).of_corners(every), thing.paint)


def upright_normals(mesh: Mesh) -> NDArray[np.float64]:
    """Return the normals of the vertices; z where a vertex has none, shape (n, 3)."""
    normals = mesh.vertex_normals
    normals[(normals == 0.0).all(axis=1)] = (0.0, 0.0, 1.0)
    return normals


def seen_from(thing: PaintedMesh, some: NDArray[np.bool_], point: NDArray[np.float64]) -> PaintedMesh:
    """The surface with some faces (m,) wound so that they are visible from a point [m], as for an open shell of a
    room."""
    mesh, paint = thing.mesh, thing.paint
    away = some & (np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles.mean(axis=1) - point) > 0.0)

    def turned(corners: NDArray[Number]) -> NDArray[Number]:
        after = corners.copy()
        after[away] = corners[away][:, ::-1]
        return after

    if paint is not None:
        uv, tint = turned(paint.corner_uv), turned(paint.corner_tint)
        paint = replace(paint, corner_uv=uv, corner_tint=tint)
    return PaintedMesh(replace(mesh, faces=turned(mesh.faces)), paint)


def thinned(mesh: Mesh, kept: NDArray[np.bool_], most: int) -> tuple[Mesh, NDArray[np.int64]]:
    """A mesh of about `most` faces, and the face that each came from; faces that are `kept` (m,) stay as they are.

    Vertices are merged in the cells of a grid, which grow until few enough faces are left: fast on millions of
    faces, and every face stays one of its instance and part.
    """
    own = np.arange(len(mesh.faces), dtype=np.int64)
    if len(own) <= most:
        return mesh, own
    loose = np.flatnonzero(~kept)
    fixed = np.zeros(len(mesh.vertices), dtype=bool)
    fixed[mesh.faces[kept]] = True
    budget = max(most - int(kept.sum()), 1)
    low = mesh.vertices.min(axis=0)
    size = float(np.sqrt(2.0 * mesh.face_areas[loose].sum() / budget))  # about two faces for each cell of the surface
    for _ in range(MOST_ROUNDS):
        group = groups(mesh.vertices, low, size, fixed)
        faces = group[mesh.faces[loose]]
        a, b, c = faces.T
        left = (a != b) & (b != c) & (c != a)
        if left.sum() <= budget:
            break
        size *= GROWTH
    representative = np.zeros(group.max() + 1, dtype=np.int64)
    representative[group[::-1]] = np.arange(len(group))[::-1]  # the first vertex of each cell
    faces = mesh.faces.astype(np.int64)
    faces[loose] = representative[group[mesh.faces[loose]]]
    chosen = np.sort(np.concatenate([np.flatnonzero(kept), loose[left]]))
    used, inverse = np.unique(faces[chosen], return_inverse=True)
    few = Mesh(mesh.vertices[used], inverse.reshape(-1, 3).astype(np.int32), mesh.colors[used])
    return few, chosen


def groups(
    vertices: NDArray[np.float64], low: NDArray[np.float64], size: float, fixed: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Number of the cell of each vertex; fixed vertices have cells of their own, shape (n,)."""
    cell = np.floor((vertices - low) / size).astype(np.int64)
    count = cell.max(axis=0) + 1
    key = (cell[:, 0] * count[1] + cell[:, 1]) * count[2] + cell[:, 2]
    key[fixed] = int(count.prod()) + np.flatnonzero(fixed)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)
