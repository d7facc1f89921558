"""Questions to a judge, with scored examples: two scores of one placement, or the better of two.

A model sees the sentence and pictures: examples of the rubric, the clean scene, the asset alone, an overview and a
close-up of every placement. It never sees the method or a metric; metrics are for the metric rubric, which answers
without a model.

The rubric's examples, with scores and pictures: a scoring model sees them before the placement.

They are rendered on demand from an embedded room (known_room.py), always the same, with the cameras used for
placements. The room is not used for validating judges, and no validation placement is an example.
"""

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cache, partial
from typing import Annotated, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, Field, WithJsonSchema

from dcap.evaluation.judging.known_room import BED, FLOOR, PROMPTS, SETTLED, BallPlace, RoomWithBall
from dcap.evaluation.judging.rubric import RUBRIC, Metrics, rubric_scores, worst_metric
from dcap.evaluation.statistics.comparisons import JudgedAxis, Winner
from dcap.language.protocol.questions import Question
from dcap.language.protocol.requests import Picture
from dcap.scene.errors import LanguageError
from dcap.scene.types.pictures import PLACED
from dcap.synthetic.rooms import build_room

AnswerT = TypeVar("AnswerT")
TIE_POINTS = 0.25
"""Difference of scores below which the rubric calls a tie: people cannot distinguish a quarter of a point."""
ROOM = "guest_01"
"""An embedded room with a bed."""
CAPTIONS = {"overview": "overview", "closeup": "close-up of the contact"}
"""Captions of a placement's pictures for a model."""


@dataclass(frozen=True, slots=True)
class ScoreRequest:
    """Question for the scores of one placement."""

    prompt: str
    object_name: str
    metrics: Metrics = field(default_factory=dict)
    """For the rubric only."""
    examples: tuple[Picture, ...] = field(default=(), compare=False)
    """Examples of placements with their scores, the same in every request."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)


class PairAnswer(StrEnum):
    """The better of two placements."""

    A = "A"
    B = "B"
    TIE = "tie"

    @property
    def winner(self) -> Winner:
        """The winner by side: A is the left one."""
        return {PairAnswer.A: Winner.LEFT, PairAnswer.B: Winner.RIGHT, PairAnswer.TIE: Winner.TIE}[self]


@dataclass(frozen=True, slots=True)
class PairRequest:
    """Question which of two placements is better: A, on the left of a comparison, or B."""

    prompt: str
    object_name: str
    left_metrics: Metrics = field(default_factory=dict)
    """For the rubric only."""
    right_metrics: Metrics = field(default_factory=dict)
    pictures: tuple[Picture, ...] = field(default=(), compare=False)


# The rubric may have no metric of an axis; a model has seen the pictures and must judge it. So null is not in the
# schema
# for a model and is refused in its answers; only the rubric, whose replies are not parsed, returns it.
def require_answer(value: AnswerT | None) -> AnswerT:
    """An answer that is not null; ValueError otherwise."""
    if value is None:
        raise ValueError("null is no answer; each axis must be judged")
    return value


POINTS_SCHEMA = {
    "type": "number", "minimum": 1.0, "maximum": 10.0, "description": "1 to 10; halves are allowed",
}  # fmt: skip
JudgedScorePoints = Annotated[
    Annotated[float, Field(ge=1.0, le=10.0, strict=True)] | None,
    AfterValidator(require_answer),
    WithJsonSchema(POINTS_SCHEMA),
]
ANSWER_SCHEMA = {"type": "string", "enum": [one.value for one in PairAnswer]}
JudgedAnswer = Annotated[PairAnswer | None, AfterValidator(require_answer), WithJsonSchema(ANSWER_SCHEMA)]


class ScoreReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Two scores."""

    analysis: str = Field(description="two or three short sentences: what is seen that decides the scores")
    right_place: JudgedScorePoints
    physics_naturalness: JudgedScorePoints


class PairReply(BaseModel, frozen=True, extra="forbid"):
    """A winner on each axis."""

    analysis: str = Field(description="a short sentence for each axis")
    right_place: JudgedAnswer
    physics_naturalness: JudgedAnswer
    overall: JudgedAnswer

    def winner(self, axis: JudgedAxis) -> Winner | None:
        """Winner on an axis; None if unknown."""
        value = getattr(self, axis)
        return None if value is None else PairAnswer(value).winner


def no_check(reply: BaseModel, request: object) -> None:
    """Accept every reply: types and ranges say all."""


def rubric_score(request: ScoreRequest) -> ScoreReply:
    """The rubric's two scores, null on an axis without known metrics; LanguageError if both are null."""
    place, physics = known_scores(request.metrics)
    flaws = (worst_metric(request.metrics, axis) for axis in (JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS))
    return ScoreReply.model_construct(
        analysis=f"{RUBRIC}; lowest: {', '.join(flaw or 'not known' for flaw in flaws)}",
        right_place=place,
        physics_naturalness=physics,
    )


def rubric_pair(request: PairRequest) -> PairReply:
    """The higher score wins an axis that both have; the higher geometric mean of the known axes wins overall, null
    if the two have different axes."""
    left, right = known_scores(request.left_metrics), known_scores(request.right_metrics)
    place, physics = (preferred(a, b) for a, b in zip(left, right, strict=True))
    same = [one is None for one in left] == [one is None for one in right]
    sides = ("left", left), ("right", right)
    said = ", ".join(f"{side} {' and '.join('-' if x is None else f'{x:g}' for x in own)}" for side, own in sides)
    return PairReply.model_construct(
        analysis=f"{RUBRIC}; {said}",
        right_place=place,
        physics_naturalness=physics,
        overall=preferred(all_in_all(left), all_in_all(right)) if same else None,
    )


def known_scores(metrics: Metrics) -> tuple[float | None, float | None]:
    """Both scores of the rubric; LanguageError if neither is known."""
    scores = rubric_scores(metrics)
    if scores == (None, None):
        raise LanguageError(f"the {RUBRIC} cannot judge a placement of which no metric is known; ask a model")
    return scores


def all_in_all(scores: tuple[float | None, float | None]) -> float:
    """Geometric mean of the known scores."""
    known = [one for one in scores if one is not None]
    return math.prod(known) ** (1.0 / len(known))


def preferred(left: float | None, right: float | None) -> PairAnswer | None:
    """The higher of two scores, a tie if they are nearly equal; None if one is unknown."""
    if left is None or right is None:
        return None
    if abs(left - right) < TIE_POINTS:
        return PairAnswer.TIE
    return PairAnswer.A if left > right else PairAnswer.B


JUDGE_SCORE = Question("judge_score", ScoreRequest, ScoreReply, no_check, unseen=("metrics",), stand_in=rubric_score)
JUDGE_PAIR = Question(
    "judge_pair", PairRequest, PairReply, no_check, unseen=("left_metrics", "right_metrics"), stand_in=rubric_pair
)


@dataclass(frozen=True, slots=True)
class Example:
    """A placement and its scores."""

    asked: str
    """BED or FLOOR."""
    place: BallPlace
    words: str
    """Description of the picture."""
    right_place: float
    physics_naturalness: float

    @property
    def caption(self) -> str:
        """Caption for a model."""
        return (
            f'"{PROMPTS[self.asked]}": {self.words}. '
            f"right_place {self.right_place:g}, physics_naturalness {self.physics_naturalness:g}"
        )


EXAMPLES = (
    Example(BED, SETTLED, "it lies in the middle of the mattress in a dent of its own shape", 10, 10),
    Example(BED, BallPlace(BED), "it touches the mattress in one point, nothing gives way", 10, 6),
    Example(BED, BallPlace(BED, 0.08), "it hovers a hand's breadth above the middle of the mattress", 9, 2),
    Example(BED, BallPlace(BED, -0.1), "half of it is inside a mattress that did not give way", 10, 2),
    Example(FLOOR, SETTLED, "it lies in a dent of the bed", 2, 10),
)


@cache
def example_room() -> RoomWithBall:
    """The room of all examples."""
    return RoomWithBall(ROOM, build_room(ROOM, 0))


def example_pictures() -> tuple[Picture, ...]:
    """Two pictures of each example, with captions for a model."""
    found = []
    for number, one in enumerate(EXAMPLES, 1):
        for view in PLACED:
            said = f"example {number}, {CAPTIONS[view]}" + (f"; {one.caption}" if view == PLACED[0] else "")
            found.append(Picture(said, partial(drawn, one, view)))
    return tuple(found)


def drawn(example: Example, view: str) -> NDArray[np.uint8]:
    """One picture of an example."""
    compared = tuple(dict.fromkeys(one.place for one in EXAMPLES if one.asked == example.asked))
    return example_room().seen(example.place, example.asked, compared, view)
