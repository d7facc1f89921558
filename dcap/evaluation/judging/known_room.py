"""An embedded room with a heavy ball at stated places, from which the pairs with known answers are made.

In: a room with a bed, and a position of the ball over the bed or the floor. Out: meshes, metrics measured on them by
the same code as for every placement, and pictures by the same rules (cameras.py). The dent of the settled ball has the
shape and depth of [J85]. Metrics that would need a simulation are null.

[J85] Johnson, Contact Mechanics, 1985, ch. 3.4 and 4.2.
"""

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial

import numpy as np
import trimesh
from numpy.typing import NDArray

from dcap.arrays import Array
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
from dcap.evaluation.metrics.touching import columns, touching
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.view_volume import cut_faces
from dcap.geometry.solid.repair import subdivide_near
from dcap.language.protocol.requests import Picture
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY
from dcap.scene.types.pictures import BEFORE, PLACED, Sights, Viewpoint
from dcap.synthetic.rooms import BuiltRoom

RADIUS, MASS = 0.108, 5.0
"""Radius and mass of a light bowling ball [m], [kg]."""
COMPLIANCE = (1.0 - 0.3**2) / 4e4
"""Compliance of the mattress's foam, (1 - nu^2) / E [1/Pa]."""
DENT = float((9.0 * (MASS * GRAVITY * COMPLIANCE) ** 2 / (16.0 * RADIUS)) ** (1.0 / 3.0))
"""Indentation by the settled ball [m]: a rigid sphere on an elastic half-space [J85, eq. 4.23]."""
BALL_TO_BED = 0.25
"""Distance of the ball on the floor from the bed [m]."""
FINE = 0.006
"""Edges of the bed's faces around the dent [m]: chords of the ball sag by FINE^2 / (8 RADIUS), 0.04 mm."""
NEAR = 0.05
"""Distance from the ball, in plan, within which the room is evaluated [m]."""
BED, FLOOR = "bed", "floor"
PROMPTS = {BED: "put the bowling ball at the center of the bed", FLOOR: "put the bowling ball on the floor by the bed"}
LYING_ON = {BED: ("bed",), FLOOR: ("floor", "rug")}
"""Label of the support in either case."""
STRUCTURE = ("floor", "ceiling", "wall", "window", "door")
COLOR = (40, 50, 110)

KEPT_SCENES = 4
"""Number of scenes kept, of all rooms: the two of a pair, and the undeformed one."""
KEPT_PICTURES = 64
"""Number of pictures kept: more than the questions about two pairs show."""


@dataclass(frozen=True, slots=True)
class BallPlace:
    """Position of the ball."""

    on: str
    """BED or FLOOR."""
    height: float = 0.0
    """Height of the ball over its contact with the undeformed support [m], negative inside."""
    dented: bool = False
    """Whether the bed gives way to it."""
    aside: float = 0.0
    """Distance from the middle of the bed, along the bed's longer side [m]."""


SETTLED = BallPlace(BED, -DENT, dented=True)
ON_THE_FLOOR = BallPlace(FLOOR)


@dataclass(frozen=True, eq=False, slots=True)
class OwnedMesh:
    """A room with the instance of each face."""

    mesh: Mesh
    owner: NDArray[np.int32]
    """Index of the instance of each face, shape (m,)."""

    def over(self, thing: Mesh) -> "OwnedMesh":
        """Parts of the room with a face over, under or near a thing: enough to measure how they touch."""
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
        """The undeformed bed."""
        return self.room.record.mesh.submesh(np.flatnonzero(self.room.face_instance == self.bed))

    @cached_property
    def owner(self) -> NDArray[np.int32]:
        """Index of the instance of each face, shape (m,)."""
        return np.asarray(self.room.face_instance, dtype=np.int32)

    @cached_property
    def caster(self) -> Raycaster:
        """Rays against the undeformed room."""
        return Raycaster(self.room.record.mesh)

    def below(self, xy: Array, height: float = 1.6) -> tuple[Array, str]:
        """First hit of a plumb line from `height` over the floor: point [m], shape (3,), and label."""
        start = np.array([[xy[0], xy[1], self.bed_mesh.bounds[0, 2] + height]])
        hit = self.caster.cast(start, np.array([[0.0, 0.0, -1.0]]))
        face = int(hit.face[0])
        label = self.room.instance_labels[int(self.room.face_instance[face])] if face >= 0 else ""
        return np.array([*xy, hit.position[0, 2]]), label

    @cached_property
    def asked(self) -> dict[str, Array]:
        """The middle of the bed's top, and a point of the floor next to it that the ball fits on [m], each (3,)."""
        low, high = self.bed_mesh.bounds[:, :2]
        middle, reach = 0.5 * (low + high), 0.5 * (high - low) + BALL_TO_BED + RADIUS
        for step in ((0, 1), (1, 0), (-1, 0), (0, -1)):
            point, label = self.below(middle + reach * np.array(step))
            room_for_it = float(self.caster.distance_to(raised(point, 2 * RADIUS)[None])[0]) >= RADIUS
            if label in LYING_ON[FLOOR] and room_for_it:
                return {BED: self.below(middle)[0], FLOOR: point}
        raise InputError(f"room {self.name} has no free floor next to its bed; known answers need some")

    @cache  # noqa: B019 few rooms are ever made
    def center(self, place: BallPlace) -> Array:
        """Middle of the ball [m], shape (3,): lowered onto the undeformed room, then moved by its height."""
        xy = self.asked[place.on][:2].copy()
        xy[int(np.argmax(np.ptp(self.bed_mesh.bounds[:, :2], axis=0)))] += place.aside
        over = raised(self.below(xy)[0], 2.0 * RADIUS)
        thing = ball(over)
        beneath = OwnedMesh(self.room.record.mesh, self.owner).over(thing).mesh
        return raised(over, place.height - float(columns(thing, Raycaster(beneath)).gap.min()))

    @lru_cache(maxsize=KEPT_SCENES)  # noqa: B019 few rooms are ever made
    def scene(self, place: BallPlace) -> OwnedMesh:
        """The room of a placement, which is measured and rendered from many sides; the bed is dented only if the place
        says so."""
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
        """Metrics of a placement for a request of BED or FLOOR."""
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
        """The clean room, by the camera of the compared places, and the ball alone."""
        clean, alone = BEFORE
        return Picture(clean, partial(self.seen, None, asked, places, PLACED[0])), Picture(alone, asset)

    def views(self, place: BallPlace, asked: str, places: tuple[BallPlace, ...]) -> tuple[Picture, ...]:
        """The pictures of one of the compared places."""
        return tuple(Picture(view, partial(self.seen, place, asked, places, view)) for view in PLACED)

    @lru_cache(maxsize=KEPT_PICTURES)  # noqa: B019 the next questions show the same pictures on other sides
    def seen(self, place: BallPlace | None, asked: str, places: tuple[BallPlace, ...], view: str) -> NDArray[np.uint8]:
        """A view of the room with the ball, without one for None."""
        around = self.scene(place or BallPlace(BED))
        camera = camera_of(self.viewpoint(place, asked, places, view))
        cut = cut_faces(around.mesh, self.structure(around), camera.position, np.asarray(camera.target))
        shown = around.mesh.submesh(np.flatnonzero(~cut))
        things = [shown] if place is None else [shown, ball(self.center(place))]
        return picture(things, camera, samples=SAMPLES).rgb

    def viewpoint(self, place: BallPlace | None, asked: str, places: tuple[BallPlace, ...], view: str) -> Viewpoint:
        """The camera of a view of one of the compared places, or of the clean room."""
        cameras = sample_cameras([self.sights(one, asked) for one in places])
        if place is None or view == PLACED[0]:
            return cameras.overview
        return cameras.closeup(self.sights(place, asked))

    @cache  # noqa: B019 few rooms are ever made
    def sights(self, place: BallPlace, asked: str) -> Sights:
        """Visibility of the ball at a place; the support is the bed, or all of the room's floor."""
        around, room = self.scene(place), self.room.record.mesh.bounds
        low, high = self.bed_mesh.bounds if asked == BED else (room[0], np.array([*room[1, :2], room[0, 2]]))
        placed = PlacedThing.of(around.mesh, self.structure(around), ball(self.center(place)))
        return sights_of(placed, box_corners(low, high), room.mean(axis=0))

    def structure(self, around: OwnedMesh) -> NDArray[np.bool_]:
        """Faces of walls, floor and ceiling, shape (m,)."""
        return np.isin(np.array(self.room.instance_labels)[around.owner], STRUCTURE)


def raised(point: Array, height: float) -> Array:
    """A point raised by `height` [m], shape (3,)."""
    return np.asarray(point + np.array([0.0, 0.0, height]))


def skirt(away: Array) -> Array:
    """Depression of a soft surface around a ball that has sunk in by DENT [m], at distances from its axis, shape (n,).

    Outside of the contact, radius a = sqrt(RADIUS DENT): ((2 a^2 - r^2) asin(a / r) + a sqrt(r^2 - a^2)) / (pi RADIUS)
    [J85, eq. 3.42a]; within it the depth at its rim, from which on the ball itself presses.
    """
    a = np.sqrt(RADIUS * DENT)
    r = np.maximum(away, a)
    depth = (2.0 * a**2 - r**2) * np.arcsin(a / r) + a * np.sqrt(r**2 - a**2)
    return np.asarray(depth / (np.pi * RADIUS))


def ball(center: Array) -> Mesh:
    """The ball with its middle at `center`."""
    solid = trimesh.creation.icosphere(4, RADIUS)
    return Mesh.of(np.asarray(solid.vertices) + center, solid.faces, COLOR)


def asset() -> NDArray[np.uint8]:
    """The ball alone."""
    alone = ball(np.zeros(3))
    return picture([alone], camera_of(asset_view(alone)), samples=SAMPLES).rgb
