"""Content of a mesh file before its unit, axes and colours are determined, and its polygons as triangles.

`RawMesh` is returned by every format reader; `paint.py` bakes its textures and `frame.py` converts it to metres and z
up. Invariant: finite vertices, indices in range, at least one face.

`triangulate` cuts convex polygons into fans, and concave ones by constrained triangulation in their plane.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import manifold3d
import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.types.mesh import Paint

MAX_FACES = 4_000_000
"""Maximum number of faces of a file [-]. Reading and cleaning take 0.5 KB for a plain face and 1.6 KB for a textured
one at the peak (measured on a million): 6.4 GB at worst, which fits into a machine of 8 GiB. SuGaR's largest meshes
have half as many."""

MAX_CORNERS = 3 * MAX_FACES
"""Maximum number of vertices, or of values of one accessor, of a file [-]: as if no two faces shared a corner."""
MOST_CORNERS = 4096
"""Maximum number of corners of a concave polygon: the triangulation takes 16 bytes times its square."""


@dataclass(frozen=True, eq=False, slots=True)
class RawMesh:
    """Triangles in the file's own units and axes."""

    path: Path
    """The file, for messages."""
    vertices: NDArray[np.float64]
    """Positions [file units], shape (n, 3)."""
    faces: NDArray[np.int64]
    """Counter-clockwise vertex indices, shape (m, 3)."""
    colors: NDArray[np.uint8] | None
    """sRGB vertex colours, shape (n, 3)."""
    paint: Paint | None
    face_node: NDArray[np.int32]
    """Index into `node_names`, -1 for none, shape (m,)."""
    node_names: tuple[str, ...]
    """Names of the nodes; an ancestor and its descendant are joined by '/'."""
    up: str
    """Up axis by the format's standard: y or z; empty if the format has none."""
    unit_metres: float
    """Length unit by the format's standard [m]; 0 if the format has none."""
    notes: tuple[str, ...]
    node_labels: tuple[str | None, ...] = ()
    """Annotated label of each node's instance, as in `Scan`; empty: the file has no annotations."""
    of_splats: bool = False
    """Whether faces only represent Gaussians: they have a place and a direction, but no outer side."""

    def __post_init__(self) -> None:
        if not len(self.vertices) or not len(self.faces):
            raise InputError(f"{self.path}: no faces ({len(self.vertices)} vertices); a surface is needed")
        if not np.isfinite(self.vertices).all():
            bad = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
            more = f" ({len(bad) - 1} more like it)" if len(bad) > 1 else ""
            raise FormatError(f"{self.path}: vertex {bad[0]} is not finite: {self.vertices[bad[0]].tolist()}{more}")
        low, high = int(self.faces.min()), int(self.faces.max())
        if low < 0 or high >= len(self.vertices):
            raise FormatError(
                f"{self.path}: a face uses vertex {low if low < 0 else high}, the file has {len(self.vertices)}"
            )
        self._check_area()

    def without_loose_vertices(self) -> "RawMesh":
        """A copy without vertices that no face uses: they are not a surface, but would count in the size of the
        thing."""
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.faces] = True
        if used.all():
            return self
        colors = None if self.colors is None else self.colors[used]
        place = np.cumsum(used) - 1
        return replace(self, vertices=self.vertices[used], faces=place[self.faces], colors=colors)

    def _check_area(self) -> None:
        """Refuse a mesh without any surface, the sign of a failed decoder."""
        if self.degenerate.all():
            raise FormatError(f"{self.path}: all {len(self.faces)} faces have zero area")

    @property
    def degenerate(self) -> NDArray[np.bool_]:
        """Mask of the faces without area, shape (m,)."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        low, high = (np.stack([end(corner, axis=0) for corner in (a, b, c)]) for end in (np.min, np.max))
        extent = float((high.max(axis=0) - low.min(axis=0)).max())
        # A sliver of relative area 1e-14 is below the rounding of float64 coordinates.
        return np.asarray(~(twice_area > 1e-14 * extent * extent))


def unnamed_mesh(
    path: Path, vertices: NDArray[np.floating], faces: NDArray[np.int64], *, colors: NDArray[np.uint8] | None = None,
    paint: Paint | None = None, notes: tuple[str, ...] = (), of_splats: bool = False,
) -> RawMesh:  # fmt: skip
    """The mesh of a file without nodes, unit and up axis."""
    return RawMesh(
        path=path, vertices=vertices.astype(np.float64), faces=faces, colors=colors, paint=paint,
        face_node=np.full(len(faces), -1, dtype=np.int32), node_names=(), up="", unit_metres=0.0, notes=notes,
        of_splats=of_splats,
    )  # fmt: skip


def squares(
    path: Path, center: NDArray[np.floating], u: NDArray[np.floating], v: NDArray[np.floating], *,
    notes: tuple[str, ...] = (), of_splats: bool = False,
) -> RawMesh:  # fmt: skip
    """A square at each centre with the half sides `u` and `v`, (n, 3) each: used to find the units and axes of splats
    and points, as for a mesh."""
    corners = np.stack([center - u - v, center + u - v, center + u + v, center - u + v], axis=1)
    faces = (4 * np.arange(len(center))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return unnamed_mesh(path, corners.reshape(-1, 3), faces, notes=notes, of_splats=of_splats)


def check_face_count(path: Path, count: int) -> None:
    """Refuse more faces than we can handle, before they are allocated."""
    if count > MAX_FACES:
        raise InputError(f"{path}: {count} faces > {MAX_FACES}; decimate the mesh first")


def check_vertex_count(path: Path, count: int) -> None:
    """Refuse more vertices than the maximum number of faces has corners."""
    if count > MAX_CORNERS:
        raise InputError(f"{path}: {count} vertices > {MAX_CORNERS}; decimate the mesh first")


def triangulate(
    vertices: NDArray[np.float64], polygons: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangulate polygons with equal numbers of corners.

    Returns corner triples (t, 3) that index the corners 0..k-1 of each polygon, and the polygon (t,) of each triple.
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
    """Mask of the polygons with a corner that turns against their normal, shape (p,)."""
    edges = np.roll(points, -1, axis=1) - points
    turn = np.cross(np.roll(edges, 1, axis=1), edges)
    along = np.einsum("pki,pi->pk", turn, normals)
    scale = np.einsum("pi,pi->p", normals, normals)[:, None]
    return np.asarray((along < -1e-9 * scale).any(axis=1))


def _cut_concave(points: NDArray[np.float64], normal: NDArray[np.float64], fan: NDArray[np.int64]) -> NDArray[np.int64]:
    """Corner triples of one concave polygon; a fan if its outline crosses itself."""
    if len(points) > MOST_CORNERS:
        raise GeometryError(f"a concave face has {len(points)} corners > {MOST_CORNERS}; cut it into triangles")
    across = np.linalg.svd(normal[None, :])[2][1:]
    if np.dot(np.cross(across[0], across[1]), normal) < 0:
        across = across[::-1]
    flat = points @ across.T
    triangles = np.asarray(manifold3d.triangulate([flat]), dtype=np.int64)
    return triangles if triangles.shape == fan.shape else fan
