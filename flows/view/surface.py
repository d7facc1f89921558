"""Surfaces for the page, still and moving: with normals and textures, and a limited number of faces.

In: meshes of the pipeline and their paint. Out: `DrawnSurface`, and meshes with fewer faces.

Moving parts of a drop for the page: the object, dents, and earlier placed things.

In: the moving scene and the object as segmented. Out: surfaces frame by frame, and poses of rigid parts.
"""

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.deform import touching
from dcap.geometry.rendering.surface import ShadingNormals
from dcap.scene.types.mesh import CornerPaint, Mesh, PaintedMesh
from tasks.render.motion import DropMotion, MovingPoints, MovingScene

Number = TypeVar("Number", bound=np.generic)
MOST_ROUNDS = 20
"""Most rounds in which cells grow to reduce the number of faces [-]."""
GROWTH = 1.25
MOVING_FACES = 40_000
"""Most drawn faces of a soft object without textures, which has its own shape in every frame [-]."""


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


@dataclass(frozen=True, eq=False, slots=True)
class MovingObject:
    """The object over the frames."""

    start: PaintedMesh
    """Before the drop."""
    poses: Array
    """World-from-start map at each frame, shape (f, 4, 4); of an object that deforms the identity."""
    points: MovingPoints | None = None
    """Motion that its vertices follow; None: it is rigid."""

    @property
    def deforms(self) -> bool:
        """Whether every frame has a shape of its own."""
        return self.points is not None

    def surface(self, frame: int) -> DrawnSurface:
        """Its surface at a frame."""
        if self.points is None:
            return whole(self.start)
        return whole(self.start.moved(replace(self.start.mesh, vertices=self.points.at(frame))))


class MovingSurfaces:
    """Faces of the scene that change their shape, with the still ones around them."""

    def __init__(self, scene: MovingScene, look: PaintedMesh, bending: NDArray[np.bool_]) -> None:
        """Of the faces that bend (m,); `look` is the scene before the drop."""
        around = np.flatnonzero(touching(scene.scene.mesh, bending))
        used, inverse = np.unique(scene.scene.mesh.faces[around], return_inverse=True)
        self._scene, self._used = scene, used
        self._faces = inverse.reshape(-1, 3).astype(np.int32)
        self._moving = bending[around]
        instance, part = scene.scene.face_instance[around], scene.scene.face_part[around]
        self._owner = np.stack([instance, np.where(instance < 0, -1, part)], axis=1)
        self.paints = {
            one: None if look.paint is None else look.paint.of(around[self._of(one)])
            for one in map(tuple, np.unique(self._owner[self._moving], axis=0).tolist())
        }
        """Of the bending faces of each instance's part; -1 for none."""

    @property
    def faces(self) -> int:
        """Number of faces that change their shape."""
        return int(self._moving.sum())

    def _of(self, piece: tuple[int, int]) -> NDArray[np.int64]:
        """The bending faces of an instance's part among these."""
        return np.flatnonzero(self._moving & (self._owner == piece).all(axis=1))

    def _mesh(self, frame: int) -> Mesh:
        """These faces at a frame."""
        now = self._scene.at(frame)
        return Mesh(now.vertices[self._used], self._faces, now.colors[self._used])

    def heights(self, frame: int, instance: str) -> Array:
        """How far vertices of an instance have moved along their outward normals [m], zero elsewhere, shape (n,)."""
        now, mine = self._mesh(frame), np.zeros(len(self._used), dtype=bool)
        mine[self._faces[self._owner[:, 0] == self._scene.scene.index_of(instance)]] = True
        shift = now.vertices - self._scene.unbent(frame)[self._used]
        return np.where(mine, np.einsum("ij,ij->i", shift, upright_normals(now)), 0.0)

    def surface(self, frame: int, piece: tuple[int, int], colors: NDArray[np.uint8] | None = None) -> DrawnSurface:
        """The bending faces of an instance's part at a frame, perhaps in colours of the vertices (n, 3) instead."""
        now = self._mesh(frame)
        found = drawn(PaintedMesh(now if colors is None else replace(now, colors=colors)), self._of(piece))
        return found if colors is not None else replace(found, paint=self.paints[piece])


def moving_object(look: PaintedMesh, motion: DropMotion) -> MovingObject:
    """The object from where it is before the drop: moved as a whole, or following its simulated surface."""
    points = MovingPoints.of_body(motion, 0, look.mesh.vertices)
    if not points.bends:
        return MovingObject(look, points.poses())
    if look.paint is None:
        look = PaintedMesh(thinned(look.mesh, np.zeros(len(look.mesh.faces), dtype=bool), MOVING_FACES)[0])
        points = MovingPoints.of_body(motion, 0, look.mesh.vertices)
    return MovingObject(look, np.tile(np.eye(4), (len(motion.time), 1, 1)), points)


def most_frames(surfaces: MovingSurfaces | None, thing: MovingObject, most: int) -> int:
    """Number of frames that can be shown with at most `most` faces in all of them together [-]."""
    faces = surfaces.faces if surfaces else 0
    faces += len(thing.start.mesh.faces) if thing.deforms else 0
    return max(2, most // faces) if faces else most
