"""Has a judge score placements, and compare all pairs with either on the left.

In: placements with their pictures and metrics, and a client. Out: rows of scores and comparisons, in an order that
depends on the placements alone, so that recorded replies give the same tables to the last byte. Pairs are formed
within a sample only; every question stands for itself, and a batch may hold them all.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

from dcap.evaluation.judging.examples import CAPTIONS, example_pictures
from dcap.evaluation.judging.judged_pictures import BEFORE_TITLES
from dcap.evaluation.judging.questions import JUDGE_PAIR, JUDGE_SCORE, PairRequest, ScoreRequest
from dcap.evaluation.judging.rubric import RUBRIC, Metrics
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis
from dcap.language.connect import Client
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.requests import Picture
from dcap.scene.errors import InputError

MODELS = {
    "alibaba": "qwen qwq qvq", "allen": "olmo molmo", "amazon": "nova", "anthropic": "claude", "cohere": "command aya",
    "deepseek": "deepseek", "google": "gemini gemma paligemma", "ibm": "granite", "meta": "llama", "microsoft": "phi",
    "mistral": "mistral mixtral pixtral ministral magistral codestral devstral", "moonshot": "kimi moonshot",
    "nvidia": "nemotron", "openai": "gpt chatgpt o1 o3 o4", "openbmb": "minicpm", "opengvlab": "internvl internlm",
    "xai": "grok", "zhipu": "glm chatglm cogvlm",
}  # fmt: skip
"""Names of models by maker."""
FAMILIES = {name: maker for maker, names in MODELS.items() for name in names.split()}
"""Makers by a word of a model's name."""
LEADING = re.compile(r"(?:[a-z]+\.)*([a-z]{2,})")
"""The word before the first digit, dash or colon, without dotted prefixes: `us.maker.word-7b`. A single letter is a
version: `v2`."""


@dataclass(frozen=True, slots=True)
class JudgedPlacement:
    """One method's placement of a sample, in the form that a judge takes."""

    sample: str
    method: str
    prompt: str
    object_name: str
    metrics: Metrics
    before: tuple[Picture, ...]
    """The clean scene and the asset alone: the same for all methods of a sample."""
    views: tuple[Picture, ...]
    """The overview, from one camera for all methods of a sample, and the close-up, centred on the contact from the same
    direction and distance."""


@dataclass(frozen=True, slots=True)
class JudgedScore:
    """A row of scores."""

    sample: str
    method: str
    right_place: float | None
    """1..10; None if no metric of the axis is known."""
    physics_naturalness: float | None
    """1..10; None likewise."""
    judge: str
    analysis: str


def judge_name(config: LanguageConfig) -> str:
    """Name of the judge in tables; a replayed model has its original name."""
    if config.client is ClientName.OFFLINE:
        return RUBRIC
    return f"{config.model}@{config.endpoint}" if config.endpoint else config.model


def model_family(model: str) -> str:
    """Maker of a model, from the first known word of its name, whatever gateway precedes it; else the word with which
    the last part of its path begins, as gateways, regions and owners precede it, and sizes and versions follow. A name
    that begins with no word is a family of its own."""
    name = model.lower()
    for word in re.findall(r"[a-z]+\d?", name):
        if family := FAMILIES.get(word) or FAMILIES.get(word.rstrip("0123456789")):
            return family
    leading = LEADING.match(name.rpartition("/")[2])
    return leading[1] if leading else name


def same_family(judge: LanguageConfig, chooser: LanguageConfig) -> bool:
    """Whether a model judges choices by a model of the same maker, which it may favour."""
    if ClientName.OFFLINE in (judge.client, chooser.client):
        return False
    return model_family(judge.model) == model_family(chooser.model)


def scores(client: Client, placements: Sequence[JudgedPlacement], judge: str) -> list[JudgedScore]:
    """Both scores of every placement, sorted by sample and method."""
    rows = in_order(placements)
    replies = client.ask_all(JUDGE_SCORE, [score_request(one) for one in rows])
    return [
        JudgedScore(one.sample, one.method, reply.right_place, reply.physics_naturalness, judge, reply.analysis)
        for one, reply in zip(rows, replies, strict=True)
    ]


def comparisons(client: Client, placements: Sequence[JudgedPlacement], judge: str) -> list[Comparison]:
    """All pairs of methods of each sample, once with either on the left, on the axes that are known for both."""
    asked = [pair for one in pairs(placements) for pair in (one, one[::-1])]
    replies = client.ask_all(JUDGE_PAIR, [pair_request(left, right) for left, right in asked])
    return [
        Comparison(left.sample, axis, left.method, right.method, winner, judge)
        for (left, right), reply in zip(asked, replies, strict=True)
        for axis in JudgedAxis
        if (winner := reply.winner(axis)) is not None
    ]


def pairs(placements: Iterable[JudgedPlacement]) -> list[tuple[JudgedPlacement, JudgedPlacement]]:
    """All pairs of methods within a sample."""
    return [(a, b) for a, b in combinations(in_order(placements), 2) if a.sample == b.sample]


def in_order(placements: Iterable[JudgedPlacement]) -> list[JudgedPlacement]:
    """Placements sorted by sample and method; InputError for a duplicate."""
    rows = sorted(placements, key=lambda one: (one.sample, one.method))
    for one, after in pairwise(rows):
        if (one.sample, one.method) == (after.sample, after.method):
            raise InputError(f"sample {one.sample!r} of {one.method} is to be judged twice")
    return rows


def score_request(one: JudgedPlacement) -> ScoreRequest:
    """The question for two scores."""
    shown = (*titled(one.before), *captioned("the placement", one.views))
    return ScoreRequest(one.prompt, one.object_name, one.metrics, example_pictures(), shown)


def pair_request(left: JudgedPlacement, right: JudgedPlacement) -> PairRequest:
    """The question which placement is better; InputError if their views differ."""
    if [v.name for v in left.views] != [v.name for v in right.views] or left.prompt != right.prompt:
        raise InputError(
            f"sample {left.sample!r}: {left.method} and {right.method} have other views or prompts; "
            "a pair needs the same of both"
        )
    shown = (
        *titled(left.before), *captioned("placement A", left.views), *captioned("placement B", right.views),
    )  # fmt: skip
    return PairRequest(left.prompt, left.object_name, left.metrics, right.metrics, shown)


def captioned(which: str, views: tuple[Picture, ...]) -> tuple[Picture, ...]:
    """The views of a placement with their captions."""
    return tuple(Picture(f"{which}, {CAPTIONS.get(one.name, one.name)}", one.make) for one in views)


def titled(before: tuple[Picture, ...]) -> tuple[Picture, ...]:
    """The clean scene and the asset with their captions."""
    return tuple(Picture(name, one.make) for name, one in zip(BEFORE_TITLES, before, strict=False))
