"""The client that needs no model: a transparent reader of sentences and a chooser over the lexicon.

It answers only from the request and the lexicon's files, the same way every time, and says what it did not
understand.
"""

import numpy as np

from language.lexicon import Thing, default_parts, is_a, lineage, part_words, thing_of, things
from language.materials import material_words
from language.priors import prior_of
from language.replies import (
    AnchorReply,
    IntentReply,
    LabelReply,
    MaterialChoice,
    MaterialsReply,
    PartName,
    PartsReply,
    RotationReply,
)
from language.requests import (
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialQuestion,
    MaterialsRequest,
    PartsRequest,
    PartView,
    PoseView,
    RotationRequest,
)
from language.sentence import read
from language.shapes import label_of
from language.target import facing_of, target_of

LEVEL = 0.5
"""A direction counts as horizontal below this vertical component, as vertical above its complement: sin 30 degrees."""
CONTAINERS = frozenset({"mug", "cup", "glass", "bowl", "basket", "bucket", "pot", "vase", "jar", "hat"})
"""Things whose opening is their face."""
FALLBACK_SOFT, FALLBACK_RIGID = "foam_seat", "wood_oak"
SOFT_WORDS = frozenset({"cushion", "pillow", "mattress", "plush", "towel", "blanket", "clothes", "sofa", "bed"})


class OfflineClient:
    """Reads with the grammar, chooses with rules."""

    def intent(self, request: IntentRequest) -> IntentReply:
        """Which base, how big, how heavy, which orientation and region."""
        reading = read(request.prompt)
        target = target_of(reading, request)
        prior = prior_of(reading.theme, request.item.label, request.item.size)
        facing, unclear = facing_of(reading, target, request)
        words = " ".join(w for w in (reading.pose_words, reading.facing.text if reading.facing else "") if w)
        reply = IntentReply.model_validate(
            {
                "base_id": target.base.id if target.base else "",
                "missing": target.missing,
                "object_name": prior.name,
                "size": prior.size,
                "spread": prior.spread,
                "mass": prior.mass,
                "hollow": prior.hollow,
                "pose": reading.pose,
                "facing": facing,
                "orientation_words": words,
                "part": target.part,
                "which": target.which,
                "regions": tuple(target.regions),
                "references": tuple(target.references),
                "region_words": ", ".join(target.words),
                "not_understood": tuple(dict.fromkeys((*reading.not_understood, *target.not_understood, *unclear))),
                "notes": (*prior.notes, *target.notes),
            }
        )
        reply.check(request)
        return reply

    def rotation(self, request: RotationRequest) -> RotationReply:
        """The listed pose that fits the words, else how such a thing usually rests."""
        thing = thing_of(request.object_name)
        pose, reason = chosen_pose(request, thing)
        facings = {facing.id for facing in request.facings}
        facing = request.facing if request.facing in facings else "aligned"
        reply = RotationReply(pose_id=pose.id, facing_id=facing, reason=reason)
        reply.check(request)
        return reply

    def anchor(self, request: AnchorRequest) -> AnchorReply:
        """The asked part, else the one that usually carries things; the region is the asked one."""
        part, reason = chosen_part(request)
        regions = request.asked_regions
        if moved_into_which(request, part):
            regions = tuple(r for r in regions if r not in ("left", "right", "middle", "center"))
            reason += f"; the {request.asked_regions[0]} one of several"
        if one_of_a_whole(request, part):
            regions = (request.asked_which, *regions)
        reply = AnchorReply.model_validate(
            {"part_index": part.index, "regions": regions, "references": request.asked_references, "reason": reason}
        )
        reply.check(request)
        return reply

    def materials(self, request: MaterialsRequest) -> MaterialsReply:
        """By the thing's own list, by part name, by category, by words; else a stated fallback."""
        known = {material.id for material in request.library}
        reply = MaterialsReply(choices=tuple(chosen_material(question, known) for question in request.questions))
        reply.check(request)
        return reply

    def label(self, request: LabelRequest) -> LabelReply:
        """The label whose usual shape, size and height fit best."""
        reply = label_of(request)
        reply.check(request)
        return reply

    def parts(self, request: PartsRequest) -> PartsReply:
        """The proposed names: they come from rules already."""
        names = (PartName(index=p.part.index, name=p.part.name, confidence=p.confidence) for p in request.parts)
        reply = PartsReply(names=tuple(names), reason="as geometry proposes")
        reply.check(request)
        return reply


# rotation -----------------------------------------------------------------------------------------------------------


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


# anchor -------------------------------------------------------------------------------------------------------------


def chosen_part(request: AnchorRequest) -> tuple[PartView, str]:
    """The part and why."""
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
    """Thing id of a label, empty if unknown."""
    thing = thing_of(label)
    return thing.id if thing else ""


def sideways(request: AnchorRequest) -> str:
    """The asked left, right or middle, which picks among cushions that lie side by side."""
    sides = [r for r in request.asked_regions if r in ("left", "right", "middle", "center")]
    return sides[0] if sides else ""


def moved_into_which(request: AnchorRequest, part: PartView) -> bool:
    """Whether left or right already picked one of several parts side by side."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) > 1 and not request.asked_part and sideways(request) != "" and not request.asked_references


def one_of_a_whole(request: AnchorRequest, part: PartView) -> bool:
    """Whether "the left arm" was asked and one part holds both arms: then left says where on it."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) == 1 and request.asked_which in ("left", "right", "front", "back")


def which_of(alike: list[PartView], which: str, request: AnchorRequest) -> PartView:
    """The left, right, top, bottom, middle or n-th of parts with the same name; else the one that carries best."""
    word, counted = which.split()[0] if which else "", which.endswith("from top")
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
        return (upward if stacked else along)[len(alike) // 2]
    if word.isdigit():
        order = upward[::-1] if counted else upward
        return order[min(int(word), len(order)) - 1]
    if word == "last":
        return upward[0]
    largest = max(p.support_area for p in alike)
    good = [p for p in along if p.support_area >= 0.7 * largest]
    if np.ptp([p.center[2] for p in good]) > 0.1:  # boards above each other: the middle one
        return sorted(good, key=lambda p: (round(p.center[2], 3), p.index))[len(good) // 2]
    return good[len(good) // 2]


# materials ----------------------------------------------------------------------------------------------------------


def chosen_material(question: MaterialQuestion, known: set[str]) -> MaterialChoice:
    """The material of one part and why."""
    material, reason = material_of(question, known)
    return MaterialChoice(body=question.body, part_index=question.part.index, material=material, reason=reason)


def material_of(question: MaterialQuestion, known: set[str]) -> tuple[str, str]:
    """First rule that gives a row of the library."""
    name, label = question.part.name, question.label
    thing = thing_of(label)
    whole = thing.id if thing else ""
    kinds = [things()[one] for one in lineage(whole) if one in things()]
    for one in kinds:
        if one.materials.get(name) in known:
            return one.materials[name], f"the {name} of a {one.id}"
    structure = {"floor": "laminate", "wall": "plaster", "ceiling": "plaster", "window": "glass", "door": "wood_pine"}
    if structure.get(whole) in known:
        return structure[whole], f"a {whole} indoors"
    if is_a(whole, "bathtub") and "acrylic" in known:
        return "acrylic", "a bathtub"
    if name in part_words() and part_words()[name].material in known:
        owned = any(is_a(whole, owner) for owner in part_words()[name].owners)
        telling = not whole and name not in ("body", "base", "head", "handle", "top", "side")
        if owned or telling or is_a(whole, "furniture"):
            return part_words()[name].material, f"usual for a part named {name}"
    for one in kinds:
        if one.materials.get("body") in known:
            return one.materials["body"], f"usual for a {one.id}"
    for word in (name, label.lower(), *label.lower().split()):
        if material_words().get(word) in known:
            return material_words()[word], f"the word {word!r} names it"
    if SOFT_WORDS & {*label.lower().split(), name}:
        return FALLBACK_SOFT, f"fallback for soft things: nothing is known of {name!r} of {label!r}"
    return FALLBACK_RIGID, f"fallback: nothing is known of {name!r} of {label!r}"
