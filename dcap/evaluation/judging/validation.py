"""Measures how often a judge is right about pairs with a known answer.

In: a client and pairs (known_answers.py). Out: number of right answers, over both orders of every pair, by the flaw
of the worse one. A tie is not right, however small the difference is.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dcap.evaluation.judging.judge import pair_request
from dcap.evaluation.judging.known_answers import KnownAnswer
from dcap.evaluation.judging.questions import JUDGE_PAIR
from dcap.evaluation.statistics.bootstrap import ConfidenceInterval
from dcap.evaluation.statistics.comparisons import Comparison, Winner
from dcap.evaluation.statistics.sides import SideReport, side_report
from dcap.evaluation.statistics.win_rates import wilson_interval
from dcap.language.connect import Client
from dcap.scene.errors import InputError


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
