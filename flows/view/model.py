"""A placement for the viewer, as plain arrays and colours: nothing here knows of a browser.

In: results of the stages. Out: `PlacementView`. A placement without a rest state shows as much as is known: the room,
the pose before the drop, and the pose in which the drop ended.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn

from dcap.arrays import Array
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.surface import ShadingNormals
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import CornerPaint, PaintedMesh, SourceSurface
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import SoftSimulationBody
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import LastState
from flows.place import PlaceConfig
from flows.placement_json import Values
from flows.view.looks import ShownScene, fitted_textures, shown_object, shown_scene
from flows.view.surface import DrawnSurface, MovingObject, MovingSurfaces, drawn, most_frames, moving_object, seen_from
from tasks.overview import camera_for
from tasks.render.motion import DropMotion, MovingScene

DEEP, LEVEL, RAISED = (24, 62, 158), (236, 236, 236), (196, 52, 38)
"""Colours of the deepest dent, of unmoved points, and of an equally large bulge."""
LEAST_SPAN = 1e-4
"""Least span of the dent's colours [m]: smaller displacements are noise."""
DISTINCT = (
    (230, 120, 30), (40, 120, 190), (60, 160, 90), (150, 90, 180), (200, 60, 90), (120, 120, 60), (90, 180, 190),
    (140, 90, 60),
)  # fmt: skip
"""Colours of materials, repeated where there are more."""
MOST_MOVING = 2_500_000
"""Most moving faces, summed over all frames: the page gets all of them at once, so that it plays without gaps [-]."""
MOST_POINTS = 60_000
"""Most material points of a body that are drawn [-]."""
UNASSIGNED = "unassigned"
HOVER = 1.5e-3
"""Offset of drawn contact points from the surface, which would hide them [m]."""
OFF_WALL, OFF_FLOOR = 0.3, 0.5
"""Distance that a point inside the room keeps from a wall and from the floor [m]."""
LEAST_DOT, LARGEST_DOT = 1e-3, 8e-3
"""Size of the dot of a contact point [m]: a few points far apart stay points."""
UP = np.array([0.0, 0.0, 1.0])


def heat_colors(height: Array, span: float) -> NDArray[np.uint8]:
    """sRGB colours of displacements along the outward normal (n,) [m], shape (n, 3)."""
    share = np.clip(height / span, -1.0, 1.0)[:, None]
    end = np.where(share < 0.0, np.array(DEEP, dtype=float), np.array(RAISED, dtype=float))
    middle = np.array(LEVEL, dtype=float)
    return np.asarray(np.round(middle + np.abs(share) * (end - middle)), dtype=np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class StartView:
    """Initial pose of the camera."""

    position: Array
    target: Array
    fov_deg: float
    """Vertical field of view [degrees]."""


@dataclass(frozen=True, eq=False, slots=True)
class RoomPiece:
    """One part of one thing of the room."""

    instance: str
    label: str
    part: str
    structure: bool
    """Whether it is a wall, ceiling or floor, which is drawn from its inner side only."""
    ceiling: bool
    surface: DrawnSurface
    """Its faces that keep their shape; None if all bend."""
    number: int
    """Index of the part in its instance, -1 where the faces belong to none."""
    poses: Array | None = None
    """World-from-start map at each frame of a thing that moves rigidly, shape (f, 4, 4); None: it does not move."""
    bends: tuple[int, int] | None = None
    """Instance and part of its faces that bend, if there are any."""


@dataclass(frozen=True, eq=False, slots=True)
class MaterialCloud:
    """Material points of one body that are of one material."""

    body: str
    material: str
    points: NDArray[np.float32]
    """Before the drop [m], shape (n, 3)."""
    color: tuple[int, int, int]
    size: float
    """[m]."""


@dataclass(frozen=True, eq=False, slots=True)
class ContactDots:
    """The contact patch."""

    points: NDArray[np.float32]
    """[m], shape (k, 3)."""
    size: float
    """[m]."""


@dataclass(frozen=True, eq=False, slots=True)
class AnchorMark:
    """Intended place of the object."""

    point: Array
    """x_s on the surface [m], shape (3,)."""
    normal: Array
    """Unit outward normal of the surface there, shape (3,)."""
    above: Array
    """Start of the vertical ray: the middle of the object before the drop [m], shape (3,)."""
    reach: float
    """Drawn length of the normal [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacementView:
    """Everything that is drawn."""

    pieces: tuple[RoomPiece, ...]
    view: StartView
    thing: MovingObject | None
    """None if no stage reached a pose."""
    bending: MovingSurfaces | None
    """None if nothing dents."""
    base_id: str
    span: float
    """Largest displacement of the base's dent at rest [m]."""
    frames: NDArray[np.int64]
    """Indices of the drop's frames that are shown, shape (f,)."""
    time: Array
    """Times of these frames [s], shape (f,)."""
    settled: bool
    """Whether the drop came to rest."""
    whole: bool
    """Whether frames between the start and the end were kept."""
    contact: ContactDots | None
    anchor: AnchorMark | None
    clouds: tuple[MaterialCloud, ...]
    notes: tuple[str, ...]
    """Simplifications of the view, one sentence each."""


def placement_view(values: Values, config: PlaceConfig) -> PlacementView:
    """View of a placement, feasible or not."""
    scene, item, anchor, settled = values.scene, values.item, values.anchor, values.settled
    assert scene is not None
    assert item is not None
    shown = shown_scene(scene, values.scene_surface, anchor, settled)
    motion = DropMotion(settled) if settled is not None and anchor is not None else None
    moving = MovingScene(shown.scene, motion, anchor.base_id) if motion and anchor else None
    look = shown.look(moving.scene.mesh, moving.origin) if moving else whole_look(shown)
    bends = moving.bending() if moving else np.zeros(len(look.mesh.faces), dtype=bool)
    last = len(motion.time) - 1 if motion else 0
    bending = MovingSurfaces(moving, look, bends) if moving and bends.any() else None
    notes, frames = shown.notes, np.arange(last + 1)
    thing: MovingObject | None = None
    if anchor is not None:
        start, more = shown_object(item, values.object_surface, anchor)
        notes += more
        thing = moving_object(start, motion) if motion else unsettled_object(start, values.infeasible)
        frames = motion.chosen(most_frames(bending, thing, MOST_MOVING)) if motion else np.arange(len(thing.poses))
        if len(frames) <= last:
            notes += (f"{len(frames)} of the {last + 1} frames of the drop are shown",)
    view = start_view(values, config)
    base_id = anchor.base_id if anchor else ""
    around = moving.scene if moving else shown.scene
    poses = {one.instance: one.points.poses() for one in moving.things if not one.points.bends} if moving else {}
    pieces = list(room_pieces(around, look, bends, inside_near(scene, view.target), poses))
    textures = fitted_textures([one.surface.paint for one in pieces], thing, bending, len(frames))
    if thing is not None:
        thing = replace(thing, start=replace(thing.start, paint=textures.thing))
    if bending is not None:
        bending.paints = textures.bending
    return PlacementView(
        pieces=repainted(pieces, textures.pieces),
        view=view,
        thing=thing,
        bending=bending,
        base_id=base_id,
        span=max(float(np.abs(bending.heights(last, base_id)).max(initial=0.0)) if bending else 0.0, LEAST_SPAN),
        frames=frames,
        time=motion.time[frames] if motion else frames.astype(float),
        settled=motion is not None,
        whole=motion.whole if motion else True,
        contact=contact_dots(settled.contact_points) if settled else None,
        anchor=anchor_mark(scene, item, anchor) if anchor else None,
        clouds=tuple(material_clouds(values)),
        notes=notes + textures.notes,
    )


def scene_view(scene: Segmentation, config: PlaceConfig, surface: SourceSurface | None = None) -> PlacementView:
    """View of a scene in which nothing is placed yet."""
    shown = shown_scene(scene, surface or SourceSurface.untextured(), None, None)
    camera = camera_for(scene, None, None, config.overview)
    view = StartView(camera.position, camera.target, config.overview.fov_deg)
    look = whole_look(shown)
    pieces = list(room_pieces(shown.scene, look, np.zeros(len(look.mesh.faces), dtype=bool), middle_of(scene), {}))
    textures = fitted_textures([one.surface.paint for one in pieces], None, None, 1)
    return PlacementView(
        repainted(pieces, textures.pieces), view, None, None, "", 1.0, np.zeros(1, dtype=np.int64), np.zeros(1),
        False, True, None, None, (), shown.notes + textures.notes,
    )  # fmt: skip


def whole_look(shown: ShownScene) -> PaintedMesh:
    """Look of a scene in which nothing moves."""
    return shown.look(shown.scene.mesh, np.arange(len(shown.scene.mesh.faces)))


def repainted(pieces: Sequence[RoomPiece], paints: Sequence[CornerPaint | None]) -> tuple[RoomPiece, ...]:
    """The pieces in other paints."""
    return tuple(
        replace(one, surface=replace(one.surface, paint=paint)) for one, paint in zip(pieces, paints, strict=True)
    )


def room_pieces(
    scene: Segmentation, look: PaintedMesh, bends: NDArray[np.bool_], inside: Array, poses: Mapping[int, Array]
) -> Iterator[RoomPiece]:
    """The parts of all things without the faces that bend (m,), and the poses of instances that move rigidly.
    Structures are wound so that they are only seen from a point inside [m]."""
    structure = np.array([one.structure for one in scene.instances] + [False])[scene.face_instance]
    look = seen_from(look, structure, inside)
    normals = ShadingNormals(look.mesh).of_corners(np.arange(len(look.mesh.faces)))
    for index, one in enumerate([*scene.instances, None]):
        owner = index if one else -1
        for number in range(-1, len(one.parts) if one else 0):
            mine = scene.face_instance == owner
            mine &= (scene.face_part == number) | (one is None)
            if not mine.any():
                continue
            yield RoomPiece(
                instance=one.id if one else UNASSIGNED,
                label=one.label if one else "",
                part=one.parts[number].name if one and number >= 0 else "",
                structure=bool(one and one.structure),
                ceiling=bool(one and one.structure and one.label == "ceiling"),
                surface=drawn(look, np.flatnonzero(mine & ~bends), normals),
                number=number,
                poses=poses.get(owner),
                bends=(owner, number) if (mine & bends).any() else None,
            )


def unsettled_object(start: PaintedMesh, why: Infeasible | None) -> MovingObject:
    """The object at its release, and at the end of the drop if there was one."""
    poses = [np.eye(4)]
    last = why.evidence if why else None
    if isinstance(last, LastState):
        end = np.eye(4)
        end[:3, :3] = Turn.from_quat(last.quaternion, scalar_first=True).as_matrix()
        end[:3, 3] = last.position
        poses.append(end)
    return MovingObject(start, np.stack(poses))


def start_view(values: Values, config: PlaceConfig) -> StartView:
    """Initial camera: that of the pictures."""
    renders = values.renders
    if renders is not None:
        return StartView(renders.camera_position, renders.camera_target, config.render.fov_deg)
    assert values.scene is not None
    camera = camera_for(values.scene, values.intent, values.anchor, config.overview)
    return StartView(camera.position, camera.target, config.overview.fov_deg)


def middle_of(scene: Segmentation) -> Array:
    """The middle of a scene's box [m], shape (3,)."""
    return np.asarray(scene.mesh.bounds.mean(axis=0))


def inside_near(scene: Segmentation, target: Array) -> Array:
    """A point inside the room near a target, which may lie on the floor or at a wall [m], shape (3,)."""
    low, high = scene.mesh.bounds
    way = 0.5 * (low + high) - target
    flat = float(np.linalg.norm(way[:2]))
    inside = target.copy()
    inside[:2] += way[:2] * min(1.0, OFF_WALL / flat if flat > 0.0 else 0.0)
    inside[2] += min(OFF_FLOOR, 0.5 * max(float(high[2] - target[2]), 0.0))
    return inside


def contact_dots(points: Array) -> ContactDots | None:
    """The contact patch as dots that nearly touch."""
    if not len(points):
        return None
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    size = np.clip(0.5 * extent / np.sqrt(len(points)), LEAST_DOT, max(LEAST_DOT, min(LARGEST_DOT, 0.04 * extent)))
    return ContactDots((points + HOVER * UP).astype(np.float32), float(size))


def anchor_mark(scene: Segmentation, item: Segmentation, anchor: Anchor) -> AnchorMark:
    """The anchor with the normal of the surface under it, and the way down to it."""
    low, high = item.mesh.transformed(anchor.world_from_object).bounds
    above = anchor.surface_point.copy()
    above[2] = max(0.5 * (low + high)[2], above[2])
    mine = scene.mesh.submesh(np.flatnonzero(scene.face_instance == scene.index_of(anchor.base_id)))
    hit = Raycaster(mine).cast(anchor.surface_point[None] + 1e-3 * UP, -UP[None])
    normal = hit.normal[0] if hit.face[0] >= 0 else UP
    reach = float(np.clip(0.5 * np.linalg.norm(high - low), 0.05, 0.4))
    return AnchorMark(anchor.surface_point, normal if normal[2] >= 0.0 else -normal, above, reach)


def material_clouds(values: Values) -> Iterator[MaterialCloud]:
    """Material points of the soft bodies before the drop, coloured by material."""
    if values.particles is None:
        return
    names: dict[str, int] = {}
    for body in values.particles.bodies:
        if not isinstance(body, SoftSimulationBody):
            continue
        points = body.points
        step = max(1, -(-len(points.position) // MOST_POINTS))
        stiffness, volume = points.youngs_modulus[::step], points.volume[::step]
        for one in np.unique(stiffness):
            mine = stiffness == one
            name = material_name(values, body.instance, float(one))
            number = names.setdefault(name, len(names))
            yield MaterialCloud(
                body.name, name, points.position[::step][mine].astype(np.float32), DISTINCT[number % len(DISTINCT)],
                float(np.cbrt(step * np.median(volume[mine]))) * 0.5,
            )  # fmt: skip


def material_name(values: Values, instance: str, stiffness: float) -> str:
    """The material of an instance that has this Young's modulus [Pa], or the modulus where several or none do."""
    rows = values.materials.rows if values.materials else ()
    found = {
        row.material.id for row in rows if row.body == instance and np.isclose(row.material.youngs_modulus, stiffness)
    }
    return found.pop() if len(found) == 1 else f"E = {stiffness:.3g} Pa"


def still(surface: DrawnSurface) -> DrawnSurface:
    """A surface in the colour of unmoved points: the base of a heat map."""
    return surface.colored(np.broadcast_to(np.array(LEVEL, dtype=np.uint8), surface.mesh.colors.shape))
