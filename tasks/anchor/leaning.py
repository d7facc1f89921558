"""Start of a leaning object: tilted against a wall, a back or another thing, its foot at a stable distance.

In: scene, base, object, intent and the anchor's reply. Out: the pre-drop pose, the spot and the tilt, or the reason why
no start exists. The thin side of the object goes along the wall; it is tilted until its centre of mass lies clearly
beyond its lower edge, at least by `LEAST` (so that it presses against its support) and at most by `MOST` (so that
friction holds its foot: a ladder slides where the tangent of its angle from the vertical exceeds twice the coefficient
of friction, at 0.3 beyond 31 degrees). Set down on the base at a small distance, it is moved towards the thing that it
leans on until `GAP` is left; gravity does the rest.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation as Turn

from dcap.arrays import Array
from dcap.geometry.placement.clearance import Clearance, Start, set_down
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.polygons import clipped, counter_clockwise, smallest_rectangle
from dcap.geometry.placement.poses import about_z, center_of_mass
from dcap.geometry.placement.search import PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent, Lean
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution, Infeasible
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.anchor.choice import Choice, carrier_masks, choice_of
from tasks.anchor.no_room import no_surface
from tasks.requests.surroundings import PART, boxes_of, parts_meant
from tasks.requests.views import room_center

LEAST, MOST = np.radians(12.0), np.radians(28.0)
"""Smallest and largest tilt [rad]."""
BEYOND = np.radians(4.0)
"""Tilt of the centre of mass beyond the balance on its edge [rad]."""
GAP = 0.004
"""Gap between the object and the thing that it leans on, and between its foot and the base [m]."""
STRIP = 0.04
"""Breadth of the strip in which a place for the object's middle is searched [m]."""
FARTHEST = 0.6
"""Largest distance that the object is moved towards the thing that it leans on [m]."""
THIN = 0.75
"""Ratio of width to length in plan below which an object has a thin side; the thin side goes along the wall [-]."""
Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False, slots=True)
class LeanSide:
    """An upright face to lean on."""

    middle: Array
    """Middle of the face, seen from above [m], shape (2,)."""
    toward: Array
    """Horizontal unit vector into the face, shape (2,)."""
    half: float
    """Half the width of the face [m]."""
    top: float
    """Height of the upper edge of the face [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class LeaningStart:
    """Position and pose of the start."""

    choice: Choice
    start: Start
    pose: Array
    """Object mesh as read to the world, its centre of mass at the origin, shape (4, 4)."""
    search: PlacementSearch
    lean: Lean


def leaning_start(
    scene: Segmentation, base: Instance, item: Mesh, pose: Array, intent: Intent, reply: AnchorReply, caster: Raycaster
) -> LeaningStart | Infeasible:
    """The start at the first suitable side of the thing that the object should lean on."""
    why = "there is nothing to lean on"
    for on, side in faces_to_lean_on(scene, base, intent.orientation.lean, reply.part_index):
        turned = aligned(item, pose, side.toward, turn=not intent.orientation.facing)
        tilt = tilt_of(item.transformed(turned), side.toward)
        squat = tilt > MOST
        tilt = 0.0 if squat else tilt
        tilted = tilted_pose(item, turned, side.toward, tilt)
        mesh = item.transformed(tilted)
        if not squat and base.parts[reply.part_index].box.top + float(-mesh.bounds[0, 2]) > side.top:
            why = "its middle would be above the thing that it leans on"
            continue
        choice = choice_of(scene, base, intent, reply, mesh)
        found = set_against(scene, base, choice, (intent, on), mesh, side, caster)
        if found is not None:
            start, search = found
            axis = np.array([*(np.sin(tilt) * side.toward), np.cos(tilt)])
            noted = replace(choice, note=note_of(intent.orientation.lean, on, squat=squat))
            return LeaningStart(noted, start, tilted, search, Lean(on, tilt, axis))
        why = "there is no free place in front of it"
    part, asked = base.parts[reply.part_index].name, intent.orientation.lean
    text = f"{intent.object_name} cannot lean on {asked} on the {part} of {base.label}: {why}"
    return no_surface(text, base, part, "leaning", (asked,))


def note_of(asked: str, on: str, *, squat: bool) -> str:
    """Note on deviations from the requested leaning."""
    other = f"leaning on {on}: there is no free place in front of {asked}" if on != asked else ""
    upright = f"it is too thick for its height to lean: it stands on its own, right against {on}" if squat else ""
    return Caution(Cause.NOT_MET, "; ".join(note for note in (other, upright) if note))


# things to lean on -------------------------------------------------------------------------------------------------


def faces_to_lean_on(
    scene: Segmentation, base: Instance, asked: str, part_index: int
) -> Iterator[tuple[str, LeanSide]]:  # fmt: skip
    """The faces of the requested thing; for a wall also those of the other walls, since any wall will do."""
    yield from ((asked, side) for side in sides_of(scene, base, asked, part_index))
    if asked.startswith(PART):
        return
    wall = scene.instances[scene.index_of(asked)]
    for one in scene.instances:
        if wall.structure and one.structure and one.label == wall.label and one.id != asked:
            yield from ((one.id, side) for side in sides_of(scene, base, one.id, part_index))


def sides_of(scene: Segmentation, base: Instance, on: str, part_index: int) -> Iterator[LeanSide]:
    """The upright faces to lean on, the likeliest first: of a wall the one towards the room, of a back the one towards
    the seat, of a thing its front, then its other sides starting from the room."""
    if on.startswith(PART):
        before = base.parts[part_index].box.center
        for box in sorted(boxes_of(scene, base, on), key=lambda box: -float(np.prod(box.half_extents))):
            yield max(faces_of_box(box), key=lambda face: float(-face.toward @ (before - box.center)[:2]))
        return
    thing = scene.instances[scene.index_of(on)]
    inward = room_center(scene) - thing.box.center
    ahead = inward if thing.structure or thing.front is None else thing.front
    ordered = sorted(faces_of_box(thing.box), key=lambda face: float(face.toward @ ahead[:2]))
    if thing.structure:  # the broad face of a wall
        yield max(ordered[:2], key=lambda face: face.half)
        return
    yield from ordered


def faces_of_box(box: OrientedBox) -> list[LeanSide]:
    """The four upright faces of a box."""
    found = []
    for axis in (0, 1):
        for sign in (1.0, -1.0):
            outward = sign * box.axes[:2, axis]
            middle = box.center[:2] + box.half_extents[axis] * outward
            found.append(LeanSide(middle, -outward, float(box.half_extents[1 - axis]), box.top))
    return found


# the pose -----------------------------------------------------------------------------------------------------------


def aligned(item: Mesh, pose: Array, toward: Array, *, turn: bool) -> Array:
    """The pose turned about the vertical by the smallest angle that puts a side along the face, preferably the thin
    side. Not turned if a facing is requested."""
    mesh = item.transformed(pose)
    along, size = smallest_rectangle(mesh.vertices[np.unique(mesh.faces)][:, :2])
    if not turn:
        return pose
    across = np.array([-along[1], along[0]])
    angle = float(np.arctan2(across[0] * toward[1] - across[1] * toward[0], across @ toward))
    period = np.pi if size[1] < THIN * size[0] else np.pi / 2
    matrix = np.eye(4)
    matrix[:3, :3] = about_z(angle - period * np.round(angle / period))
    return np.asarray(matrix @ pose)


def tilt_of(mesh: Mesh, toward: Array) -> float:
    """Tilt towards a face at which the object presses against the face [rad]: its middle beyond its edge."""
    depth = mesh.vertices[:, :2] @ toward
    # the centre of mass is at the origin
    low, high = mesh.bounds[:, 2]
    foot = float(low + 0.1 * (high - low)) + 1e-9
    edge, height = float(depth[mesh.vertices[:, 2] < foot].max()), float(-low)
    return max(float(LEAST), float(np.arctan2(edge, height) + BEYOND))


def tilted_pose(item: Mesh, pose: Array, toward: Array, angle: float) -> Array:
    """The pose tilted towards a face, the centre of mass at the origin, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Turn.from_rotvec(angle * np.cross(Z, [*toward, 0.0])).as_matrix()
    tilted = matrix @ pose
    tilted[:3, 3] -= center_of_mass(item.transformed(tilted))
    return np.asarray(tilted)


# the place ----------------------------------------------------------------------------------------------------------


def set_against(
    scene: Segmentation, base: Instance, choice: Choice, asked: tuple[Intent, str], mesh: Mesh, side: LeanSide,
    caster: Raycaster,
) -> tuple[Start, PlacementSearch] | None:  # fmt: skip
    """The place in front of a face, moved against the face; None if there is no place. `asked` includes the thing to
    lean on."""
    intent, on = asked
    exact = Clearance(mesh, scene.mesh, caster)
    held = scene.face_instance == scene.index_of(base.id if on.startswith(PART) else on)
    if on.startswith(PART):
        held &= np.isin(scene.face_part, parts_meant(scene, base, on))
    sideways = Sideways(mesh, scene.mesh.submesh(np.flatnonzero(held)), side.toward)
    for mask in carrier_masks(scene, base, choice.index, intent, caster):
        search = PlacementSearch(scene.mesh, caster, mask, mesh)
        areas = [strip for area in (*choice.areas, *choice.spare) for strip in strips(area, mesh, side, search.cell)]
        start = set_down(search, exact, areas, GAP)
        if start is not None and (moved := against(start, search, exact, sideways)) is not None:
            return moved, search
    return None


def strips(area: Region, mesh: Mesh, side: LeanSide, cell: float) -> list[Region]:
    """Strips for the object's middle at a small distance in front of the face, because samples cannot touch; cut to the
    area."""
    reach = float((mesh.vertices[:, :2] @ side.toward).max()) + 3.0 * cell
    along = np.array([-side.toward[1], side.toward[0]])
    wide = max(side.half - 0.25 * float(np.ptp(mesh.vertices[:, :2] @ along)), 0.05)
    near, far = side.middle - reach * side.toward, side.middle - (reach + STRIP + cell) * side.toward
    ring = np.array([near - wide * along, near + wide * along, far + wide * along, far - wide * along])
    polygon = clipped(counter_clockwise(ring), area.polygon)
    if len(polygon) < 3:
        return []
    offset = float(np.clip((area.target - side.middle) @ along, -wide, wide))
    return [replace(area, polygon=polygon, target=near + offset * along)]


class Sideways:
    """Horizontal distance of an object from the thing that it leans on, as a clearance in a frame whose down axis
    points there."""

    def __init__(self, item: Mesh, held: Mesh, toward: Array) -> None:
        """`toward`: horizontal unit vector to the thing to lean on, shape (2,)."""
        down = np.array([*toward, 0.0])
        self.turn = np.stack([Z, np.cross(-down, Z), -down])  # rows: a right-handed frame whose -z is `toward`
        matrix = np.eye(4)
        matrix[:3, :3] = self.turn
        turned = held.transformed(matrix)
        self.clearance = Clearance(item.transformed(matrix), turned, Raycaster(turned))

    def gap(self, place: Array) -> float:
        """Smallest distance to the thing to lean on, for the object's origin at `place` [m]; inf if they would not
        meet."""
        return self.clearance.gap(self.turn @ place)


def against(start: Start, search: PlacementSearch, exact: Clearance, sideways: Sideways) -> Start | None:
    """The start moved until only the gap to its support is left; None if the support is too far away or obstructed."""
    place = np.array([start.spot.x, start.spot.y, start.height])
    toward = np.array([*-sideways.turn[2, :2], 0.0])
    for _ in range(2):  # after the move its foot may stand slightly higher or lower
        way = sideways.gap(place)
        if not np.isfinite(way) or way > FARTHEST:
            return None
        place = place + (way - GAP) * toward
        place[2] += GAP - exact.gap(place)
    points, _ = exact.cuts(place)
    measured = exact.gap(place)
    if len(points) or not np.isfinite(measured):
        return None
    spot = replace(start.spot, x=float(place[0]), y=float(place[1]))
    return Start(start.region, spot, float(place[2]), measured)
