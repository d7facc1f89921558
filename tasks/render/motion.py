"""A drop frame by frame: the positions of the moving parts, and the film of the object coming down.

In: the settled state with its frames, the scene as segmented, and meshes that move with a body. Out: vertices at any
frame; pictures of a camera. The attachment of points is found once, and the scene is cut once, as finely as the largest
displacement of all frames needs; a frame then costs one weighted sum.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.camera import Camera
from dcap.geometry.deform import CLOSE, FAR, NEGLIGIBLE, DisplacementField
from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody, surface_at
from tasks.render.config import RenderConfig
from tasks.render.settled_meshes import settled_scene, shown

MOST_PICTURES = 60
"""Maximum number of pictures of a drop [-]: three seconds of film, including the repeated last picture."""


@dataclass(frozen=True, eq=False, slots=True)
class DropMotion:
    """Frames of a drop, or its start and its end if no frames were kept."""

    settled: Settled

    @property
    def whole(self) -> bool:
        """Whether frames between start and end were kept."""
        return self.settled.frames is not None

    @property
    def time(self) -> Array:
        """Times of the frames [s], shape (f,)."""
        frames = self.settled.frames
        return np.array([0.0, self.settled.simulated_seconds]) if frames is None else frames.time

    def chosen(self, most: int) -> NDArray[np.int64]:
        """Indices of at most `most` frames (at least 2), evenly spaced; the last frame is the rest state."""
        count = len(self.time)
        return np.unique(np.round(np.linspace(0, count - 1, min(count, max(most, 2)))).astype(np.int64))

    def start(self, body: int) -> Mesh:
        """A body's surface before the drop."""
        one = self.settled.bodies[body]
        return replace(one.surface, vertices=one.surface.vertices - one.displacement)

    def displacement(self, body: int, frame: int) -> Array:
        """Displacement of a body's surface since the start [m], shape (n, 3)."""
        if self.whole:
            return surface_at(self.settled, body, frame) - self.start(body).vertices
        last = self.settled.bodies[body].displacement
        return last if frame else np.zeros_like(last)

    def largest(self, body: int) -> Array:
        """The largest displacement of each point of a body's surface in any frame [m], shape (n, 3)."""
        result = self.settled.bodies[body].displacement.copy()
        length = np.linalg.norm(result, axis=1)
        for frame in range(len(self.time)):
            now = self.displacement(body, frame)
            farther = np.linalg.norm(now, axis=1) > length + NEGLIGIBLE
            result[farther], length[farther] = now[farther], np.linalg.norm(now[farther], axis=1)
        return result

    def pose(self, body: int, frame: int) -> Array:
        """World-from-start transform of a body as a whole, shape (4, 4)."""
        if self.settled.frames is None:
            return self.settled.bodies[body].world_from_start if frame else np.eye(4)
        path, matrix = self.settled.frames.bodies[body], np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = path.rotation[frame], path.translation[frame]
        return matrix

    def deforms(self, body: int) -> bool:
        """Return whether the shape of a body changes visibly in a picture."""
        start = self.start(body)
        return any(
            np.abs(start.vertices + self.displacement(body, frame) - start.transformed(self.pose(body, frame)).vertices)
            .max(initial=0.0) > NEGLIGIBLE
            for frame in range(len(self.time))
        )  # fmt: skip


@dataclass(frozen=True, eq=False, slots=True)
class MovingPoints:
    """Points that move with a body, either rigidly or with the nearest points of its surface."""

    motion: DropMotion
    body: int
    start: Array
    """Positions before the drop [m], shape (k, 3)."""
    corner: NDArray[np.int64] | None = None
    """Three points of the body's surface that each point follows, shape (k, 3); None: the points move rigidly."""
    weight: Array | None = None
    """Weights of these three points, shape (k, 3)."""

    @classmethod
    def of_body(cls, motion: DropMotion, body: int, points: Array) -> "MovingPoints":
        """Points of the body's own mesh."""
        return cls.of_field(motion, body, points, np.inf) if motion.deforms(body) else cls(motion, body, points)

    @classmethod
    def of_field(cls, motion: DropMotion, body: int, points: Array, close: float = CLOSE) -> "MovingPoints":
        """Points that follow the body's surface if they are close to it [m], and less the farther away they are."""
        start = motion.start(body)
        field = DisplacementField(start, np.zeros_like(start.vertices), close)
        corner, weight, fade = field.carriers(points)
        return cls(motion, body, points, corner, fade[:, None] * weight)

    @property
    def bends(self) -> bool:
        """Whether the points move non-rigidly."""
        return self.corner is not None

    def at(self, frame: int) -> Array:
        """Positions at a frame [m], shape (k, 3)."""
        if self.bends:
            return self.start + self.carried(self.motion.displacement(self.body, frame))
        pose = self.motion.pose(self.body, frame)
        return np.asarray(self.start @ pose[:3, :3].T + pose[:3, 3])

    def poses(self) -> Array:
        """World-from-start transforms of the body at all frames, shape (f, 4, 4)."""
        return np.stack([self.motion.pose(self.body, frame) for frame in range(len(self.motion.time))])

    def carried(self, displacement: Array) -> Array:
        """Displacement of the points for a displacement of the surface (n, 3) [m], shape (k, 3)."""
        assert self.corner is not None
        assert self.weight is not None
        return np.asarray(np.einsum("nk,nki->ni", self.weight, displacement[self.corner]))


@dataclass(frozen=True, eq=False, slots=True)
class MovingThing:
    """One thing of the scene that moves."""

    instance: int
    """Index of the instance."""
    placed: bool
    """Whether it is a thing placed earlier that moves as a whole; otherwise it stays and is dented."""
    index: NDArray[np.int64]
    """Vertices of the scene that move with it, shape (k,)."""
    points: MovingPoints


class MovingScene:
    """The scene at any frame: dents, and moving things that were placed earlier."""

    def __init__(self, scene: Segmentation, motion: DropMotion, base_id: str) -> None:
        placed = {one.id: one.placed for one in scene.instances}
        bodies = tuple(
            one if placed.get(one.name, True) else moved_by(one, motion.largest(number))
            for number, one in enumerate(motion.settled.bodies)
        )
        around = settled_scene(scene, replace(motion.settled, bodies=bodies), base_id)
        self.scene = replace(around.scene, mesh=around.start)
        """The scene before the drop, subdivided as finely as necessary."""
        self.origin = around.origin
        """For each face, the face of the segmented scene that it came from, shape (m,)."""
        self.things = [
            self._thing(motion, number, bodies[number], placed=placed[one.name])
            for number, one in enumerate(bodies)
            if number and one.name in placed and np.abs(one.displacement).max(initial=0.0) > 0.0
        ]

    def _thing(self, motion: DropMotion, number: int, body: SettledBody, *, placed: bool) -> MovingThing:
        """A thing that moves as a whole, or the part of a support around its dent."""
        instance, mesh = self.scene.index_of(body.name), self.scene.mesh
        mine = np.unique(mesh.faces[self.scene.face_instance == instance]).astype(np.int64)
        if placed:
            return MovingThing(instance, True, mine, MovingPoints.of_body(motion, number, mesh.vertices[mine]))
        start = motion.start(number)
        bent = np.linalg.norm(body.displacement, axis=1)[start.faces].max(axis=1) > NEGLIGIBLE
        corner, points = start.triangles[bent].reshape(-1, 3), mesh.vertices[mine]
        near = np.zeros(len(mine), dtype=bool)
        if len(corner):
            near = ((points >= corner.min(axis=0) - FAR) & (points <= corner.max(axis=0) + FAR)).all(axis=1)
        followers = MovingPoints.of_field(motion, number, points[near])
        return MovingThing(instance, False, mine[near], followers)

    def at(self, frame: int) -> Mesh:
        """The scene's mesh at a frame."""
        vertices = self.scene.mesh.vertices.copy()
        for one in self.things:
            vertices[one.index] += one.points.at(frame) - one.points.start
        return replace(self.scene.mesh, vertices=vertices)

    def unbent(self, frame: int) -> Array:
        """The vertices at a frame if no shape had changed since the start [m], shape (n, 3)."""
        vertices = self.scene.mesh.vertices.copy()
        for one in self.things:
            if one.placed:
                pose = one.points.motion.pose(one.points.body, frame)
                vertices[one.index] = one.points.start @ pose[:3, :3].T + pose[:3, 3]
        return vertices

    def bending(self) -> NDArray[np.bool_]:
        """Mask of the faces that change their shape, shape (m,)."""
        far = np.zeros(len(self.scene.mesh.vertices), dtype=bool)
        for one in self.things:
            if one.points.bends:
                largest = one.points.carried(one.points.motion.largest(one.points.body))
                far[one.index] |= np.linalg.norm(largest, axis=1) > NEGLIGIBLE
        return np.asarray(far[self.scene.mesh.faces].any(axis=1))


def moved_by(body: SettledBody, displacement: Array) -> SettledBody:
    """A copy of a body whose surface has the displacement (n, 3) [m]."""
    start = body.surface.vertices - body.displacement
    return replace(body, surface=replace(body.surface, vertices=start + displacement), displacement=displacement)


def drop_pictures(
    scene: Segmentation,
    item: Segmentation,
    anchor: Anchor,
    settled: Settled,
    surfaces: tuple[SourceSurface, SourceSurface],
    camera: Camera,
    config: RenderConfig,
) -> Iterator[NDArray[np.uint8]]:
    """The pictures of a drop, one after the other; `surfaces` are the textures of scene and object."""
    motion = DropMotion(settled)
    around, thing = MovingScene(scene, motion, anchor.base_id), item.mesh.transformed(anchor.world_from_object)
    points = MovingPoints.of_body(motion, 0, thing.vertices)
    look, own = painted(around.scene.mesh, surfaces[0]), painted(item.mesh, surfaces[1])
    for frame in motion.chosen(MOST_PICTURES).tolist():
        meshes = shown(around.scene, camera, look.moved(around.at(frame)))
        meshes.append(own.moved(replace(thing, vertices=points.at(frame))))
        yield picture(PreparedMeshes(meshes), camera, samples=config.samples, low_light=True).rgb
