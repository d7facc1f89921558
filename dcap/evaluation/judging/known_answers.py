"""Pairs of placements with a known answer, made from an embedded room: what a judge must get right before it judges.

A heavy ball is asked for at the centre of the bed. Four placements of it: settled (in a dent of its own shape),
hovering 5 cm over the mattress, 5 cm inside a mattress that does not give way, and lying on the floor beside the bed.
In each pair the settled one is better on the axis that is named, and on no other is anything claimed.

In: the name of a room with a bed. Out: placements with metrics, measured on the meshes of the pictures where geometry
tells them and null where only a simulation would, and pictures that are rendered when somebody looks.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import trimesh
from numpy.typing import NDArray

from dcap.evaluation.judging.judge import JudgedPlacement
from dcap.evaluation.judging.judged_pictures import NamedPicture
from dcap.evaluation.judging.rubric import Metrics
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.geometry.camera import looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.cutaway import cut_faces
from dcap.geometry.rendering.picture import picture
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.rooms import BuiltRoom, build_room

PROMPT = "put the bowling ball at the center of the bed"
OBJECT = "bowling ball"
RADIUS = 0.108
"""Of a bowling ball [m]."""
DENT = 0.02
"""How deep the settled ball lies [m]: that of about 5 kg on foam of 4e4 Pa [Hertz]."""
OFF = 0.05
"""How far the lowest point of the wrong ones is over or under the flat mattress [m]."""
BESIDE = 0.25
"""Distance of the ball on the floor from the bed [m]."""
FINE = 0.006
"""Edges of the bed's faces around the dent [m]: chords of the ball sag by FINE^2 / (8 RADIUS), 0.04 mm."""
SIZE = 512
"""Width and height of pictures [pixels]."""
ROOM = "room"
VIEWS = {"front": (0.0, 25.0, 1.1), "side": (70.0, 15.0, 1.1), "above": (-40.0, 60.0, 1.1), ROOM: (20.0, 40.0, 3.8)}
"""Azimuth from the middle of the room and elevation [degrees], and distance [m] of each camera from what was asked."""
SETTLED, FLOATING, SUNK, ON_THE_FLOOR = "settled", "floating", "sunk", "on_the_floor"
STRUCTURE = ("floor", "ceiling", "wall", "window", "door")
COLOR = (40, 50, 110)

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class KnownAnswer:
    """A pair of which one is better on one axis, whoever looks."""

    better: JudgedPlacement
    worse: JudgedPlacement
    axis: JudgedAxis


def known_answers(room_name: str, seed: int = 0) -> list[KnownAnswer]:
    """The three pairs of a room; InputError if it has no bed, or no free floor beside it."""
    room = BallOnBed(room_name, build_room(room_name, seed))
    good = room.placement(SETTLED)
    return [
        KnownAnswer(good, room.placement(FLOATING), JudgedAxis.PHYSICS_NATURALNESS),
        KnownAnswer(good, room.placement(SUNK), JudgedAxis.PHYSICS_NATURALNESS),
        KnownAnswer(good, room.placement(ON_THE_FLOOR), JudgedAxis.RIGHT_PLACE),
    ]


@dataclass(frozen=True, eq=False)
class BallOnBed:
    """A room with a bed and four places of a ball."""

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
    def bed_bounds(self) -> Array:
        """Lowest and highest corner of the bed [m], shape (2, 3)."""
        return self.room.record.mesh.submesh(np.flatnonzero(self.room.face_instance == self.bed)).bounds

    @cached_property
    def caster(self) -> Raycaster:
        """The room as it is."""
        return Raycaster(self.room.record.mesh)

    @cached_property
    def target(self) -> Array:
        """The middle of the bed's top [m], shape (3,)."""
        return self.below(self.bed_bounds.mean(axis=0)[:2])[0]

    def below(self, xy: Array, height: float = 1.6) -> tuple[Array, str]:
        """What a plumb line hits from `height` over the floor: point [m], shape (3,), and label."""
        start = np.array([[xy[0], xy[1], self.bed_bounds[0, 2] + height]])
        hit = self.caster.cast(start, np.array([[0.0, 0.0, -1.0]]))
        face = int(hit.face[0])
        label = self.room.instance_labels[int(self.room.face_instance[face])] if face >= 0 else ""
        return np.array([*xy, hit.position[0, 2]]), label

    @cached_property
    def floor(self) -> Array:
        """A point of the floor beside the bed that a ball fits on [m], shape (3,)."""
        low, high = self.bed_bounds[:, :2]
        middle, reach = 0.5 * (low + high), 0.5 * (high - low) + BESIDE + RADIUS
        for step in ((0, 1), (1, 0), (-1, 0), (0, -1)):
            point, label = self.below(middle + reach * np.array(step))
            if label in ("floor", "rug") and self.clearance(raised(point, 2 * RADIUS)) >= RADIUS:
                return point
        raise InputError(f"room {self.name} has no free floor beside its bed; known answers need some")

    def clearance(self, point: Array) -> float:
        """Distance of a point from the room's surfaces [m]."""
        return float(self.caster.distance_to(point[None])[0])

    def center(self, kind: str) -> Array:
        """Middle of the ball in a placement [m], shape (3,)."""
        if kind == ON_THE_FLOOR:
            return raised(self.floor, RADIUS)
        height = {SETTLED: RADIUS - DENT, FLOATING: RADIUS + OFF, SUNK: RADIUS - OFF}[kind]
        return raised(self.target, height)

    @cached_property
    def dented(self) -> tuple[Mesh, NDArray[np.bool_]]:
        """The room with the settled ball's dent, and which of its faces are structure."""
        structure = np.isin(np.array(self.room.instance_labels)[self.room.face_instance], STRUCTURE)
        around = np.stack([self.target - 1.5 * RADIUS, self.target + 1.5 * RADIUS])
        soft = self.room.face_instance == self.bed
        fine = subdivide_near(self.room.record.mesh.submesh(np.flatnonzero(soft)), around, FINE)
        center, vertices = self.center(SETTLED), fine.vertices.copy()
        away = np.linalg.norm(vertices[:, :2] - center[:2], axis=1)
        top = np.abs(vertices[:, 2] - self.target[2]) < RADIUS
        vertices[top, 2] -= skirt(away[top])
        under = center[2] - np.sqrt(np.clip(RADIUS**2 - away**2, 0.0, None))
        pressed = top & (away < RADIUS) & (vertices[:, 2] > under)
        vertices[pressed, 2] = under[pressed]
        rest = self.room.record.mesh.submesh(np.flatnonzero(~soft))
        mesh = Mesh.concatenate([rest, Mesh(vertices, fine.faces, fine.colors)])
        return mesh, np.concatenate([structure[~soft], np.zeros(len(fine.faces), dtype=bool)])

    @cached_property
    def undented(self) -> tuple[Mesh, NDArray[np.bool_]]:
        """The room as it is, and which of its faces are structure."""
        structure = np.isin(np.array(self.room.instance_labels)[self.room.face_instance], STRUCTURE)
        return self.room.record.mesh, structure

    def scene(self, kind: str) -> tuple[Mesh, NDArray[np.bool_]]:
        """The room of a placement: only under the settled ball does the bed give way."""
        return self.dented if kind == SETTLED else self.undented

    def metrics(self, kind: str) -> Metrics:
        """What geometry tells of a placement; residual and drift, which a simulation would tell, are null."""
        center = self.center(kind)
        distance = float(Raycaster(self.scene(kind)[0]).distance_to(center[None])[0])
        on_bed = kind != ON_THE_FLOOR
        touching = distance <= RADIUS + FINE
        depth = DENT if kind == SETTLED else 0.0
        return {
            "support_hit": on_bed,
            "part_hit": on_bed,
            "region_distance_m": float(np.linalg.norm(center[:2] - self.target[:2])),
            "orientation_error_deg": None,
            "penetration_m": max(0.0, RADIUS - distance),
            "gap_m": max(0.0, distance - RADIUS),
            "indentation_error_m": abs(DENT - depth) if on_bed else None,
            "force_residual": None,
            "drift_m": None,
            "drift_deg": None,
            "visible_fraction": None,
            "com_supported": touching,
        }

    def placement(self, kind: str) -> JudgedPlacement:
        """A placement as a judge gets it; `method` is what is wrong with it."""
        return JudgedPlacement(
            sample=self.name,
            method=kind,
            prompt=PROMPT,
            object_name=OBJECT,
            metrics=self.metrics(kind),
            before=(
                NamedPicture("clean", lambda: self.seen(None, ROOM)),
                NamedPicture("asset", lambda: asset()),
            ),
            views=tuple(NamedPicture(view, lambda view=view: self.seen(kind, view)) for view in VIEWS),  # type: ignore[misc]
        )

    def seen(self, kind: str | None, view: str) -> NDArray[np.uint8]:
        """A view of the room with the ball of a placement, without one for None."""
        azimuth, elevation = np.radians(VIEWS[view][:2])
        low, high = self.bed_bounds[:, :2]
        toward = np.arctan2(*(np.mean(self.undented[0].bounds[:, :2], axis=0) - 0.5 * (low + high))[::-1])
        away = np.array([
            np.cos(elevation) * np.cos(toward + azimuth), np.cos(elevation) * np.sin(toward + azimuth),
            np.sin(elevation),
        ])  # fmt: skip
        mesh, structure = self.scene(kind) if kind else self.undented
        target = raised(self.target, 0.5 * RADIUS)
        camera = looking_at(target + VIEWS[view][2] * away, target, SIZE, SIZE)
        shown = mesh.submesh(np.flatnonzero(~cut_faces(mesh, structure, camera.position, target)))
        things = [shown] if kind is None else [shown, ball(self.center(kind))]
        return picture(things, camera, samples=1).rgb


def raised(point: Array, height: float) -> Array:
    """A point so much higher [m], shape (3,)."""
    return np.asarray(point + np.array([0.0, 0.0, height]))


def skirt(away: Array) -> Array:
    """How far a soft surface sinks around a ball that has sunk in by DENT [m], at distances from its axis, shape (n,).

    Outside of the contact, radius a = sqrt(RADIUS DENT): ((2 a^2 - r^2) asin(a / r) + a sqrt(r^2 - a^2)) / (pi RADIUS)
    [J85]; within it the depth at its rim, from where the ball itself presses.
    [J85] Johnson, Contact Mechanics, 1985, eq. 3.42a.
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
    camera = looking_at(np.array([0.0, -5.0 * RADIUS, 2.0 * RADIUS]), np.zeros(3), SIZE, SIZE)
    return picture([ball(np.zeros(3))], camera, samples=1).rgb
