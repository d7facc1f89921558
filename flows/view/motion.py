"""Moving parts of a drop for the page: the object, dents, and earlier placed things.

In: the moving scene and the object as segmented. Out: surfaces frame by frame, and poses of rigid parts.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.deform import touching
from dcap.scene.types.mesh import Mesh, PaintedMesh
from flows.view.surface import DrawnSurface, drawn, thinned, upright_normals, whole
from tasks.render.motion import DropMotion, MovingPoints, MovingScene

MOVING_FACES = 40_000
"""Most drawn faces of a soft object without textures, which has its own shape in every frame [-]."""


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
