"""An embedded room with a heavy ball in it at stated places: what the pairs with known answers are made of.

In: a room with a bed, and where the ball is over the bed or the floor. Out: meshes, metrics that are measured on them
by the code that measures every placement, and pictures by the rules of every placement's (cameras.py). The dent of the
settled ball has the shape and depth that [J85] gives. What only a simulation would tell is null.

[J85] Johnson, Contact Mechanics, 1985, ch. 3.4 and 4.2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
import trimesh
from numpy.typing import NDArray

from dcap.evaluation.judging.cameras import (
    SAMPLES,
    PlacedThing,
    asset_view,
    box_corners,
    camera_of,
    sample_cameras,
    sights_of,
)
from dcap.evaluation.judging.rubric import Metrics
from dcap.evaluation.metrics.columns import columns
from dcap.evaluation.metrics.touching import touching
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.cutaway import cut_faces
from dcap.geometry.rendering.picture import picture
from dcap.geometry.solid.repair import subdivide_near
from dcap.language.protocol.requests import Picture
from dcap.scene.errors import InputError
from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.judged_views import BEFORE, PLACED, Sights, Viewpoint
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.rooms import BuiltRoom

RADIUS, MASS = 0.108, 5.0
"""Of a light bowling ball [m], [kg]."""
COMPLIANCE = (1.0 - 0.3**2) / 4e4
"""Of the mattress's foam, (1 - nu^2) / E [1/Pa]."""
DENT = float((9.0 * (MASS * GRAVITY * COMPLIANCE) ** 2 / (16.0 * RADIUS)) ** (1.0 / 3.0))
"""How deep the settled ball lies [m]: that of a rigid sphere on an elastic half-space [J85, eq. 4.23]."""
BESIDE = 0.25
"""Distance of the ball on the floor from the bed [m]."""
FINE = 0.006
"""Edges of the bed's faces around the dent [m]: chords of the ball sag by FINE^2 / (8 RADIUS), 0.04 mm."""
NEAR = 0.05
"""How far from the ball, in plan, the room is still looked at [m]."""
BED, FLOOR = "bed", "floor"
PROMPTS = {BED: "put the bowling ball at the center of the bed", FLOOR: "put the bowling ball on the floor by the bed"}
LYING_ON = {BED: ("bed",), FLOOR: ("floor", "rug")}
"""Labels of what carries the ball on either."""
STRUCTURE = ("floor", "ceiling", "wall", "window", "door")
COLOR = (40, 50, 110)

Array = NDArray[np.float64]
KEPT_SCENES = 4
"""The two of a pair, and the room as it is."""
KEPT_PICTURES = 64
"""More than the questions about two pairs show."""


@dataclass(frozen=True, slots=True)
class BallPlace:
    """Where the ball is."""

    on: str
    """BED or FLOOR."""
    height: float = 0.0
    """Of the ball over where it touches what is as it was given [m], negative inside."""
    dented: bool = False
    """Whether the bed gives way to it."""
    aside: float = 0.0
    """How far it is from the middle of the bed, along the bed's longer side [m]."""


SETTLED = BallPlace(BED, -DENT, dented=True)
ON_THE_FLOOR = BallPlace(FLOOR)


@dataclass(frozen=True, eq=False, slots=True)
class OwnedMesh:
    """A room and whose each face is."""

    mesh: Mesh
    owner: NDArray[np.int32]
    """Index of the instance of each face, shape (m,)."""

    def over(self, thing: Mesh) -> "OwnedMesh":
        """What has a face over or under a thing, or near it: all that tells how they touch."""
        low, high = thing.bounds[0, :2] - NEAR, thing.bounds[1, :2] + NEAR
        corner = self.mesh.triangles[:, :, :2]
        there = np.flatnonzero(((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1))
        return OwnedMesh(self.mesh.submesh(there), self.owner[there])


@dataclass(frozen=True, eq=False)
class RoomWithBall:
    """A room with a bed and places of a ball in it."""

    name: str
    room: BuiltRoom

    @cached_property
    def bed(self) -> int:
        """Index of the bed."""
        found = [k for k, label in enumerate(self.room.instance_labels) if label == "bed"]
        if not found:
            raise InputError(f"room {self.name} has no bed; known answers need one")
        return found[0]

    @cached_property
    def bed_mesh(self) -> Mesh:
        """The bed as it was given."""
        return self.room.record.mesh.submesh(np.flatnonzero(self.room.face_instance == self.bed))

    @cached_property
    def owner(self) -> NDArray[np.int32]:
        """Index of the instance of each face, shape (m,)."""
        return np.asarray(self.room.face_instance, dtype=np.int32)

    @cached_property
    def caster(self) -> Raycaster:
        """The room as it is."""
        return Raycaster(self.room.record.mesh)

    def below(self, xy: Array, height: float = 1.6) -> tuple[Array, str]:
        """What a plumb line hits from `height` over the floor: point [m], shape (3,), and label."""
        start = np.array([[xy[0], xy[1], self.bed_mesh.bounds[0, 2] + height]])
        hit = self.caster.cast(start, np.array([[0.0, 0.0, -1.0]]))
        face = int(hit.face[0])
        label = self.room.instance_labels[int(self.room.face_instance[face])] if face >= 0 else ""
        return np.array([*xy, hit.position[0, 2]]), label

    @cached_property
    def asked(self) -> dict[str, Array]:
        """The middle of the bed's top, and a point of the floor beside it that the ball fits on [m], each (3,)."""
        low, high = self.bed_mesh.bounds[:, :2]
        middle, reach = 0.5 * (low + high), 0.5 * (high - low) + BESIDE + RADIUS
        for step in ((0, 1), (1, 0), (-1, 0), (0, -1)):
            point, label = self.below(middle + reach * np.array(step))
            room_for_it = float(self.caster.distance_to(raised(point, 2 * RADIUS)[None])[0]) >= RADIUS
            if label in LYING_ON[FLOOR] and room_for_it:
                return {BED: self.below(middle)[0], FLOOR: point}
        raise InputError(f"room {self.name} has no free floor beside its bed; known answers need some")

    @cached_property
    def center(self) -> Callable[[BallPlace], Array]:
        """`let_down`, kept for each place."""
        return cache(self.let_down)

    def let_down(self, place: BallPlace) -> Array:
        """Middle of the ball [m], shape (3,): let down onto the room as it was given, then moved by its height."""
        xy = self.asked[place.on][:2].copy()
        xy[int(np.argmax(np.ptp(self.bed_mesh.bounds[:, :2], axis=0)))] += place.aside
        over = raised(self.below(xy)[0], 2.0 * RADIUS)
        thing = ball(over)
        beneath = OwnedMesh(self.room.record.mesh, self.owner).over(thing).mesh
        return raised(over, place.height - float(columns(thing, Raycaster(beneath)).gap.min()))

    @cached_property
    def scene(self) -> Callable[[BallPlace], OwnedMesh]:
        """`built`, of which the last scenes are kept: a placement is measured and seen from many sides."""
        return lru_cache(maxsize=KEPT_SCENES)(self.built)

    def built(self, place: BallPlace) -> OwnedMesh:
        """The room of a placement: only where it is said to does the bed give way."""
        owner = self.owner
        if not place.dented:
            return OwnedMesh(self.room.record.mesh, owner)
        center = self.center(place)
        fine = subdivide_near(self.bed_mesh, np.stack([center - 2.5 * RADIUS, center + 2.5 * RADIUS]), FINE)
        vertices = fine.vertices.copy()
        away = np.linalg.norm(vertices[:, :2] - center[:2], axis=1)
        top = np.abs(vertices[:, 2] - (center[2] - RADIUS + DENT)) < RADIUS
        vertices[top, 2] -= skirt(away[top])
        under = center[2] - np.sqrt(np.clip(RADIUS**2 - away**2, 0.0, None))
        pressed = top & (away < RADIUS) & (vertices[:, 2] > under)
        vertices[pressed, 2] = under[pressed]
        rest = owner != self.bed
        mesh = Mesh.concatenate([
            self.room.record.mesh.submesh(np.flatnonzero(rest)), Mesh(vertices, fine.faces, fine.colors),
        ])  # fmt: skip
        return OwnedMesh(mesh, np.concatenate([owner[rest], np.full(len(fine.faces), self.bed, dtype=np.int32)]))

    def metrics(self, place: BallPlace, asked: str) -> Metrics:
        """What is measured of a placement where BED or FLOOR was asked for."""
        thing = ball(self.center(place))
        around = self.scene(place).over(thing)
        found = touching(thing, around.mesh)
        face = int(found.columns.face[found.columns.nearest])
        label = self.room.instance_labels[int(around.owner[face])] if face >= 0 else ""
        middle = found.patch.mean(axis=0) if len(found.patch) else thing.bounds.mean(axis=0)
        return {
            "support_hit": label in LYING_ON[asked],
            "part_hit": None,
            "region_distance_m": float(np.linalg.norm(middle[:2] - self.asked[asked][:2])),
            "orientation_error_deg": None,
            "penetration_m": found.penetration,
            "gap_m": found.gap,
            "referee_drift_m": None,
            "referee_drift_deg": None,
            "visible_fraction": None,
            "com_supported": found.margin >= 0.0,
        }

    def before(self, asked: str, places: tuple[BallPlace, ...]) -> tuple[Picture, ...]:
        """The clean room, as places of the ball that are compared are seen, and the ball alone."""
        clean, alone = BEFORE
        return Picture(clean, lambda: self.seen(None, asked, places, PLACED[0])), Picture(alone, asset)

    def views(self, place: BallPlace, asked: str, places: tuple[BallPlace, ...]) -> tuple[Picture, ...]:
        """The pictures of one of the places that are compared."""
        return tuple(
            Picture(view, lambda view=view: self.seen(place, asked, places, view))  # type: ignore[misc]
            for view in PLACED
        )

    @cached_property
    def seen(self) -> Callable[[BallPlace | None, str, tuple[BallPlace, ...], str], NDArray[np.uint8]]:
        """`drawn`, of which the last pictures are kept: a question shows what the one before it showed, on other sides,
        and the better placement of a pair is that of many."""
        return lru_cache(maxsize=KEPT_PICTURES)(self.drawn)

    def drawn(self, place: BallPlace | None, asked: str, places: tuple[BallPlace, ...], view: str) -> NDArray[np.uint8]:
        """A view of the room with the ball, without one for None."""
        around = self.scene(place or BallPlace(BED))
        camera = camera_of(self.viewpoint(place, asked, places, view))
        cut = cut_faces(around.mesh, self.structure(around), camera.position, np.asarray(camera.target))
        shown = around.mesh.submesh(np.flatnonzero(~cut))
        things = [shown] if place is None else [shown, ball(self.center(place))]
        return picture(things, camera, samples=SAMPLES).rgb

    def viewpoint(self, place: BallPlace | None, asked: str, places: tuple[BallPlace, ...], view: str) -> Viewpoint:
        """The camera of a view of one of the places that are compared, or of the room before."""
        cameras = sample_cameras([self.sights(one, asked) for one in places])
        if place is None or view == PLACED[0]:
            return cameras.overview
        return cameras.closeup(self.sights(place, asked))

    @cached_property
    def sights(self) -> Callable[[BallPlace, str], Sights]:
        """`look`, kept for each place."""
        return cache(self.look)

    def look(self, place: BallPlace, asked: str) -> Sights:
        """What can be seen of the ball at a place; the support is the bed, or all of the room's floor."""
        around, room = self.scene(place), self.room.record.mesh.bounds
        low, high = self.bed_mesh.bounds if asked == BED else (room[0], np.array([*room[1, :2], room[0, 2]]))
        placed = PlacedThing.of(around.mesh, self.structure(around), ball(self.center(place)))
        return sights_of(placed, box_corners(low, high), room.mean(axis=0))

    def structure(self, around: OwnedMesh) -> NDArray[np.bool_]:
        """Faces of walls, floor and ceiling, shape (m,)."""
        return np.isin(np.array(self.room.instance_labels)[around.owner], STRUCTURE)


def raised(point: Array, height: float) -> Array:
    """A point so much higher [m], shape (3,)."""
    return np.asarray(point + np.array([0.0, 0.0, height]))


def skirt(away: Array) -> Array:
    """How far a soft surface sinks around a ball that has sunk in by DENT [m], at distances from its axis, shape (n,).

    Outside of the contact, radius a = sqrt(RADIUS DENT): ((2 a^2 - r^2) asin(a / r) + a sqrt(r^2 - a^2)) / (pi RADIUS)
    [J85, eq. 3.42a]; within it the depth at its rim, from where the ball itself presses.
    """
    a = np.sqrt(RADIUS * DENT)
    r = np.maximum(away, a)
    depth = (2.0 * a**2 - r**2) * np.arcsin(a / r) + a * np.sqrt(r**2 - a**2)
    return np.asarray(depth / (np.pi * RADIUS))


def ball(center: Array) -> Mesh:
    """The ball with its middle there."""
    solid = trimesh.creation.icosphere(4, RADIUS)
    return Mesh.of(np.asarray(solid.vertices) + center, solid.faces, COLOR)


def asset() -> NDArray[np.uint8]:
    """The ball alone."""
    alone = ball(np.zeros(3))
    return picture([alone], camera_of(asset_view(alone)), samples=SAMPLES).rgb
