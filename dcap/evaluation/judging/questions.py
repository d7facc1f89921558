"""What a judge is asked: two scores of one placement, or which of two is better on each axis.

A model sees the sentence and pictures: the clean scene, the asset alone, the same views of every placement. It never
sees which method made one, nor a metric; those are for the metric rubric, which answers where no model is asked.
"""

import math
from dataclasses import dataclass, field

from pydantic import BaseModel, Field

from dcap.evaluation.judging.rubric import RUBRIC, Metrics, rubric_scores, worst_metric
from dcap.evaluation.statistics.comparisons import JudgedAxis, Winner
from dcap.language.protocol.questions import Question
from dcap.language.protocol.requests import PictureMaker
from dcap.scene.errors import LanguageError

TIE_POINTS = 0.25
"""The rubric calls a tie where scores differ by less: a quarter of a point is less than people tell apart."""


@dataclass(frozen=True, slots=True)
class ScoreRequest:
    """How good is one placement."""

    prompt: str
    object_name: str
    picture_names: tuple[str, ...]
    """What each picture shows, in their order."""
    metrics: Metrics = field(default_factory=dict)
    """For the rubric only."""
    pictures: tuple[PictureMaker, ...] = field(default=(), compare=False)


@dataclass(frozen=True, slots=True)
class PairRequest:
    """Which of two placements is better."""

    prompt: str
    object_name: str
    picture_names: tuple[str, ...]
    """What each picture shows, in their order; those of placements show both side by side."""
    left_metrics: Metrics = field(default_factory=dict)
    """For the rubric only."""
    right_metrics: Metrics = field(default_factory=dict)
    pictures: tuple[PictureMaker, ...] = field(default=(), compare=False)


class ScoreReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Two scores."""

    analysis: str = Field(description="two or three short sentences: what is seen that decides the scores")
    right_place: float = Field(ge=1.0, le=10.0, strict=True, description="1 to 10; halves are allowed")
    physics_naturalness: float = Field(ge=1.0, le=10.0, strict=True, description="1 to 10; halves are allowed")


class PairReply(BaseModel, frozen=True, extra="forbid"):
    """A winner on each axis."""

    analysis: str = Field(description="a short sentence for each axis")
    right_place: Winner
    physics_naturalness: Winner
    overall: Winner

    def winner(self, axis: JudgedAxis) -> Winner:
        """Who wins on an axis."""
        return Winner(getattr(self, axis))


def no_check(reply: BaseModel, request: object) -> None:
    """Types and ranges say all that a reply must keep."""


def rubric_score(request: ScoreRequest) -> ScoreReply:
    """The rubric's two scores; LanguageError where no metric of an axis is known."""
    place, physics = known_scores(request.metrics)
    flaws = (worst_metric(request.metrics, axis) for axis in (JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS))
    return ScoreReply(analysis=f"{RUBRIC}; lowest: {', '.join(flaws)}", right_place=place, physics_naturalness=physics)


def rubric_pair(request: PairRequest) -> PairReply:
    """The higher score wins an axis, the higher geometric mean overall."""
    left, right = known_scores(request.left_metrics), known_scores(request.right_metrics)
    place, physics = (preferred(a, b) for a, b in zip(left, right, strict=True))
    overall = preferred(math.sqrt(left[0] * left[1]), math.sqrt(right[0] * right[1]))
    said = f"{RUBRIC}; left {left[0]:g} and {left[1]:g}, right {right[0]:g} and {right[1]:g}"
    return PairReply(analysis=said, right_place=place, physics_naturalness=physics, overall=overall)


def known_scores(metrics: Metrics) -> tuple[float, float]:
    """Both scores of the rubric; LanguageError where one is not known."""
    place, physics = rubric_scores(metrics)
    if place is None or physics is None:
        axis = JudgedAxis.RIGHT_PLACE if place is None else JudgedAxis.PHYSICS_NATURALNESS
        raise LanguageError(f"the metric rubric cannot judge {axis}: none of its metrics is known; ask a model instead")
    return place, physics


def preferred(left: float, right: float) -> Winner:
    """The higher of two scores; a tie where they are nearly equal."""
    if abs(left - right) < TIE_POINTS:
        return Winner.TIE
    return Winner.LEFT if left > right else Winner.RIGHT


JUDGE_SCORE = Question("judge_score", ScoreRequest, ScoreReply, no_check, unseen=("metrics",), stand_in=rubric_score)
JUDGE_PAIR = Question(
    "judge_pair", PairRequest, PairReply, no_check, unseen=("left_metrics", "right_metrics"), stand_in=rubric_pair
)
