"""The offline choice of a pose: what the words ask for, else how such a thing usually rests.

In: the rotation question with its listed poses. Out: one of them and why. Nothing is known but the poses' own numbers
(probability, extents, where up and front point) and the lexicon's way of resting.
"""

import numpy as np

from language.lexicon import Thing, is_a, thing_of
from language.requests import PoseView, RotationRequest

LEVEL = 0.5
"""A direction counts as horizontal below this vertical component, as vertical above its complement: sin 30 degrees."""
CONTAINERS = frozenset({"mug", "cup", "glass", "bowl", "basket", "bucket", "pot", "vase", "jar", "hat"})
"""Things whose opening is their face."""


def chosen_pose(request: RotationRequest, thing: Thing | None) -> tuple[PoseView, str]:
    """The pose and why."""
    rest = thing.rest if thing else "upright"
    default, why = default_pose(request, rest)
    name = request.object_name
    wanted = request.pose
    if wanted == "on_front" and thing is not None and any(is_a(thing.id, c) for c in CONTAINERS):
        wanted = "upside_down"
    if (
        wanted in ("any", "")
        or (wanted == "upright" and rest == "upright")
        or (wanted == "lying" and rest != "upright")
    ):
        return default, f"{name}: {why}"
    if wanted in ("upright", "standing"):
        return standing(request, default, rest), f"{name}: stands on end"
    if wanted == "upside_down" or (wanted == "on_front" and rest == "flat"):
        return turned_over(request, default), f"{name}: upside down"
    if wanted == "on_back" and rest == "flat":
        return default, f"{name}: flat, its face up"
    if wanted in ("on_back", "on_front"):
        sign = 1.0 if wanted == "on_back" else -1.0
        return by_front(request, sign), f"{name}: on its {wanted.removeprefix('on_')}"
    return on_side(request, default, wanted), f"{name}: on its side"


def default_pose(request: RotationRequest, rest: str) -> tuple[PoseView, str]:
    """How the thing rests when nothing is said."""
    upright = by_id(request, "upright")
    stable = [pose for pose in request.poses if pose.probability > 0]
    if rest == "flat" and stable:
        lowest = min(pose.size[2] for pose in (*stable, upright))
        if upright.size[2] <= 1.1 * lowest:
            return upright, "lies flat as in its file"
        flat = [pose for pose in stable if pose.size[2] <= 1.1 * lowest]
        # of the two flat sides the one that needs the smaller turn from the file
        return max(
            flat, key=lambda pose: (round(trace(pose), 6), pose.probability, pose.id)
        ), "lies flat on its largest face"
    if rest == "any" and upright.probability == 0 and stable:
        return max(stable, key=lambda pose: (pose.probability, pose.id)), "rests as it most probably falls"
    return upright, "upright as in its file"


def by_id(request: RotationRequest, pose_id: str) -> PoseView:
    """The pose of that id."""
    return next(pose for pose in request.poses if pose.id == pose_id)


def trace(pose: PoseView) -> float:
    """Trace of the rotation: the larger, the smaller the turn."""
    return pose.rotation[0][0] + pose.rotation[1][1] + pose.rotation[2][2]


def own_up(pose: PoseView, default: PoseView) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Where the axis that points up in the default pose points in this pose."""
    return np.asarray(np.array(pose.rotation) @ np.array(default.rotation).T @ (0.0, 0.0, 1.0))


def standing(request: RotationRequest, default: PoseView, rest: str) -> PoseView:
    """On end: the default of upright things, else the tallest pose, stable if possible, turned little."""
    if rest == "upright":
        return default
    tallest = max(pose.size[2] for pose in request.poses)
    fitting = [pose for pose in request.poses if pose.size[2] >= 0.97 * tallest]
    return max(fitting, key=lambda pose: (pose.probability > 0, round(trace(pose), 6), pose.probability))


def turned_over(request: RotationRequest, default: PoseView) -> PoseView:
    """Half a turn about a horizontal axis, the front kept where it was as far as possible."""
    over = [pose for pose in request.poses if own_up(pose, default)[2] < -0.99]
    kept = np.array(default.front)
    return max(
        over or [by_id(request, "flip_y")], key=lambda p: (round(float(np.dot(p.front, kept)), 3), p.probability)
    )


def by_front(request: RotationRequest, sign: float) -> PoseView:
    """The front up (1) or down (-1): the most stable such pose, else the plain turn."""
    fitting = [pose for pose in request.poses if sign * pose.front[2] > 1 - LEVEL]
    return max(fitting, key=lambda pose: (pose.probability, round(sign * pose.front[2], 3), pose.id))


def on_side(request: RotationRequest, default: PoseView, wanted: str) -> PoseView:
    """The own vertical made horizontal: the most stable such pose; a creature that lies down lies on its back."""
    level = [pose for pose in request.poses if abs(own_up(pose, default)[2]) < LEVEL]
    thing = thing_of(request.object_name)
    if wanted == "lying" and thing is not None and is_a(thing.id, "toy") and request.has_front:
        level = [pose for pose in level if pose.front[2] > 1 - LEVEL] or level
    if wanted == "on_side" and request.has_front:
        level = [pose for pose in level if abs(pose.front[2]) < LEVEL] or level
    return max(level, key=lambda pose: (pose.probability, -pose.size[2], pose.id))
