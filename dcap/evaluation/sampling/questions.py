"""Question for samples of a scene: sentences with their truths, checked, and read back by our reader.

Offline the templates answer. A model sees instances and objects with their sizes and writes freely; its samples must be
true of the scene as far as labels, parts and sizes tell, or it is asked again with the reason.

Compares the embedded reader's reading of sentences with their truth: support, part, region, pose and facing.

It measures both. No sample is left out because the reader misses it: a benchmark cut to its reader would flatter it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, Field

from dcap.evaluation.outcome_table import ExpectedOutcome, same_region
from dcap.evaluation.sampling.requests import PlacedAsset, asked_front
from dcap.evaluation.sampling.supports import thing_name
from dcap.evaluation.sampling.templates import TemplateSample, template_samples
from dcap.knowledge.lexicon import Meaning, in_line, label_words, longest_phrase, split_words, vocabulary
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT, Question
from dcap.language.protocol.replies import Region
from dcap.language.protocol.requests import InstanceView, IntentRequest, Vector
from dcap.scene.errors import LanguageError

LONGEST_SENTENCE = 300
"""Longest sentence [characters]."""
MOST_SAMPLES = 200
"""Most samples of one scene [-]."""
TELLS_APART = frozenset({"side", "count", "colour", "viewer", "id word", "region", "restrict", "now"})
"""Kinds of words that alone may identify one of several similar things."""
Top = Literal["", "up", "down", "sideways"]
RefusalReason = Literal["", "target_not_found", "too_large_for_target"]
POSES_OF_TOP = {
    "up": ("upright", "seated", "standing"),
    "down": ("upside_down",),
    "sideways": ("on_side", "on_left_side", "on_right_side", "lying"),
}


@dataclass(frozen=True, slots=True)
class SamplesRequest:
    """A request for placements in a scene."""

    scene: str
    """Its name."""
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    assets: tuple[PlacedAsset, ...]
    """Objects that can be placed."""
    count: int
    infeasible: int
    """Number of samples that should be refused."""
    seed: int


class SampleDraft(BaseModel, frozen=True, extra="forbid"):
    """A sentence with its intended outcome."""

    object: str = Field(description="name of a listed asset")
    prompt: str = Field(min_length=1, max_length=LONGEST_SENTENCE, description="one English sentence in one line")
    base_id: str = Field(
        default="", description="id of the listed instance that shall carry the object; empty if absent"
    )
    any_such: bool = Field(default=False, description="the sentence means any of several instances of that label")
    part: str = Field(default="", description="name of the listed part of the base, only if no other will do")
    regions: tuple[Region, ...] = Field(default=(), description="only what the sentence says of the place on the base")
    top: Top = Field(default="", description="where the object's own top points, only if the sentence says so")
    facing_id: str = Field(
        default="", description="id of the listed instance that its front shall look at, only if the sentence says so"
    )
    reason: RefusalReason = Field(default="", description="why it ought to be refused; empty if it ought to rest there")

    def truth(self, request: SamplesRequest) -> ExpectedOutcome:
        """The intended outcome."""
        there = {one.id: one for one in request.instances}
        base, faced = there.get(self.base_id), there.get(self.facing_id)
        asset = next(one for one in request.assets if one.name == self.object)
        return ExpectedOutcome(
            base=base.label if base is not None else "",
            base_id="" if self.any_such else self.base_id,
            part=self.part,
            region=" ".join(self.regions),
            top=self.top,
            front=asked_front(asset, base, faced) if base is not None and faced is not None else None,
            feasible=not self.reason,
            reason=self.reason,
        )


class SamplesReply(BaseModel, frozen=True, extra="forbid"):
    """The samples of a scene."""

    samples: tuple[SampleDraft, ...] = Field(max_length=MOST_SAMPLES)

    def check(self, request: SamplesRequest) -> None:
        """Raise ValueError for samples that are not true of the scene, are duplicates, or have the wrong number."""
        if len(self.samples) != request.count:
            raise ValueError(f"{len(self.samples)} samples, expected {request.count}")
        refused = sum(one.reason != "" for one in self.samples)
        if refused > request.infeasible:
            raise ValueError(f"{refused} samples ought to be refused, expected {request.infeasible}")
        seen: set[tuple[str, str]] = set()
        for one in self.samples:
            same = one.object, " ".join(word for word in split_words(one.prompt) if word != ",")
            if same in seen:
                raise ValueError(f"two samples ask for {one.object!r} with {one.prompt!r}")
            seen.add(same)
            check_sample(one, request)


def check_sample(one: SampleDraft, request: SamplesRequest) -> None:
    """Raise ValueError for a sample that is not true of the scene."""
    asset = next((asset for asset in request.assets if asset.name == one.object), None)
    base = next((i for i in request.instances if i.id == one.base_id), None)
    said = f"sample {one.prompt!r}"
    if asset is None:
        raise ValueError(f"{said}: object {one.object!r} is not listed")
    if one.prompt != " ".join(one.prompt.split()):
        raise ValueError(f"{said} is not one line of words with single spaces")
    if one.reason == "target_not_found":
        others = [i for i in request.instances if not i.structure and not is_such(asset, i)]
        there = [i.label for i in others if speaks_of_label(one.prompt, i)]
        if base is not None or one.part or there:
            raise ValueError(
                f"{said}: what is not found has no base, but the scene has {', '.join(there) or one.base_id}"
            )
        return
    if base is None:
        raise ValueError(f"{said}: base_id {one.base_id!r} is not listed")
    if not speaks_of(one.prompt, base):
        raise ValueError(f"{said} does not name its base, the {base.label}")
    if one.part and one.part not in [part.name for part in base.parts]:
        raise ValueError(f"{said}: the {base.label} {base.id} has no part {one.part!r}")
    several = sum(label_words(i.label) == label_words(base.label) for i in request.instances) > 1
    if one.any_such and not several:
        raise ValueError(f"{said}: any_such, but {base.id} is the only {base.label}")
    if (
        several
        and not one.any_such
        and not says_which(one.prompt, base, [i for i in request.instances if not is_such(asset, i)])
    ):
        raise ValueError(
            f"{said}: there are several of label {base.label!r}, and nothing in it says that {base.id} is meant; "
            "say which, or that any_such will do"
        )
    faced = next((i for i in request.instances if i.id == one.facing_id), None)
    if one.facing_id and (faced is None or one.any_such or asset.front is None or not speaks_of(one.prompt, faced)):
        raise ValueError(
            f"{said}: facing_id {one.facing_id!r} is for an asset with a front on one base, and for a listed instance "
            "that the sentence names"
        )
    large = min(asset.size) > max(base.size[:2])
    if one.reason != "too_large_for_target" and large:
        raise ValueError(f"{said}: the {asset.noun} of {max(asset.size):.2f} m does not fit on the {base.label}")
    if one.reason == "too_large_for_target" and not large:
        raise ValueError(f"{said}: the {asset.noun} of {min(asset.size):.2f} m may well fit on the {base.label}")


def speaks_of(prompt: str, base: InstanceView) -> bool:
    """Whether a sentence has a noun for an instance: its label's words, or a word for such a thing or a part of it."""
    thing, parts = thing_name(base), {part.name for part in base.parts}
    for meaning in meanings(prompt):
        if meaning.kind == "thing" and thing and in_line(meaning.value, thing):
            return True
        if meaning.kind == "part" and meaning.value in parts:
            return True
    return speaks_of_label(prompt, base)


def says_which(prompt: str, base: InstanceView, instances: Sequence[InstanceView]) -> bool:
    """Whether a sentence has any words that could distinguish an instance from others of its label: a place, a colour,
    a number, or another thing of the scene. Whether they do is unknown; without any, the instance is ambiguous."""
    if any(meaning.kind in TELLS_APART for meaning in meanings(prompt)):
        return True
    own = label_words(base.label)
    return any(
        speaks_of(prompt, one) for one in instances if label_words(one.label) != own and not same_noun(one, base)
    )


def same_noun(one: InstanceView, other: InstanceView) -> bool:
    """Whether a word for one thing may mean the other."""
    thing, another = thing_name(one), thing_name(other)
    return bool(thing and another) and (in_line(thing, another) or in_line(another, thing))


def meanings(prompt: str) -> Iterator[Meaning]:
    """All possible meanings of the words of a sentence."""
    words = split_words(prompt)
    for begin in range(len(words)):
        for end in range(begin + 1, min(len(words), begin + longest_phrase()) + 1):
            yield from vocabulary().get(tuple(words[begin:end]), ())


def is_such(asset: PlacedAsset, instance: InstanceView) -> bool:
    """Whether an instance shares the object's name: a sentence with that name means the object."""
    thing = thing_name(instance)
    return (thing != "" and in_line(thing, asset.thing)) or set(label_words(instance.label)) <= set(asset.noun.split())


def speaks_of_label(prompt: str, base: InstanceView) -> bool:
    """Whether a sentence has all words of an instance's label."""
    own = set(label_words(base.label))
    return bool(own) and own <= set(split_words(prompt))


def by_templates(request: SamplesRequest) -> SamplesReply:
    """The embedded answer."""
    made = template_samples(
        request.scene, request.instances, request.assets, request.count, request.infeasible, request.seed
    )
    return SamplesReply(samples=tuple(draft_of(one) for one in made))


def draft_of(one: TemplateSample) -> SampleDraft:
    """A sample of the templates in the form of a reply."""
    ask, surface = one.ask, one.ask.surface
    tops = {"upright": "up", "upside_down": "down", "on_side": "sideways"}
    reasons = {"absent": "target_not_found", "too large": "too_large_for_target"}
    return SampleDraft.model_validate(
        {
            "object": ask.asset.name,
            "prompt": one.prompt,
            "base_id": surface.base.id if surface is not None else "",
            "any_such": surface is not None and surface.several and not ask.landmark,  # a landmark identifies it
            "part": surface.part if surface is not None else "",
            "regions": ask.regions,
            "top": tops.get(ask.pose, ""),
            "facing_id": ask.faced.id if ask.faced is not None else "",
            "reason": reasons.get(ask.place, ""),
        }
    )


SAMPLES = Question("samples", SamplesRequest, SamplesReply, SamplesReply.check, stand_in=by_templates)


def misread(request: IntentRequest, truth: ExpectedOutcome, faced: str = "") -> str:
    """The reader's deviations in words; empty if it agrees. `faced` is the id of the thing that the object should face
    according to the sentence."""
    try:
        reply = OfflineClient().ask(INTENT, request)
    except LanguageError as refused:
        return f"refused: {' '.join(str(refused).split())}"
    if truth.reason == "target_not_found":
        return f"found {reply.base_id}" if reply.base_id else ""
    base = next((one for one in request.instances if one.id == reply.base_id), None)
    if base is None:
        return f"not found: {reply.missing}"
    if base.label != truth.base or truth.base_id not in ("", base.id):
        return f"base {base.label} {base.id}"
    if reply.part and truth.part and reply.part != truth.part:
        return f"part {reply.part}"
    if truth.region and not same_region(" ".join(reply.regions), truth.region):
        return f"region {' '.join(reply.regions) or 'none'}"
    if not truth.region and (reply.regions or reply.constraints):
        return f"region {' '.join(reply.regions)} where none is requested"
    if truth.top and reply.pose not in POSES_OF_TOP[truth.top]:
        return f"pose {reply.pose}"
    if reply.facing != faced:
        return f"facing {reply.facing or 'nothing'}"
    return f"not understood: {', '.join(reply.not_understood)}" if reply.not_understood else ""
