"""The offline choices of a pose and a part: by the words of the sentence, else the usual ones.

The offline choice of a pose: the pose stated in words, else the usual rest pose of such a thing.

In: the rotation question with its listed poses. Out: one of them and the reason. It only uses the poses' own numbers
(probability, extents, directions of up and front) and the lexicon's rest pose. Words name an exact pose; a stable pose
close to it is taken instead, since the thing would roll there anyway; a pose farther away does not meet the request.

The offline choice of a part: the requested part, else the part on which such a base carries things.

In: the anchor question with its listed parts. Out: one of them and the reason.
"""

from collections.abc import Callable

import numpy as np

from dcap.knowledge.kinds import FrontSide, faced_by_opening, front_side, is_figure, to_right
from dcap.knowledge.lexicon import Thing, default_parts, is_a, lineage, thing_of
from dcap.language.protocol.requests import AnchorRequest, PartView, PoseView, RotationRequest

CLOSE = 15.0
"""Largest angle at which a stable pose counts as the stated pose [degrees]."""
LOW = 0.75
"""Ratio of height to length below which a thing already lies [-]."""
HANDS = {"on_left_side": 1.0, "on_right_side": -1.0}
"""The side that is down, as a factor of the axis that points to the thing's left."""
Miss = Callable[[PoseView], float]
"""Function that returns the deviation of a pose from the request [degrees]."""


def chosen_pose(request: RotationRequest, thing: Thing | None) -> tuple[PoseView, str]:
    """The pose and the reason."""
    rest = thing.rest if thing else "upright"
    default, why = default_pose(request, thing)
    name = request.object_name
    wanted = meant(request, thing, default)
    if wanted == "any":
        return default, f"{name}: {why}"
    if wanted == "standing":
        why = "on end, to lean" if request.pose == "leaning" else "stands on end"
        return standing(request, default, rest), f"{name}: {why}"
    if wanted == "upside_down":
        return turned_over(request, default), f"{name}: upside down"
    if wanted in ("on_back", "on_front"):
        return by_front(request, default, wanted), f"{name}: on its {wanted.removeprefix('on_')}"
    if wanted in HANDS:
        return on_hand(request, default, wanted), f"{name}: {wanted.replace('on_', 'on its ').replace('_', ' ')}"
    return on_side(request, default, wanted), f"{name}: on its side"


def meant(request: RotationRequest, thing: Thing | None, default: PoseView) -> str:
    """Pose that the words mean for such a thing: one of those of the reply apart from upright."""
    wanted, rest = request.pose, thing.rest if thing else "upright"
    if wanted == "leaning":  # flat things lean on edge, upright ones as they stand
        return "any" if rest == "upright" and not is_low(default, LOW) else "standing"
    if wanted in ("any", "", "seated") or (wanted == "upright" and rest == "upright"):
        return "any"
    if wanted == "upright":
        return "standing"
    on_fours = is_figure(request.object_name) is not False and request.on_legs and is_low(default, LOW)
    if wanted == "lying" and on_fours:
        return "on_side"  # its standing pose is low, and no rigid pose lies on its belly
    if wanted == "lying" and (rest != "upright" or is_low(default, LOW)):
        return "any"  # "lay a plate on the table"
    if wanted == "on_side" and rest == "any" and is_low(default, 0.99):
        return "any"  # a dumbbell lies on its side
    if wanted == "lying" and thing is not None and is_a(thing.id, "toy") and request.has_front:
        return "on_back"  # a creature that lies down lies on its back
    # its face or its back is its top
    topped = rest == "flat" or front_side(request.object_name) is FrontSide.LONG or on_fours
    if wanted == "on_front" and thing is not None and any(is_a(thing.id, c) for c in faced_by_opening()):
        return "upside_down"
    if topped and wanted in ("on_back", "on_front"):
        return "any" if (wanted == "on_back") == (rest == "flat") else "upside_down"
    return wanted


def is_low(default: PoseView, share: float) -> bool:
    """Return whether a thing already lies in its usual rest pose: a shoe, a car, a laptop."""
    return default.size[2] < share * max(default.size[:2])


def default_pose(request: RotationRequest, thing: Thing | None) -> tuple[PoseView, str]:
    """Rest pose of the thing without a request."""
    rest = thing.rest if thing else "upright"
    upright = by_id(request, "upright")
    stable = [pose for pose in request.poses if pose.probability > 0]
    if rest == "flat" and stable:
        lowest = min(pose.size[2] for pose in (*stable, upright))
        if upright.size[2] <= 1.1 * lowest:
            return upright, "lies flat as in its file"
        flat = [pose for pose in stable if pose.size[2] <= 1.1 * lowest]
        # of the two flat sides, the one with the smaller turn from the file
        return max(
            flat, key=lambda pose: (round(trace(pose), 6), pose.probability, pose.id)
        ), "lies flat on its largest face"
    if rest == "any" and upright.probability == 0 and stable:
        return max(stable, key=lambda pose: (pose.probability, pose.id)), "rests as it most probably falls"
    up_in_file = own_up(by_id(request, "righted"), upright)[2] if request.righting > 0.0 else 1.0
    if to_right(thing, righting=request.righting, stands=request.stands, file_up=float(up_in_file)):
        return by_id(request, "righted"), "put upright: in its file it lies, is tilted or overturned"
    return upright, "upright as in its file"


def by_id(request: RotationRequest, pose_id: str) -> PoseView:
    """The pose of that id."""
    return next(pose for pose in request.poses if pose.id == pose_id)


def kin(request: RotationRequest, default: PoseView) -> list[PoseView]:
    """The poses to which words refer, given the default: those of the file or those of the righted pose; stable
    ones."""
    if not default.id.startswith("righted"):
        return [pose for pose in request.poses if not pose.id.startswith("righted")]
    return [pose for pose in request.poses if pose.id.startswith(("righted", "stable"))]


def trace(pose: PoseView) -> float:
    """Trace of the rotation: the larger, the smaller the turn."""
    return pose.rotation[0][0] + pose.rotation[1][1] + pose.rotation[2][2]


def own_up(pose: PoseView, default: PoseView) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Direction in this pose of the axis that points up in the default pose."""
    return np.asarray(np.array(pose.rotation) @ np.array(default.rotation).T @ (0.0, 0.0, 1.0))


def tilt_deg(height: float) -> float:
    """Angle of a unit vector above the horizontal, from its vertical component [degrees]."""
    return float(np.degrees(np.arcsin(np.clip(height, -1.0, 1.0))))


def closest(poses: list[PoseView], miss: Miss) -> PoseView:
    """The most probable stable pose close to the request, else the pose that meets it exactly."""
    stable = [pose for pose in poses if pose.probability > 0 and miss(pose) < CLOSE]
    if stable:
        return max(stable, key=lambda pose: (pose.probability, -round(miss(pose), 3), -pose.size[2], pose.id))
    return min(poses, key=lambda pose: (round(miss(pose), 3), pose.size[2], pose.id))


def standing(request: RotationRequest, default: PoseView, rest: str) -> PoseView:
    """Pose on end: the default of upright things that are high, else the tallest pose, stable if possible, with the
    smallest turn."""
    if rest == "upright" and not is_low(default, LOW):
        return default
    # a tilted file is high only because of its tilt
    stable = [pose for pose in request.poses if pose.probability > 0]
    high = max(pose.size[2] for pose in request.poses)
    steady = bool(stable) and not request.stands and max(pose.size[2] for pose in stable) > 0.8 * high
    poses = stable if steady else list(request.poses)
    tallest = max(pose.size[2] for pose in poses)
    fitting = [pose for pose in poses if pose.size[2] >= 0.97 * tallest]
    return max(fitting, key=lambda pose: (pose.probability > 0, round(trace(pose), 6), pose.probability))


def turned_over(request: RotationRequest, default: PoseView) -> PoseView:
    """Half a turn about a horizontal axis that keeps the direction of the front as far as possible."""
    over = [pose for pose in kin(request, default) if own_up(pose, default)[2] < -0.99]
    kept = np.array(default.front)
    return max(
        over or [by_id(request, "flip_y")], key=lambda p: (round(float(np.dot(p.front, kept)), 3), p.probability)
    )


def by_front(request: RotationRequest, default: PoseView, wanted: str) -> PoseView:
    """Pose with the front up (on its back) or down."""
    sign = 1.0 if wanted == "on_back" else -1.0
    return closest(kin(request, default), lambda pose: 90.0 - tilt_deg(sign * pose.front[2]))


def on_hand(request: RotationRequest, default: PoseView, wanted: str) -> PoseView:
    """Pose on its own left or right side, as defined by its front."""
    left = np.array(default.rotation).T @ np.cross((0.0, 0.0, 1.0), default.front)
    sign = HANDS[wanted]
    return closest(kin(request, default), lambda pose: 90.0 + tilt_deg(sign * (np.array(pose.rotation) @ left)[2]))


def on_side(request: RotationRequest, default: PoseView, wanted: str) -> PoseView:
    """Pose with the upright axis horizontal; for on its side, with the front horizontal too."""
    with_front = wanted == "on_side" and request.has_front

    def miss(pose: PoseView) -> float:
        level = abs(tilt_deg(own_up(pose, default)[2]))
        return max(level, abs(tilt_deg(pose.front[2]))) if with_front else level

    return closest(kin(request, default), miss)


def chosen_part(request: AnchorRequest) -> tuple[PartView, str]:
    """The part and the reason."""
    if request.asked_part:
        alike = [part for part in request.parts if part.name == request.asked_part]
        if alike:
            part = which_of(alike, request.asked_which, request)
            return part, f"the prompt asks for the {part.name}"
    for base in lineage(thing_id(request.base_label)):
        for name in default_parts().get(base, ()):
            alike = [part for part in request.parts if part.name == name and part.support_area > 0]
            if alike:
                return which_of(alike, sideways(request), request), f"a {base} carries things on its {name}"
    part = max(request.parts, key=lambda p: (round(p.support_area, 4), p.center[2], -p.index))
    return part, f"the {part.name} has the largest upward surface ({part.support_area:.2f} m2)"


def thing_id(label: str) -> str:
    """Thing id of a label; empty if unknown."""
    thing = thing_of(label)
    return thing.id if thing else ""


def sideways(request: AnchorRequest) -> str:
    """The requested left, right or middle, which selects among cushions that lie side by side."""
    sides = [r for r in request.asked_regions if r in ("left", "right", "middle", "center")]
    return sides[0] if sides else ""


def moved_into_which(request: AnchorRequest, part: PartView) -> bool:
    """Return whether left or right already selected one of several parts side by side."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) > 1 and not request.asked_part and sideways(request) != "" and not request.asked_references


def one_of_a_whole(request: AnchorRequest, part: PartView) -> bool:
    """Return whether "the left arm" was requested and one part contains both arms: then left states the place on it."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) == 1 and request.asked_which in ("left", "right", "front", "back")


def which_of(alike: list[PartView], which: str, request: AnchorRequest) -> PartView:
    """The left, right, top, bottom, middle or n-th of parts with the same name; else the one with the best support."""
    word, counted = which.split()[0] if which else "", which.split()[-1] if which else ""
    along = sorted(alike, key=lambda p: (round(float(np.dot(p.center, request.right)), 3), p.index))
    upward = sorted(alike, key=lambda p: (round(p.center[2], 3), p.index))
    if word in ("left", "right"):
        return along[0 if word == "left" else -1]
    if word in ("front", "back"):
        sign = 1.0 if word == "front" else -1.0
        return max(alike, key=lambda p: (round(sign * float(np.dot(p.center, request.front)), 3), -p.index))
    if word in ("top", "bottom"):
        return upward[-1 if word == "top" else 0]
    if word in ("middle", "center"):
        stacked = np.ptp([p.center[2] for p in alike]) > 0.1
        return upward[(len(alike) - 1) // 2] if stacked else along[len(alike) // 2]  # the roof of a case is no middle
    if word.isdigit():
        order = along if counted in ("left", "right") else upward
        order = order[::-1] if counted in ("top", "right") else order
        return order[min(int(word), len(order)) - 1]
    if word == "last":
        return upward[0]
    largest = max(p.support_area for p in alike)
    good = [p for p in along if p.support_area >= 0.7 * largest]
    if np.ptp([p.center[2] for p in good]) > 0.1:  # boards above each other: the middle one
        return sorted(good, key=lambda p: (round(p.center[2], 3), p.index))[len(good) // 2]
    return good[len(good) // 2]
