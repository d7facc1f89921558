"""What was asked of an orientation as directions of the mesh, and whether the shape tells it.

In: the rotation question, the pose that was chosen and the name of the thing. Out: `AskedPose`, which the drop compares
with the rest state. The thing's own upright axis is that of the pose in which it usually rests.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.language.offline.lexicon import is_a, thing_of
from dcap.language.offline.pose_choice import default_pose, meant
from dcap.language.protocol.requests import PoseView, RotationRequest
from dcap.scene.types.rotation import AskedPose

Array = NDArray[np.float64]

UP = np.array([0.0, 0.0, 1.0])
SIDE_TOLD = "its shape does not tell which side is its front"
UP_TOLD = "its shape does not clearly tell which way is up, and its file has it on another side"
CLEAR = 0.15
"""By so much more than for any other side must a shape speak for the one it is put on [-]: of sixteen household things
in three turns each those put on a wrong side had at most 0.12, and all but eight of those put right more than this."""
BY_FRONT = {"on_back": 0.0, "on_front": np.pi}
BY_LEFT = {"on_left_side": np.pi, "on_right_side": 0.0}
BY_UP = {"upside_down": np.pi, "on_side": 0.5 * np.pi, "lying": 0.5 * np.pi}
"""Angle from the vertical of the front, of the own left and of the own upright axis that a pose means [rad]."""


def asked_pose(request: RotationRequest, chosen: Array, pose_id: str, lead: float) -> AskedPose | None:
    """What the request asks for; `chosen` is the rotation that was taken, shape (3, 3). None if it asks for nothing.

    `lead` is by how much the shape prefers its best side to any other [-].
    """
    name = asked_name(request)
    if name == "any" and not request.facing and request.turn_deg == 0.0:
        return None
    rest = usual_pose(request, pose_id)
    up, front = np.array(rest.rotation).T @ UP, np.array(rest.rotation).T @ np.array(rest.front)
    axis, angle = aim(request, rest, chosen, up, front)
    facing_doubt = SIDE_TOLD if request.facing and not request.has_front else ""
    return AskedPose(name, axis, angle, up, front, doubt(request, rest, lead), facing_doubt)


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


def aim(request: RotationRequest, rest: PoseView, chosen: Array, up: Array, front: Array) -> tuple[Array, float | None]:
    """The direction of the mesh that the pose is about and its angle from the vertical [rad]; None: as chosen."""
    thing = thing_of(request.object_name)
    wanted = meant(request, thing, rest)
    if wanted in BY_FRONT:
        return front, BY_FRONT[wanted]
    if wanted in BY_LEFT:
        return np.cross(up, front), BY_LEFT[wanted]
    if wanted in BY_UP:
        return up, BY_UP[wanted]
    stands = thing is None or thing.rest == "upright"
    if wanted == "any" and (request.pose == "upright" or (request.pose == "seated" and stands)):
        return up, 0.0
    return np.asarray(chosen.T @ UP), None


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
    if rest.id == "upright" and request.righting > 0.0 and not believed:
        return "by its shape it may rather stand on another side than in its file"
    return ""
