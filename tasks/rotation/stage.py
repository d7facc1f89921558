"""Stage 4, rotation: three pictures of the object over its base in, one rotation out.

In: scene, object, intent and prompt. Out: `Rotation`: R*, orthonormal, and exactly three pictures, the object flipped
by 180 degrees about x, y and z with the base fixed. The choices are: the pose of the file, its flips and quarter turns;
the same for the pose in which the shape stands, if that differs (a lying or overturned file), and the stable poses of
the convex hull, each before a turn about the vertical; and directions for the front. The front of an object is found in
its standing frame: by `dcap.geometry.placement.poses.front_of`, by the side on which its lower half reaches out, else
-y.
"""

from collections.abc import Sequence
from functools import cache, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, PositiveInt
from scipy.spatial.transform import Rotation as Turn

from dcap.arrays import Array
from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.poses import about_z, front_of, rotated, symmetry_about_z
from dcap.geometry.placement.resting_poses import FLIPS, on_legs, resting_poses
from dcap.geometry.placement.upright import outermost, standing_pose, stands_as_read
from dcap.knowledge.kinds import front_side, to_right
from dcap.knowledge.lexicon import thing_of
from dcap.language.connect import Client
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.questions import ROTATION
from dcap.language.protocol.replies import ROUNDED, RotationReply
from dcap.language.protocol.requests import FacingView, Picture, PoseView, RotationRequest, Vector, vector
from dcap.scene.errors import GeometryError, LanguageError
from dcap.scene.types.choices import POSE_OF_THE_FILE, Intent, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import Instance, Segmentation, SegmentedObject, SegmentedScene
from tasks.cache import stage
from tasks.requests.surroundings import direction_to, part_frame, wished_place
from tasks.requests.views import instance_of
from tasks.rotation.pose_pictures import pose_strip, three_flips
from tasks.rotation.requested_pose import looking, nearest_side, requested_pose

ELONGATED = 1.15
"""Ratio of length to width from which a thing is laid along its support [-]."""

SIDES = ("the viewer's side", "the right", "behind", "the left")
"""Viewpoints of pictures, in the words of a viewer of the support's front; all but the first only in an ablation."""
STRIP = "all other listed poses, each with its id below it, seen from the viewer's side"


class RotationConfig(BaseModel, frozen=True, extra="forbid"):
    """Language client, and size of the pictures."""

    language: LanguageConfig = LanguageConfig()
    picture_size: PositiveInt = 512
    """Width and height [pixels]."""
    chosen: bool = True
    """Choose a rotation; otherwise the pose of the file is kept: an ablation."""
    views: Literal[3, 12] = 3
    """Pictures for a model: three flips, or each from four sides: an ablation."""
    pose_strip: bool = False
    """One more picture shows all other poses with their ids: an ablation."""


def rotation(
    scene: SegmentedScene, item: SegmentedObject, intent: Intent, prompt: str, config: RotationConfig, client: Client
) -> Rotation | Infeasible:
    """Ask once with all choices and pictures, then build the matrix."""
    base = instance_of(scene, intent.base_id)
    mesh = item.mesh.transformed(np.diag([intent.scale] * 3 + [1.0]))
    own, righting, lead = standing_pose(mesh)
    stands, side = stands_as_read(mesh), front_side(intent.object_name)
    trusted = to_right(thing_of(intent.object_name), righting=righting, stands=stands, file_up=float(own[2, 2]))
    believed = own if trusted else np.eye(3)
    place = wished_place(scene, base, intent, 0.5 * float(np.ptp(mesh.bounds[:, :2], axis=0).max()))
    if not config.chosen:
        return Rotation(np.eye(3), (), prompt, "upright", POSE_OF_THE_FILE, None)

    @cache
    def flips(quarter: int) -> tuple[NDArray[np.uint8], ...]:
        return three_flips(scene, base, mesh, place, config.picture_size, 0.5 * np.pi * quarter)

    def flip(quarter: int, k: int) -> NDArray[np.uint8]:
        return np.copy(flips(quarter)[k])

    poses = tuple(
        PoseView.of(one.id, one.rotation, one.probability, one.up, one.front, one.size)
        for one in resting_poses(mesh, own, believed, side)
    )

    def strip() -> NDArray[np.uint8]:
        return pose_strip(scene, base, mesh, place, config.picture_size // 2, others(poses))

    has_front = front_of(rotated(mesh, believed), side)[1]
    asked, lean = intent.orientation.facing, intent.orientation.lean
    facing = f"away:{lean}" if lean and has_front and not asked else asked  # away from what it leans on
    words = intent.orientation.words or "nothing about orientation"
    where = intent.region.words or "no particular place"
    about = f"object: {intent.object_name}; on: {intent.base_label}; where: {where}; orientation: {words}"
    request = RotationRequest(
        prompt=f"{prompt} [{about}]",
        object_name=intent.object_name,
        pose=intent.orientation.pose,
        facing=facing,
        poses=poses,
        facings=facings(scene, base, place, facing),
        symmetry=symmetry_about_z(rotated(mesh, believed)),
        has_front=has_front,
        stands=stands,
        righting=righting,
        turn_deg=intent.orientation.turn_deg,
        on_legs=on_legs(mesh, believed[2]),
        pictures=tuple(
            Picture(f"the object, flipped by 180 degrees about {axis}, seen from {side}", partial(flip, quarter, k))
            for quarter, side in enumerate(SIDES[: config.views // len(FLIPS)])
            for k, axis in enumerate(FLIPS)
        )
        + ((Picture(STRIP, strip),) if config.pose_strip else ()),
    )
    reply = client.ask(ROTATION, request)
    matrix = matrix_of(reply, request, scene, base, mesh)
    # phrased so that a matrix with nan is refused too
    if not (np.abs(matrix @ matrix.T - np.eye(3)).max() < 1e-9 and np.linalg.det(matrix) > 0):
        raise GeometryError(f"the chosen rotation is not orthonormal: {matrix.tolist()}")
    said = "" if not intent.orientation.words else f"; the prompt says {intent.orientation.words!r}"
    candidate, facing = (reply.pose_id, reply.facing_id) if reply.quaternion is None else ("quaternion", "as given")
    pose = requested_pose(request, reply, matrix, mesh, lead)
    pictures = flips(0) if flips.cache_info().currsize else ()  # made only on demand
    return Rotation(matrix, pictures, request.prompt, candidate, f"{reply.reason}, {facing}{said}", pose)


rotation_task = stage(rotation)


def others(poses: Sequence[PoseView]) -> tuple[PoseView, ...]:
    """Poses without a picture: all but the flips of the file's pose."""
    flips = {f"flip_{axis}" for axis in FLIPS}
    return tuple(one for one in poses if one.id not in flips)


# choices ------------------------------------------------------------------------------------------------------------


def facings(scene: Segmentation, base: Instance, place: Array, asked: str) -> tuple[FacingView, ...]:
    """Directions for the front: along the support, as in the file, the requested one, the viewer, things nearby."""
    frame = part_frame(scene, base, base.box)
    ahead: Vector = (float(frame.front[0]), float(frame.front[1]), 0.0)
    found = {"aligned": ahead, "keep": (0.0, 0.0, 0.0)}
    near = sorted(scene.instances, key=lambda i: (float(np.linalg.norm(i.box.center - place)), i.id))
    names = [asked, "viewer", "room", *(f"part:{part.name}" for part in base.parts), *(i.id for i in near[:12])]
    for name in dict.fromkeys(n for n in names if n):
        direction = direction_to(scene, base, place, name)
        if direction is not None:
            found[name] = vector(direction)
    return tuple(FacingView(name, direction) for name, direction in found.items())


# the answer as a matrix ---------------------------------------------------------------------------------------------


def matrix_of(reply: RotationReply, request: RotationRequest, scene: Segmentation, base: Instance, mesh: Mesh) -> Array:
    """The rotation R* of a reply, shape (3, 3)."""
    if reply.quaternion is not None:
        quaternion = np.array(reply.quaternion)
        length = float(np.linalg.norm(quaternion))
        if not abs(length - 1.0) < ROUNDED:
            raise LanguageError(f"the chosen quaternion {quaternion.tolist()} has length {length:.3g}, not 1")
        return np.asarray(Turn.from_quat(quaternion, scalar_first=True).as_matrix())
    pose = next(p for p in request.poses if p.id == reply.pose_id)
    matrix = np.array(pose.rotation)
    if reply.facing_id == "aligned":
        yaw = aligned_yaw(mesh, pose, request, scene, base)
    elif reply.facing_id == "keep":
        yaw = 0.0
    else:
        facing = next(f for f in request.facings if f.id == reply.facing_id)
        ahead = looking(np.array(pose.front), np.array(pose.up))
        ahead = ahead if request.has_front else nearest_side(mesh, matrix, ahead)
        yaw = yaw_between(ahead, np.array(facing.direction))
    return np.asarray(about_z(yaw + np.radians(reply.turn_deg)) @ matrix)


def yaw_between(a: Array, b: Array) -> float:
    """Angle about the vertical from one horizontal direction to another [rad]."""
    return float(np.arctan2(a[0] * b[1] - a[1] * b[0], a[:2] @ b[:2]))


def aligned_yaw(mesh: Mesh, pose: PoseView, request: RotationRequest, scene: Segmentation, base: Instance) -> float:
    """Angle [rad] that turns the front to the viewer, or, if lying, the feet; without a front, the long side across the
    view, or along a slender base."""
    frame = part_frame(scene, base, base.box)
    if request.has_front:
        lies = abs(pose.front[2]) > abs(pose.up[2])  # on a bed, its head to the head end
        ahead = looking(np.array(pose.front), np.array(pose.up))
        return yaw_between(ahead, np.array([*(-frame.front if lies else frame.front), 0.0]))
    own, size = smallest_rectangle((outermost(mesh.vertices) @ np.array(pose.rotation).T)[:, :2])
    if size[0] < ELONGATED * size[1]:
        return 0.0 if request.symmetry == 0 else smallest_turn(own, frame.right, quarter=True)
    across = 2.0 * frame.half[0] >= size[0] or frame.half[0] >= frame.half[1]
    return smallest_turn(own, frame.right if across else frame.front, quarter=False)


def smallest_turn(own: Array, wanted: Array, *, quarter: bool) -> float:
    """Smallest turn that makes an axis parallel to another, in either direction; with `quarter` also perpendicular
    [rad]."""
    angle = yaw_between(own, wanted)
    period = np.pi / 2 if quarter else np.pi
    return float(angle - period * np.round(angle / period))
