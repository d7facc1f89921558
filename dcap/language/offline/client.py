"""The client that needs no model: a transparent reader of sentences, and choices by the lexicon.

It answers only from the request and the lexicon's files, always in the same way, and reports what it did not
understand.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dcap.knowledge.kinds import prior_of
from dcap.knowledge.lexicon import thing_of
from dcap.language.offline.fireplace import FIREPLACE_ANSWERS
from dcap.language.offline.label import label_of
from dcap.language.offline.layout_answer import layout_answer, relations_answer
from dcap.language.offline.material_choice import chosen_materials, material_words_about
from dcap.language.offline.pose_choice import chosen_part, chosen_pose, moved_into_which, one_of_a_whole
from dcap.language.offline.sentence import read
from dcap.language.offline.target import given_target, target_of
from dcap.language.offline.where import facing_of
from dcap.language.offline.words import SceneWords
from dcap.language.protocol.questions import (
    ANCHOR,
    HOLODECK,
    INTENT,
    LABEL,
    LAYOUTGPT,
    MATERIALS,
    PARTS,
    ROTATION,
    LayoutReply,
    LayoutRequest,
    Question,
    RelationsReply,
    RelationsRequest,
    ReplyT,
    RequestT,
)
from dcap.language.protocol.replies import (
    LONGEST_NAME,
    AnchorReply,
    IntentReply,
    LabelReply,
    MaterialsReply,
    PartName,
    PartsReply,
    RotationReply,
)
from dcap.language.protocol.requests import (
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    PartsRequest,
    RotationRequest,
)


class OfflineClient:
    """Reads with the grammar, chooses by rules."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer to one question."""
        answer: Callable[[RequestT], ReplyT] = question.stand_in or ANSWERS[question.name]
        reply = answer(request)
        question.check(reply, request)
        return reply

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """Answers one after the other."""
        return [self.ask(question, request) for request in requests]


def intent(request: IntentRequest) -> IntentReply:
    """Which base, how big, how heavy, which orientation and region."""
    known = SceneWords.of((one.id, one.label) for one in request.instances)
    reading = read(request.prompt, known, request.item.label)
    target = given_target(reading, request) if request.given_base else target_of(reading, request)
    leaning = reading.pose == "leaning"
    theme = reading.theme
    name = theme.text.removeprefix("the ").removeprefix("a ") if theme and not theme.pronoun else request.item.label
    prior = prior_of(theme.thing if theme else "", request.item.label, request.item.size, name[:LONGEST_NAME])
    facing, unclear = facing_of(reading, target, request)
    base = thing_of(target.base.label) if target.base else None
    used = material_words_about(request.prompt, prior.name, base.id if base else "")
    unclear = tuple(word for word in (*target.not_understood, *unclear) if word not in used)
    said = (reading.pose_words, reading.facing.text if reading.facing else "", reading.turn_words)
    words = " ".join(word for word in said if word)
    return IntentReply.model_validate(
        {
            "base_id": target.base.id if target.base else "",
            "missing": target.missing,
            "did_you_mean": target.meant if target.missing else "",
            "candidates": target.candidates,
            "reference_candidates": target.reference_candidates,
            "object_name": prior.name,
            "size": prior.sizes[0],
            "alternative_sizes": prior.sizes[1:],
            "spread": prior.spread,
            "mass": prior.mass,
            "hollow": prior.hollow,
            "pose": "upright" if leaning and not target.lean_on else reading.pose,
            "lean_on": target.lean_on,
            "facing": facing,
            "turn_deg": reading.turn,
            "orientation_words": words,
            "part": target.part,
            "which": target.which,
            "regions": tuple(target.regions),
            "references": tuple(target.references),
            "constraints": tuple(target.constraints),
            "region_words": ", ".join(target.words),
            "not_understood": tuple(dict.fromkeys(unclear)),
            "notes": (*reading.notes, *prior.notes, *target.notes),
        }
    )


def rotation(request: RotationRequest) -> RotationReply:
    """The listed pose that fits the words, else the usual one of such a thing."""
    thing = thing_of(request.object_name)
    pose, reason = chosen_pose(request, thing)
    facings = {facing.id for facing in request.facings}
    facing = request.facing if request.facing in facings else "aligned"
    return RotationReply(pose_id=pose.id, facing_id=facing, turn_deg=request.turn_deg, reason=reason)


def anchor(request: AnchorRequest) -> AnchorReply:
    """The requested part, or the part that usually carries things; the requested region."""
    part, reason = chosen_part(request)
    regions = request.asked_regions
    if moved_into_which(request, part):
        regions = tuple(r for r in regions if r not in ("left", "right", "middle", "center"))
        reason += f"; the {request.asked_regions[0]} one of several"
    if one_of_a_whole(request, part):
        regions = (request.asked_which, *regions)
    return AnchorReply.model_validate(
        {"part_index": part.index, "regions": regions, "references": request.asked_references, "reason": reason}
    )


def materials(request: MaterialsRequest) -> MaterialsReply:
    """Materials by words, the thing's own list, category and part name; otherwise a stated fallback."""
    return MaterialsReply(choices=tuple(chosen_materials(request)))


def label(request: LabelRequest) -> LabelReply:
    """The label whose usual shape, size and height fit best."""
    return label_of(request)


def parts(request: PartsRequest) -> PartsReply:
    """The proposed names, which already come from rules."""
    names = (PartName(index=p.part.index, name=p.part.name, confidence=p.confidence) for p in request.parts)
    return PartsReply(names=tuple(names), reason="as geometry proposes")


def layoutgpt(request: LayoutRequest) -> LayoutReply:
    """A line that places a box as the sentence requests, by the reader of the intent."""
    return layout_answer(request, understood(request))


def holodeck(request: RelationsRequest) -> RelationsReply:
    """The receptacle and the relations that the sentence names, by the reader of the intent."""
    return relations_answer(request, understood(request))


def understood(request: LayoutRequest | RelationsRequest) -> IntentReply:
    """The intent that our own method would read from the prompt."""
    return intent(IntentRequest(request.prompt, request.item, request.instances, request.room_center))


ANSWERS: Mapping[str, Callable[[Any], Any]] = {
    INTENT.name: intent,
    ROTATION.name: rotation,
    ANCHOR.name: anchor,
    MATERIALS.name: materials,
    LABEL.name: label,
    PARTS.name: parts,
    LAYOUTGPT.name: layoutgpt,
    HOLODECK.name: holodeck,
    **FIREPLACE_ANSWERS,
}
"""The function that answers each question."""
