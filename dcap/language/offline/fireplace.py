"""The questions of the FirePlace* baseline, answered by rules: constraints of a sentence, and choices by measures.

In: the requests of `dcap.language.protocol.fireplace`. Out: replies. The sentence is read with the same grammar, and
with the same rules for support, part and pose, as for the placement by drop; here the result is only written in another
language. Turns by an angle ("turned by 30 degrees") have no corresponding constraint and are left out.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from dcap.knowledge.lexicon import thing_of
from dcap.language.offline.pose_choice import chosen_part, chosen_pose, moved_into_which, one_of_a_whole
from dcap.language.offline.reading import Reading
from dcap.language.offline.sentence import read
from dcap.language.offline.target import target_of
from dcap.language.offline.where import Target, facing_of
from dcap.language.offline.words import SceneWords
from dcap.language.protocol.fireplace import (
    CHOICE,
    OUTLINES,
    PRUNING,
    ChoiceOption,
    ChoiceReply,
    ChoiceRequest,
    ConstraintOutline,
    OutlinesReply,
    OutlinesRequest,
    PruningReply,
    PruningRequest,
)
from dcap.language.protocol.replies import Constraint
from dcap.language.protocol.requests import (
    AnchorRequest,
    InstanceView,
    IntentRequest,
    PartView,
    PoseView,
    RotationRequest,
    Vector,
)

NEAR, NEXT_TO, TOUCHING, OFF = 0.2, 0.1, 0.02, 0.02
"""Distances meant by near, next to, against and not on [m]."""
AT_EDGE = 0.05
"""Largest distance from an edge for a thing to be at the edge [m]."""
AWAY, FARTHEST = 0.5, 3.0
"""Distances meant by away from and as far as possible from [m]."""
HALF, END, MIDDLE = 0.5, 0.75, 0.45
"""Distances from the opposite side for a half and for an end, as shares of the extent [-]: the same areas as in the
placement by drop. And the distance from all sides for the middle: larger than possible, so that the result is as close
to the middle as possible."""
SIDE_OF = {"left": "left", "right": "right", "front": "front", "back": "back", "head": "back", "foot": "front"}
OPPOSITE = {"left": "right", "right": "left", "front": "back", "back": "front"}
BESIDE = {"near": NEAR, "next_to": NEXT_TO}
LIES = 0.7
"""Least vertical part of the front of a lying thing [-]."""
LOSS_STEP = 1e-3
"""Losses that differ by less than this are equal [-]."""
MARGIN_STEP = 0.02
"""Distances from the rim that differ by less than this are equal [m]."""
WORSE, MUCH_WORSE = 2.0, 0.05
"""Factor over the least loss, and distance beyond it, above both of which placements are pruned [-]."""
MOST_OVERHANG = 0.3
"""Share over the rim above which an object is about to fall [-]."""

Fields = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Support:
    """Support on which a sentence puts the object."""

    base: InstanceView
    part: PartView
    front: Vector
    """Direction towards the viewer of the base's front."""
    regions: tuple[str, ...]
    reason: str


def outlines(request: OutlinesRequest) -> OutlinesReply:
    """The constraints of a sentence."""
    asked = IntentRequest(request.prompt, request.item, request.instances, request.room_center)
    words = SceneWords.of((one.id, one.label) for one in request.instances)
    reading = read(request.prompt, words, request.item.label)
    target = target_of(reading, asked)
    if target.base is None:
        return OutlinesReply(constraints=(), missing=target.missing or "support", did_you_mean=target.meant)
    support = support_of(request, target, target.base)
    facing, _ = facing_of(reading, target, asked)
    pose, why = pose_of(request, reading, target, facing)
    on_it = {"anchors": (support.base.id,), "anchor_parts": (support.part.index,), "anchor_side": "top"}
    found: list[Fields] = [
        {"function": "contact", "object_surfaces": (pose.id,), **on_it},
        {"function": "no_overhang", "object_surfaces": ("bottom",), **on_it},
        *region_outlines(request, support, target),
        *limit_outlines(request, support, target.constraints),
        *direction_outlines(request, support, pose, facing),
    ]
    if target.lean_on:
        found.append({"function": "close_to", "metres": TOUCHING, **whole(support, target.lean_on)})
    constraints = (ConstraintOutline.model_validate({"object_surfaces": ("bottom",), **one}) for one in found)
    return OutlinesReply(constraints=tuple(constraints), reason=f"{support.reason}; {why}")


def support_of(request: OutlinesRequest, target: Target, base: InstanceView) -> Support:
    """The requested part, or the part on which such a base carries things."""
    front = request.fronts[[one.id for one in request.instances].index(base.id)]
    barred = {one.reference.removeprefix("part:") for one in target.constraints if one.kind == "not_on"}
    parts = tuple(part for part in base.parts if part.name not in barred) or base.parts
    size = request.item.size
    question = AnchorRequest(
        prompt=request.prompt,
        region_words=", ".join(target.words),
        object_name=request.object_name,
        footprint=(size[0], size[1]),
        base_label=base.label,
        parts=parts,
        asked_part=target.part,
        asked_which=target.which,
        asked_regions=tuple(target.regions),
        asked_references=tuple(target.references),
        right=(-front[1], front[0], 0.0),
        front=front,
    )
    part, reason = chosen_part(question)
    regions = tuple(target.regions)
    if moved_into_which(question, part):
        regions = tuple(r for r in regions if r not in ("left", "right", "middle", "center"))
    if one_of_a_whole(question, part):
        regions = (target.which, *regions)
    return Support(base, part, front, regions, reason)


def pose_of(request: OutlinesRequest, reading: Reading, target: Target, facing: str) -> tuple[PoseView, str]:
    """The pose of the object, by the rules that choose its pose, and the reason."""
    pose = "upright" if reading.pose == "leaning" and not target.lean_on else reading.pose
    question = RotationRequest(
        prompt=request.prompt,
        object_name=request.object_name,
        pose=pose,
        facing=facing,
        poses=request.object_surfaces,
        facings=(),
        symmetry=request.symmetry,
        has_front=request.has_front,
        stands=request.stands,
        righting=request.righting,
        turn_deg=reading.turn,
        on_legs=request.on_legs,
    )
    return chosen_pose(question, thing_of(request.object_name))


# position
# --------------------------------------------------------------------------------------------------------------


def region_outlines(request: OutlinesRequest, support: Support, target: Target) -> list[Fields]:
    """The requested region as distances from sides of the support, or from things."""
    names = support.regions
    sides = list(dict.fromkeys(SIDE_OF[name] for name in names if name in SIDE_OF))
    references = tuple(target.references)
    beside = [name for name in names if name in (*BESIDE, "between", "under")]
    if beside and references:
        found = beside_outlines(request, support, beside[0], references)
        if "edge" in names or "corner" in names:
            return found
        view = [{"function": "in_front_of", **whole(support, one), "anchor_side": side}
                for one in references for side in sides]  # fmt: skip
        return found + view
    if "corner" in names:
        first = [side for side in sides if side in ("front", "back")][:1] or ["front"]
        second = [side for side in sides if side in ("left", "right")][:1] or ["right"]
        return [close(support, side, AT_EDGE) for side in (*first, *second)]
    if "edge" in names:
        toward = [side_towards(request, support, references[0])] if references else ["front"]
        return [close(support, side, AT_EDGE) for side in (sides or toward)[:2]]
    if "end" in names:
        return [far(support, OPPOSITE[side], share=END) for side in sides[:1] or ["right"]]
    if sides:
        ends = {SIDE_OF[name] for name in names if name in ("head", "foot")}
        return [far(support, OPPOSITE[side], share=END if side in ends else HALF) for side in sides]
    if "center" in names or "middle" in names:
        return [far(support, side, share=MIDDLE) for side in OPPOSITE]
    return []


def beside_outlines(
    request: OutlinesRequest, support: Support, relation: str, references: Sequence[str]
) -> list[Fields]:  # fmt: skip
    """Outlines for near, next to, between or under things."""
    if relation == "under":
        return [{"function": "no_overhang", **whole(support, one)} for one in references]
    distance = BESIDE.get(relation, 0.0) or half_gap(request, references)
    found: list[Fields] = []
    for one in references:
        found.append({"function": "close_to", "metres": distance, **whole(support, one)})
        found.append({"function": "far_from", "metres": OFF, **whole(support, one)})
    return found


def half_gap(request: OutlinesRequest, references: Sequence[str]) -> float:
    """Distance from each of two things to the middle between them [m]."""
    views = [one for one in request.instances if one.id in references]
    if len(views) < 2:
        return NEXT_TO
    low, high = (np.array([getattr(one, name)[:2] for one in views[:2]]) for name in ("low", "high"))
    gap = float(np.linalg.norm(np.maximum(low.max(axis=0) - high.min(axis=0), 0.0)))
    return max(0.5 * (gap - min(request.item.size[:2])), TOUCHING)


def limit_outlines(request: OutlinesRequest, support: Support, limits: Iterable[Constraint]) -> list[Fields]:
    """Distances and excluded places."""
    found: list[Fields] = []
    for one in limits:
        if one.kind == "not_on" and one.reference.startswith("part:"):
            found.append({"function": "far_from", "metres": OFF, **whole(support, one.reference)})
            continue
        for target in targets_of(request, support, one):
            if one.kind in ("exactly", "at_most", "nearest"):
                found.append({"function": "close_to", "metres": one.metres or TOUCHING, **target})
            if one.kind in ("exactly", "at_least"):
                found.append({"function": "far_from", "metres": one.metres, **target})
            if one.kind in ("away", "farthest", "not_on", "not_in"):
                reach = {"away": AWAY, "farthest": FARTHEST, "not_on": OFF, "not_in": 2.0 * AT_EDGE}[one.kind]
                found.append({"function": "far_from", "metres": reach, **target})
    return found


def targets_of(request: OutlinesRequest, support: Support, limit: Constraint) -> list[Fields]:
    """Sides of the support, or things, to which a limit refers."""
    sides = [SIDE_OF[name] for name in limit.regions if name in SIDE_OF]
    if not limit.reference:
        edges = sides or (["front"] if limit.kind in ("exactly", "at_most", "nearest") else list(OPPOSITE))
        return [side_of(support, side) for side in edges]
    if "edge" in limit.regions:
        return [side_of(support, side_towards(request, support, limit.reference))]
    return [whole(support, limit.reference)]


def side_towards(request: OutlinesRequest, support: Support, reference: str) -> str:
    """The side of the support that faces a thing or part."""
    center = next((np.array(one.center) for one in request.instances if one.id == reference), None)
    if center is None:
        name = reference.removeprefix("part:").partition("/")[0]
        own = [part.center for part in support.base.parts if part.name == name]
        center = np.mean(own or [support.part.center], axis=0)
    way = (center - np.array(support.part.center))[:2]
    front = np.array(support.front[:2])
    right = np.array([-front[1], front[0]])
    along = {"left": -way @ right, "right": way @ right, "front": way @ front, "back": -way @ front}
    return max(along, key=lambda side: (round(float(along[side]), 6), side))


# direction ----------------------------------------------------------------------------------------------------------


def direction_outlines(request: OutlinesRequest, support: Support, pose: PoseView, facing: str) -> list[Fields]:
    """Outlines for the direction of the front; without a request, for the usual orientation of such a thing."""
    if facing:
        away = facing.startswith("away:")
        own = "back" if away else "front"
        name = facing.removeprefix("away:")
        side = {"viewer": "front"}.get(name, name)
        if side in OPPOSITE:
            return towards(support, own, side)
        target = faced(request, support, name)
        return [] if target is None else [{"function": "facing", **target, "object_surfaces": (own,)}]
    if request.has_front:
        return towards(support, "top", "back") if abs(pose.front[2]) > LIES else towards(support, "front", "front")
    return [] if request.symmetry == 0 else across(support, pose)


def towards(support: Support, own: str, side: str) -> list[Fields]:
    """A side of the object faces a side of the support at a right angle."""
    return [
        {"function": name, **side_of(support, side), "object_surfaces": (own,)} for name in ("parallel", "facing")
    ]  # fmt: skip


def across(support: Support, pose: PoseView) -> list[Fields]:
    """The long side across, as the viewer sees it."""
    along_front = abs(pose.front[0]) * pose.size[0] + abs(pose.front[1]) * pose.size[1]
    beside = abs(pose.front[1]) * pose.size[0] + abs(pose.front[0]) * pose.size[1]
    own = "front" if along_front > beside else "left"
    if abs(pose.front[2]) > LIES:
        own = "top"
    return [{"function": "parallel", **side_of(support, "right"), "object_surfaces": (own,)}]


def faced(request: OutlinesRequest, support: Support, name: str) -> Fields | None:
    """Target of the facing: a thing, a part, the nearest wall or door, the room."""
    if name.startswith("part:") or any(one.id == name for one in request.instances):
        return whole(support, name)
    word = "floor" if name == "room" else name
    named = [one for one in request.instances if word in one.label]
    at = np.array(support.part.center[:2])
    if not named:
        return None
    gaps = [np.maximum(np.maximum(np.array(one.low[:2]) - at, at - np.array(one.high[:2])), 0.0) for one in named]
    nearest = min(range(len(named)), key=lambda k: (float(np.linalg.norm(gaps[k])), named[k].id))
    return whole(support, named[nearest].id)


# anchors ------------------------------------------------------------------------------------------------------------


def side_of(support: Support, side: str) -> Fields:
    """A side of the part that carries."""
    return {"anchors": (support.base.id,), "anchor_parts": (support.part.index,), "anchor_side": side}


def close(support: Support, side: str, metres: float) -> Fields:
    """Near a side of the support."""
    return {"function": "close_to", "metres": metres, **side_of(support, side)}


def far(support: Support, side: str, share: float) -> Fields:
    """Far from a side of the support."""
    return {"function": "far_from", "share": share, **side_of(support, side)}


def whole(support: Support, reference: str) -> Fields:
    """A thing, or parts of the support: `part:NAME` or `part:NAME/SIDE`."""
    if not reference.startswith("part:"):
        return {"anchors": (reference,), "anchor_side": "whole"}
    name, _, side = reference.removeprefix("part:").partition("/")
    parts = [part for part in support.base.parts if part.name == name]
    front = np.array(support.front)
    right = np.array([-front[1], front[0], 0.0])
    ways = {"left": -right, "right": right, "front": front, "back": -front,
            "top": np.array([0.0, 0.0, 1.0]), "bottom": np.array([0.0, 0.0, -1.0])}  # fmt: skip
    if side:
        parts = [max(parts, key=lambda part: (round(float(np.dot(part.center, ways[side])), 6), -part.index))]
    indices = tuple(part.index for part in parts)
    return {"anchors": (support.base.id,), "anchor_parts": indices, "anchor_side": "whole"}


# choices ------------------------------------------------------------------------------------------------------------


def choice(request: ChoiceRequest) -> ChoiceReply:
    """Among placements the nearest to the constraints, then the farthest from the rim and the nearest to the middle;
    among other options the likeliest, then the largest."""
    options = request.options
    best = max(options, key=placement_rank) if request.kind == "placement" else max(options, key=size_rank)
    return ChoiceReply(chosen=best.id, reason="by its measures")


def placement_rank(option: ChoiceOption) -> tuple[float, float, float, str]:
    """Rank of a placement, independent of its letter."""
    margin = round(option.fact("margin_m") / MARGIN_STEP)
    return -round(option.fact("loss") / LOSS_STEP), margin, -round(option.fact("from_middle_m"), 3), option.label


def size_rank(option: ChoiceOption) -> tuple[float, float, str]:
    """Rank of a thing or surface."""
    return round(option.fact("likelihood"), 6), round(option.fact("area_m2"), 6), option.label


def pruning(request: PruningRequest) -> PruningReply:
    """Placements that are much farther from the constraints than the best, or about to fall."""
    least = min(option.fact("loss") for option in request.options)
    limit = max(WORSE * least, least + MUCH_WORSE)
    out = [one.id for one in request.options if one.fact("loss") > limit or one.fact("overhang") > MOST_OVERHANG]
    return PruningReply(implausible=tuple(out), reason="far from the constraints, or about to fall")


FIREPLACE_ANSWERS: Mapping[str, Callable[[Any], Any]] = {
    OUTLINES.name: outlines,
    CHOICE.name: choice,
    PRUNING.name: pruning,
}
