"""Pairs of placements with a known answer, and how often a judge is right about them.

A heavy ball is requested at the centre of the bed, or on the floor next to it. A ball at rest, in a dent of the depth
and shape that its weight presses, or on the floor, is better than the same ball over or inside its support, by an
obvious 5 cm and by the 5, 2 and 1 mm that are typical of proposals; better than a ball on a mattress that does not give
way; and better placed than one elsewhere. In each pair one placement is better on the stated axis; nothing is claimed
about other axes.

Every pair is asked in both orders. A tie is not right, however small the difference is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from dcap.evaluation.judging.judge import JudgedPlacement, pair_request
from dcap.evaluation.judging.known_room import BED, DENT, FLOOR, ON_THE_FLOOR, PROMPTS, SETTLED, BallPlace, RoomWithBall
from dcap.evaluation.judging.questions import JUDGE_PAIR
from dcap.evaluation.statistics.agreement import SideReport, side_report
from dcap.evaluation.statistics.bootstrap import ConfidenceInterval
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, Winner
from dcap.evaluation.statistics.method_tables import wilson_interval
from dcap.language.connect import Client
from dcap.scene.errors import InputError
from dcap.synthetic.rooms import build_room

OBJECT = "bowling ball"
AT_REST = {BED: SETTLED, FLOOR: ON_THE_FLOOR}
OFFSETS_MM = (50, 5, 2, 1)
"""Distances of wrong placements over or inside their undeformed support [mm]."""
ASIDE = 0.3
"""Distance of a misplaced settled ball from the middle [m]."""
BETTER, WORSE = "better", "worse"


@dataclass(frozen=True, slots=True)
class KnownAnswer:
    """A pair in which one placement is undoubtedly better on one axis."""

    better: JudgedPlacement
    worse: JudgedPlacement
    axis: JudgedAxis
    flaw: str
    """Flaw of the worse placement."""


def known_answers(room_name: str, seed: int = 0) -> list[KnownAnswer]:
    """The pairs of a room; InputError if it has no bed, or no free floor next to it."""
    room = RoomWithBall(room_name, build_room(room_name, seed))
    found = []
    for asked in (BED, FLOOR):
        for flaw, place, axis in flawed(asked):
            both, sample = (AT_REST[asked], place), f"{room_name}: {flaw}"
            good, worse = placement(room, both[0], asked, BETTER, both), placement(room, place, asked, WORSE, both)
            found.append(KnownAnswer(replace(good, sample=sample), replace(worse, sample=sample), axis, flaw))
    return found


def flawed(asked: str) -> Iterator[tuple[str, BallPlace, JudgedAxis]]:
    """Flaws, their places, and the axis on which the ball at rest is better."""
    for offset in OFFSETS_MM:
        yield f"{offset} mm over the {asked}", BallPlace(asked, 1e-3 * offset), JudgedAxis.PHYSICS_NATURALNESS
        yield f"{offset} mm inside the {asked}", BallPlace(asked, -1e-3 * offset), JudgedAxis.PHYSICS_NATURALNESS
    if asked == FLOOR:
        yield "on the bed", SETTLED, JudgedAxis.RIGHT_PLACE
        return
    yield "no dent", BallPlace(BED), JudgedAxis.PHYSICS_NATURALNESS
    yield "on the floor", ON_THE_FLOOR, JudgedAxis.RIGHT_PLACE
    aside = BallPlace(BED, -DENT, dented=True, aside=ASIDE)
    yield f"{1e2 * ASIDE:.0f} cm off the middle", aside, JudgedAxis.RIGHT_PLACE


def placement(
    room: RoomWithBall, place: BallPlace, asked: str, method: str, compared: tuple[BallPlace, ...]
) -> JudgedPlacement:
    """One of the compared placements in the form that a judge takes."""
    return JudgedPlacement(
        sample=room.name,
        method=method,
        prompt=PROMPTS[asked],
        object_name=OBJECT,
        metrics=room.metrics(place, asked),
        before=room.before(asked, compared),
        views=room.views(place, asked, compared),
    )


@dataclass(frozen=True, slots=True)
class JudgeAccuracy:
    """Accuracy of a judge."""

    judge: str
    right: int
    asked: int
    """Two for each pair: either one on the left."""
    interval: ConfidenceInterval
    """95 % interval of the accuracy (Wilson)."""
    by_flaw: dict[str, tuple[int, int]]
    """Right answers and questions, by the flaw of the worse placement."""
    sides: SideReport

    @property
    def accuracy(self) -> float:
        """Share of right answers, 0..1."""
        return self.right / self.asked

    @property
    def in_words(self) -> str:
        """One line for a person."""
        flaws = ", ".join(f"{name} {right} of {asked}" for name, (right, asked) in self.by_flaw.items())
        return (
            f"{self.judge}: {self.right} of {self.asked} known answers right "
            f"({self.accuracy:.0%}, 95 % {self.interval.low:.0%} to {self.interval.high:.0%}): {flaws}"
        )


def judge_accuracy(client: Client, answers: Sequence[KnownAnswer], judge: str) -> JudgeAccuracy:
    """Ask every pair in both orders and count right answers; InputError if there is no pair."""
    if not answers:
        raise InputError("there are no pairs with known answers: a judge cannot be validated")
    asked = [(one, order) for one in answers for order in ((one.better, one.worse), (one.worse, one.better))]
    replies = client.ask_all(JUDGE_PAIR, [pair_request(left, right) for _, (left, right) in asked])
    rows = [
        Comparison(left.sample, one.axis, left.method, right.method, reply.winner(one.axis) or Winner.TIE, judge)
        for (one, (left, right)), reply in zip(asked, replies, strict=True)
    ]
    by_flaw: dict[str, tuple[int, int]] = {}
    for (one, _), row in zip(asked, rows, strict=True):
        right, count = by_flaw.get(one.flaw, (0, 0))
        by_flaw[one.flaw] = (right + (row.winning_method == one.better.method), count + 1)
    total = sum(right for right, _ in by_flaw.values())
    return JudgeAccuracy(judge, total, len(rows), wilson_interval(total, len(rows)), by_flaw, side_report(rows))
