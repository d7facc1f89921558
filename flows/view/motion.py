"""What moves in a drop, frame by frame: the object and the dent under it.

In: scene and object as segmented, the anchor, and the settled state with its frames. Out: surfaces that are refined
once, for the largest displacement of all frames; a frame then costs one weighted sum.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.geometry.boundary import welded
from dcap.geometry.deform import FAR, NEGLIGIBLE, DisplacementField, edge_lengths, refined, touching
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, surface_at
from flows.view.surface import DrawnSurface, SmoothMesh, drawn, smooth, thinned, vertex_normals

Array = NDArray[np.float64]

MOVING_FACES = 40_000
"""Most faces of a soft object that are drawn: every frame has its own [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class FollowingPoints:
    """Points that follow a simulated surface."""

    index: NDArray[np.int64]
    """Those that do, shape (k,)."""
    corner: NDArray[np.int64]
    """Three points of the surface for each, shape (k, 3)."""
    weight: Array
    """How much each of the three counts, shape (k, 3)."""

    @classmethod
    def of(cls, field: DisplacementField, points: Array, index: NDArray[np.int64]) -> "FollowingPoints":
        """What points (n, 3) with these indices follow in a field."""
        corner, weight, fade = field.carriers(points[index])
        return cls(index, corner, fade[:, None] * weight)

    def only(self, some: NDArray[np.bool_]) -> "FollowingPoints":
        """Those of the points that are chosen (k,)."""
        return FollowingPoints(self.index[some], self.corner[some], self.weight[some])

    def shift(self, displacement: Array, count: int) -> Array:
        """How far all `count` points are moved by a displacement of the surface [m], shape (count, 3)."""
        result = np.zeros((count, 3))
        result[self.index] = np.einsum("nk,nki->ni", self.weight, displacement[self.corner])
        return result


@dataclass(frozen=True, eq=False, slots=True)
class DropMotion:
    """Frames of a drop, or its start and its end where no frames were kept."""

    settled: Settled
    kept: NDArray[np.int64]
    """Frames of the drop that are shown, the first and the last among them, shape (f,)."""

    @classmethod
    def of(cls, settled: Settled) -> "DropMotion":
        """All that was kept."""
        return cls(settled, np.arange(2 if settled.frames is None else len(settled.frames.time)))

    @property
    def whole(self) -> bool:
        """Whether frames between start and end were kept."""
        return self.settled.frames is not None

    @property
    def time(self) -> Array:
        """Of the frames that are shown [s], shape (f,)."""
        frames = self.settled.frames
        every = np.array([0.0, self.settled.simulated_seconds]) if frames is None else frames.time
        return np.asarray(every[self.kept])

    def fewer(self, most: int) -> "DropMotion":
        """The motion with at most so many frames (2 at least), evenly spread."""
        if len(self.kept) <= most:
            return self
        chosen = np.unique(np.round(np.linspace(0, len(self.kept) - 1, max(most, 2))).astype(np.int64))
        return replace(self, kept=self.kept[chosen])

    def displacement(self, body: int, frame: int) -> Array:
        """Displacement of a body's surface since the start [m], shape (n, 3)."""
        one = self.settled.bodies[body]
        if not self.whole:
            return one.displacement if frame else np.zeros_like(one.displacement)
        return surface_at(self.settled, body, int(self.kept[frame])) - (one.surface.vertices - one.displacement)

    def largest(self, body: int) -> Array:
        """The largest displacement of each point of a body's surface over the frames [m], shape (n, 3)."""
        result = self.settled.bodies[body].displacement.copy()
        length = np.linalg.norm(result, axis=1)
        for frame in range(len(self.kept)):
            now = self.displacement(body, frame)
            farther = np.linalg.norm(now, axis=1) > length + NEGLIGIBLE
            result[farther], length[farther] = now[farther], np.linalg.norm(now[farther], axis=1)
        return result

    def pose(self, body: int, frame: int) -> Array:
        """World-from-start map of a body as a whole, shape (4, 4)."""
        matrix = np.eye(4)
        if self.settled.frames is not None:
            path, index = self.settled.frames.bodies[body], self.kept[frame]
            matrix[:3, :3], matrix[:3, 3] = path.rotation[index], path.translation[index]
        elif frame:
            one = self.settled.bodies[body]
            matrix[:3, :3] = Turn.from_quat(one.quaternion, scalar_first=True).as_matrix()
            matrix[:3, 3] = one.position
        return matrix

    def deforms(self, body: int) -> bool:
        """Whether the body's shape changes, by more than a picture shows."""
        for frame in range(len(self.kept)):
            one, pose = self.settled.bodies[body], self.pose(body, frame)
            start = one.surface.vertices - one.displacement
            moved = start @ pose[:3, :3].T + pose[:3, 3]
            if np.abs(start + self.displacement(body, frame) - moved).max(initial=0.0) > NEGLIGIBLE:
                return True
        return False


@dataclass(frozen=True, eq=False, slots=True)
class MovingObject:
    """The object over the frames."""

    start: Mesh
    """Before the drop."""
    shape: SmoothMesh
    """The same as it is drawn."""
    poses: Array
    """World-from-start maps, shape (f, 4, 4), where it is rigid; of an object that deforms one, the identity."""
    points: FollowingPoints | None = None
    """What its vertices follow; None: it is rigid."""
    motion: DropMotion | None = None
    """None: nothing was dropped, or the drop came to no rest."""

    @property
    def deforms(self) -> bool:
        """Whether every frame has a shape of its own."""
        return self.points is not None

    def pose(self, frame: int) -> Array:
        """World-from-shape map at a frame, shape (4, 4)."""
        return np.asarray(self.poses[0 if self.deforms else frame])

    def surface(self, frame: int) -> DrawnSurface:
        """Its shape at a frame."""
        if self.points is None or self.motion is None:
            return drawn(self.shape)
        shift = self.points.shift(self.motion.displacement(0, frame), len(self.start.vertices))
        return drawn(self.shape.moved(self.start.vertices + shift))


@dataclass(frozen=True, eq=False, slots=True)
class MovingBase:
    """Faces of the base that follow the dent, with the still ones around them."""

    around: Mesh
    """These faces at the start."""
    shape: SmoothMesh
    """The same at rest, as they are drawn."""
    moving: NDArray[np.bool_]
    """Which of them move, shape (m,)."""
    piece: NDArray[np.int32]
    """The part of the base that each belongs to, -1 for none, shape (m,)."""
    points: FollowingPoints
    motion: DropMotion
    body: int
    """Among the settled bodies."""

    @property
    def pieces(self) -> list[int]:
        """The parts of which something moves."""
        return [int(one) for one in np.unique(self.piece[self.moving])]

    def at(self, frame: int) -> tuple[Array, Array]:
        """The vertices at a frame [m], shape (n, 3), and how far each has moved along its outward normal [m], (n,)."""
        shift = self.points.shift(self.motion.displacement(self.body, frame), len(self.around.vertices))
        now = replace(self.around, vertices=self.around.vertices + shift)
        return now.vertices, np.einsum("ij,ij->i", shift, vertex_normals(now))

    def surface(self, frame: int, piece: int, colors: NDArray[np.uint8] | None = None) -> DrawnSurface:
        """The moving faces of one part at a frame, perhaps with other colours of the vertices (n, 3)."""
        now = self.shape.moved(self.at(frame)[0], colors)
        return drawn(now, np.flatnonzero(self.moving & (self.piece == piece)))


def moving_object(item: Segmentation, anchor: Anchor, motion: DropMotion) -> MovingObject:
    """The object over the frames: moved as a whole, or following its simulated surface."""
    start, count = item.mesh.transformed(anchor.world_from_object), len(motion.kept)
    if not motion.deforms(0):
        return MovingObject(
            start, smooth(start), np.stack([motion.pose(0, frame) for frame in range(count)]), None, motion
        )
    few = thinned(start, np.zeros(len(start.faces), dtype=bool), MOVING_FACES)[0]
    body = motion.settled.bodies[0]
    surface = Mesh(body.surface.vertices - body.displacement, body.surface.faces, body.surface.colors)
    field = DisplacementField(surface, body.displacement, close=np.inf)
    points = FollowingPoints.of(field, few.vertices, np.arange(len(few.vertices)))
    return MovingObject(few, smooth(few), np.eye(4)[None], points, motion)


def frames_for(base: MovingBase | None, thing: MovingObject, most: int) -> int:
    """How many frames can be shown with at most so many faces in all of them together [-]."""
    faces = int(base.moving.sum()) if base else 0
    faces += len(thing.start.faces) if thing.deforms else 0
    return max(2, most // faces) if faces else most


def moving_base(
    scene: Segmentation, base_id: str, motion: DropMotion
) -> tuple[Segmentation, MovingBase | None, NDArray[np.bool_]]:
    """The scene before the drop, finer where it bends; its moving faces; and which of its faces those are, (m,)."""
    still = np.zeros(len(scene.mesh.faces), dtype=bool)
    body = next((i for i, one in enumerate(motion.settled.bodies) if i and one.name == base_id), None)
    if body is None:
        return scene, None, still
    largest, surface = motion.largest(body), motion.settled.bodies[body].surface
    start = Mesh(surface.vertices - motion.settled.bodies[body].displacement, surface.faces, surface.colors)
    bent = np.linalg.norm(largest, axis=1)[start.faces].max(axis=1) > NEGLIGIBLE
    if not bent.any():
        return scene, None, still
    low, high = start.submesh(np.flatnonzero(bent)).bounds
    field, index = DisplacementField(start, largest), scene.index_of(base_id)
    edge = float(np.quantile(edge_lengths(start)[bent], 0.25))
    fine, origin = refined(scene.mesh, scene.face_instance == index, low, high, edge, field)
    finer = replace(scene, mesh=fine, face_instance=scene.face_instance[origin], face_part=scene.face_part[origin])
    mine = finer.face_instance == index
    used = np.unique(fine.faces[mine])
    near = used[((fine.vertices[used] >= low - FAR) & (fine.vertices[used] <= high + FAR)).all(axis=1)]
    points = FollowingPoints.of(field, fine.vertices, near)
    far = np.linalg.norm(points.shift(largest, len(fine.vertices)), axis=1) > NEGLIGIBLE
    moving = mine & far[fine.faces].any(axis=1)
    if not moving.any():
        return scene, None, still
    place_of = welded(fine.vertices)
    shared = np.zeros(len(fine.vertices), dtype=bool)
    shared[place_of[fine.faces[~moving]]] = True  # with faces that stay: a vertex that moved would open a gap
    points = points.only(~shared[place_of[points.index]])
    around = np.flatnonzero(touching(fine, moving) & mine)
    used, inverse = np.unique(fine.faces[around], return_inverse=True)
    place = np.full(len(fine.vertices), -1, dtype=np.int64)
    place[used] = np.arange(len(used))
    few = points.only(place[points.index] >= 0)
    few = replace(few, index=place[few.index])
    patch = Mesh(fine.vertices[used], inverse.reshape(-1, 3).astype(np.int32), fine.colors[used])
    last = few.shift(motion.displacement(body, len(motion.kept) - 1), len(used))
    shape = smooth(replace(patch, vertices=patch.vertices + last))
    base = MovingBase(patch, shape, moving[around], finer.face_part[around], few, motion, body)
    return finer, base, moving
