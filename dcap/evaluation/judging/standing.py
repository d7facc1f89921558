"""Decides which placements are judged, and how the others count: the same rule for every method and judge.

A sample that should be infeasible is left out: there is nothing to place well. Of the others a placement is judged if
it has a final state, by whichever method; a method that finds no place, or fails, gets the lowest score on both axes
without a question, so that refusing hard samples does not pay. If no intended outcome is stated, a method that finds no
place may be right: the sample is left out for it. Comparisons need a final state of both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum

from dcap.evaluation.judging.judge import JudgedScore
from dcap.evaluation.judging.rubric import WORST
from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome


class Standing(StrEnum):
    """How a judge treats a method's sample."""

    JUDGED = "judged"
    """There is a final state: it is scored and compared."""
    LOWEST = "lowest"
    """No placement although one was intended: 1 on both axes, and no comparison."""
    LEFT_OUT = "left_out"
    """Neither scored nor compared."""


def standing_of(row: SampleOutcome) -> Standing:
    """The standing of one row."""
    if row.feasible_intended is False:
        return Standing.LEFT_OUT
    if row.verdict in (AT_REST, AS_POSED) and not row.error:
        return Standing.JUDGED
    return Standing.LOWEST if row.feasible_intended else Standing.LEFT_OUT


def lowest_scores(rows: Sequence[SampleOutcome], judge: str) -> list[JudgedScore]:
    """Scores of samples with the lowest standing, without a question."""
    return [
        JudgedScore(row.sample, row.method, WORST, WORST, judge, f"no placement: {row.reason or row.error}")
        for row in rows
        if standing_of(row) is Standing.LOWEST
    ]


def without_placement(rows: Sequence[SampleOutcome]) -> dict[str, int]:
    """Samples of each method, in the order of the rows, on which it made no placement though one was intended."""
    found = dict.fromkeys((row.method for row in rows), 0)
    for row in rows:
        found[row.method] += standing_of(row) is Standing.LOWEST
    return found


def with_judged_scores(rows: Sequence[SampleOutcome], scores: Sequence[JudgedScore]) -> tuple[SampleOutcome, ...]:
    """The rows with a judge's scores; scores of earlier judges are removed."""
    known: Mapping[tuple[str, str], JudgedScore] = {(one.method, one.sample): one for one in scores}
    found = []
    for row in rows:
        one = known.get((row.method, row.sample))
        place, physics, judge = (one.right_place, one.physics_naturalness, one.judge) if one else (None, None, "")
        found.append(replace(row, right_place=place, physics_naturalness=physics, judge=judge))
    return tuple(found)
