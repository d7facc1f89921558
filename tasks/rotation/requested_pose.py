"""Turns a requested orientation into directions of the mesh and the world, if the shape determines them.

In: the rotation question, its reply and the mesh. Out: `AskedPose`, which the drop compares with the rest state. The
upright axis of the object is that of its usual rest pose; its shape decides whether it stands on end. The chosen
rotation is never taken as the request: a wrong choice must become visible.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.poses import about_z
from dcap.geometry.placement.resting_poses import end_axis, sits
from dcap.geometry.placement.upright import outermost
from dcap.knowledge.kinds import is_figure
from dcap.knowledge.lexicon import is_a, thing_of
from dcap.language.offline.pose_choice import LOW, default_pose, is_low, meant
from dcap.language.protocol.replies import RotationReply
from dcap.language.protocol.requests import PoseView, RotationRequest
from dcap.scene.types.choices import AskedPose
from dcap.scene.types.mesh import Mesh
from tasks.requests.surroundings import horizontal

LEVEL = 0.3
"""Horizontal part of a unit vector below which it points up or down [-]."""
UP = np.array([0.0, 0.0, 1.0])
SIDE_TOLD = "its shape does not show which side is its front"
NO_END = "its shape has no end to stand on, and no side to lie on"
UP_TOLD = "its shape does not clearly show which way is up, and its file has it on another side"
NO_SEAT = "in the chosen pose it stands, with no seat under its middle"
CLEAR = 0.15
"""Least lead of a shape's score for the chosen side over any other side [-], and least lead of another side to doubt a
trusted file. It is the uncertainty of the features: of 28 embedded things, nine in ten leads change by at most 0.13
when the things are taken as hollow instead of solid, and when the band that counts as contact is half or twice as high.
Of sixteen household things in three turns each, those put on a wrong side had at most 0.12, and all but eight of those
put right had more."""
BY_FRONT = {"on_back": 0.0, "on_front": np.pi}
BY_LEFT = {"on_left_side": np.pi, "on_right_side": 0.0}
BY_UP = {"upside_down": np.pi, "on_side": 0.5 * np.pi, "lying": 0.5 * np.pi}
"""Angles from the vertical of the front, of the left side and of the upright axis in a pose [rad]."""


def looking(front: Array, up: Array) -> Array:
    """Horizontal viewing direction of the object: along its front, or, if that is vertical, along its upright axis."""
    for axis in (front, up):
        flat = horizontal(axis)
        if flat is not None and np.linalg.norm(axis[:2]) > LEVEL:
            return flat
    return np.array([0.0, -1.0, 0.0])


def nearest_side(mesh: Mesh, matrix: Array, ahead: Array) -> Array:
    """For objects without a front: the outward side of the plan's smallest rectangle that is nearest to a direction."""
    along, _ = smallest_rectangle((outermost(mesh.vertices) @ matrix.T)[:, :2])
    sides = [np.array([x, y, 0.0]) for x, y in (along, -along, (-along[1], along[0]), (along[1], -along[0]))]
    return max(sides, key=lambda side: float(side @ ahead))


@dataclass(frozen=True, eq=False, slots=True)
class WantedLook:
    """Direction that defines a pose."""

    axis: Array
    """Direction of the mesh, unit, shape (3,)."""
    from_vertical: float | None
    """Angle of that direction from the vertical [rad]; None: the shape does not determine it."""
    either_way: bool = False


def requested_pose(
    request: RotationRequest, reply: RotationReply, chosen: Array, mesh: Mesh, lead: float
) -> AskedPose | None:
    """The requested pose, where `chosen` is the chosen rotation, shape (3, 3); None if no orientation was requested.

    `lead` is the lead of the shape's best side over any other [-].
    """
    name = asked_name(request)
    if name == "any" and not request.facing and request.turn_deg == 0.0:
        return None
    if reply.pose_id.startswith("righted"):
        rest = next(pose for pose in request.poses if pose.id == "righted")
    else:
        rest = default_pose(request, thing_of(request.object_name))[0]
    own = np.array(rest.rotation)
    up, front = own.T @ UP, own.T @ np.array(rest.front)
    aimed = aim(request, rest, mesh, up, front)
    facing_doubt = SIDE_TOLD if request.facing and not request.has_front else ""
    unsure = "" if aimed.either_way else doubt(request, rest, lead)  # extents need no up and no front
    if name != "any" and aimed.from_vertical is None:
        unsure = NO_END
    if name == "seated" and is_figure(request.object_name) is not False and not sits(mesh, up):
        unsure = f"{unsure}, and {NO_SEAT}" if unsure else NO_SEAT
    looks, ahead = wanted_look(request, reply, chosen, mesh, (front, own.T @ np.array(rest.up)))
    return AskedPose(
        name, aimed.axis, aimed.from_vertical, up, front, unsure, facing_doubt, aimed.either_way, looks, ahead
    )


def wanted_look(
    request: RotationRequest, reply: RotationReply, chosen: Array, mesh: Mesh, own: tuple[Array, Array]
) -> tuple[Array | None, Array | None]:
    """The direction of the mesh that faces ahead, and its requested direction in the world; `own` is its front and its
    upward direction, if known.

    For a facing it is the direction to the faced thing, plus the requested turn; for a turn alone it is the alignment
    without the reply's turn, plus the requested turn. A rotation given as a matrix has no alignment to turn from.
    """
    if not request.facing and (request.turn_deg == 0.0 or reply.quaternion is not None):
        return None, None
    looks = looking(chosen @ own[0], chosen @ own[1])
    if not request.facing:
        return chosen.T @ looks, about_z(np.radians(request.turn_deg - reply.turn_deg)) @ looks
    faced = next((np.array(one.direction) for one in request.facings if one.id == request.facing), None)
    if faced is None:
        return None, None
    ahead = about_z(np.radians(request.turn_deg)) @ faced
    # for an object without a front any side will do, as the note on the doubt says
    looks = looks if request.has_front else nearest_side(mesh, chosen, ahead)
    return chosen.T @ looks, ahead


def asked_name(request: RotationRequest) -> str:
    """Name of the pose to check; "any" if there is nothing to check, as a ball sits on every side."""
    thing = thing_of(request.object_name)
    free = request.pose == "seated" and thing is not None and thing.rest == "any"
    return "any" if free else request.pose or "any"


def aim(request: RotationRequest, rest: PoseView, mesh: Mesh, up: Array, front: Array) -> WantedLook:
    """The direction of the mesh that defines the pose, from the words and the shape."""
    thing = thing_of(request.object_name)
    kind = thing.rest if thing else "upright"
    wanted = meant(request, thing, rest)
    if wanted in BY_FRONT:
        return WantedLook(front, BY_FRONT[wanted])
    if wanted in BY_LEFT:
        return WantedLook(np.cross(up, front), BY_LEFT[wanted])
    if wanted in BY_UP:
        return WantedLook(up, BY_UP[wanted])
    if wanted == "standing" and (kind != "upright" or is_low(rest, LOW)):
        return of_shape(mesh, on_edge=request.pose != "standing", lies=False)
    if wanted == "any" and request.pose in ("lying", "on_side") and kind == "any":
        return of_shape(mesh, on_edge=True, lies=True)
    # its usual pose; a flat thing may lie on either side, unless the words name one
    return WantedLook(up, 0.0, kind == "flat" and request.pose not in ("on_back", "on_front"))


def of_shape(mesh: Mesh, *, on_edge: bool, lies: bool) -> WantedLook:
    """Standing on end, or lying, according to the object's extents."""
    found = end_axis(mesh, on_edge=on_edge)
    if found is None:
        return WantedLook(UP, None, either_way=True)
    axis, angle = found
    return WantedLook(axis, 0.5 * np.pi - angle if lies else angle, either_way=True)


def doubt(request: RotationRequest, rest: PoseView, lead: float) -> str:
    """Reason why the shape does not determine the requested pose; empty if it does, or if none was requested."""
    if asked_name(request) == "any":
        return ""
    thing = thing_of(request.object_name)
    about_front = meant(request, thing, rest) in (*BY_FRONT, *BY_LEFT)
    if about_front and not request.has_front:
        return SIDE_TOLD
    if rest.id == "righted" and lead < CLEAR:
        return UP_TOLD
    believed = thing is not None and (is_a(thing.id, "furniture") or thing.rest == "any")
    if rest.id == "upright" and request.righting > CLEAR and not believed:
        return "by its shape it may stand on another side than in its file"
    return ""
