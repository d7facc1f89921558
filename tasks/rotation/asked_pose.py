"""What was asked of an orientation as directions of the mesh and the world, and whether the shape tells it.

In: the rotation question, its reply and the mesh. Out: `AskedPose`, which the drop compares with the rest state. The
thing's own upright axis is that of the pose in which it usually rests; whether it stands on end its shape tells. The
chosen rotation is never what is asked: a wrong choice must show.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.ends import end_axis
from dcap.geometry.placement.poses import about_z
from dcap.geometry.placement.seat import sits
from dcap.language.offline.figures import is_figure
from dcap.language.offline.lexicon import is_a, thing_of
from dcap.language.offline.pose_choice import LOW, default_pose, is_low, meant
from dcap.language.protocol.replies import RotationReply
from dcap.language.protocol.requests import PoseView, RotationRequest
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.rotation import AskedPose
from tasks.rotation.looking import looking, nearest_side

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
SIDE_TOLD = "its shape does not tell which side is its front"
NO_END = "its shape has no end to stand on, and no side to lie on"
UP_TOLD = "its shape does not clearly tell which way is up, and its file has it on another side"
NO_SEAT = "as it is put it stands, with no seat under its middle"
CLEAR = 0.15
"""By so much more than for any other side must a shape speak for the one it is put on [-]; by more than this it must
speak for another side than that of a file that is believed, for this to be doubted. It is what features cannot tell: of
28 embedded things nine in ten leads change by 0.13 at most when they are taken as hollow instead of full, and when the
band that counts as contact is half or twice as high. Of sixteen household things in three turns each those put on a
wrong side had at most 0.12, and all but eight of those put right more than this."""
BY_FRONT = {"on_back": 0.0, "on_front": np.pi}
BY_LEFT = {"on_left_side": np.pi, "on_right_side": 0.0}
BY_UP = {"upside_down": np.pi, "on_side": 0.5 * np.pi, "lying": 0.5 * np.pi}
"""Angle from the vertical of the front, of the own left and of the own upright axis that a pose means [rad]."""


@dataclass(frozen=True, eq=False, slots=True)
class WantedLook:
    """What a pose is about."""

    axis: Array
    """Direction of the mesh, unit, shape (3,)."""
    from_vertical: float | None
    """Its angle from the vertical [rad]; None: the shape does not tell."""
    either_way: bool = False


def asked_pose(
    request: RotationRequest, reply: RotationReply, chosen: Array, mesh: Mesh, lead: float
) -> AskedPose | None:
    """What the request asks for; `chosen` is the rotation that was taken, shape (3, 3). None if it asks for nothing.

    `lead` is by how much the shape prefers its best side to any other [-].
    """
    name = asked_name(request)
    if name == "any" and not request.facing and request.turn_deg == 0.0:
        return None
    rest = usual_pose(request, reply.pose_id)
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
    """The direction of the mesh that looks ahead, and where in the world it shall look; `own` is its front and what
    is up where that was found.

    Of a facing that is what is faced, turned on by the turn that was asked; of a turn alone it is the alignment without
    the reply's turn, with the one that was asked. A rotation given as a whole has no alignment to turn from.
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
    # of what has no front any side will do, which its doubt says
    looks = looks if request.has_front else nearest_side(mesh, chosen, ahead)
    return chosen.T @ looks, ahead


def asked_name(request: RotationRequest) -> str:
    """The pose to check, any for none: a ball sits on every side."""
    thing = thing_of(request.object_name)
    free = request.pose == "seated" and thing is not None and thing.rest == "any"
    return "any" if free else request.pose or "any"


def usual_pose(request: RotationRequest, pose_id: str) -> PoseView:
    """How it usually rests: the righted pose where one of its kin was chosen, else as offline."""
    if pose_id.startswith("righted"):
        return next(pose for pose in request.poses if pose.id == "righted")
    return default_pose(request, thing_of(request.object_name))[0]


def aim(request: RotationRequest, rest: PoseView, mesh: Mesh, up: Array, front: Array) -> WantedLook:
    """The direction of the mesh that the pose is about, from the words and the shape."""
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
    # as it usually rests; what lies flat does so on both its sides, unless words say which
    return WantedLook(up, 0.0, kind == "flat" and request.pose not in ("on_back", "on_front"))


def of_shape(mesh: Mesh, *, on_edge: bool, lies: bool) -> WantedLook:
    """On end, or lying, as its extents have it."""
    found = end_axis(mesh, on_edge=on_edge)
    if found is None:
        return WantedLook(UP, None, either_way=True)
    axis, angle = found
    return WantedLook(axis, 0.5 * np.pi - angle if lies else angle, either_way=True)


def doubt(request: RotationRequest, rest: PoseView, lead: float) -> str:
    """Why the shape does not tell the pose that was asked; empty if it does, or nothing was asked of it."""
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
        return "by its shape it may rather stand on another side than in its file"
    return ""
