"""Failures of a run with their causes, and samples on which another method than DCAP is better.

In: rows. Out: failures with their causes, worst kind first; for each axis the samples on which a baseline is ahead.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod

from dcap.evaluation.judging.row_metrics import row_metrics
from dcap.evaluation.judging.rubric import worst_metric
from dcap.evaluation.methods import BASELINES, DCAP
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_page.placement_files import shortened
from dcap.evaluation.run_page.tables import NOTHING, RESTING
from dcap.evaluation.statistics.comparisons import JudgedAxis

LOW_SCORE = 5.0
"""Score below which it is low: the middle of the scale, where a metric is between visible and clearly wrong [-]."""
SURE = 1e-9
"""Difference below which scores are equal."""
AXES = {JudgedAxis.RIGHT_PLACE: "Right Place", JudgedAxis.PHYSICS_NATURALNESS: "P&N"}
FAILED, INFEASIBLE, UNEXPECTED, LOW = "failed", "infeasible", "not as intended", "low score"
KINDS = (FAILED, INFEASIBLE, UNEXPECTED, LOW)


@dataclass(frozen=True, slots=True)
class ShownFailure:
    """A placement that failed in some way."""

    row: SampleOutcome
    kinds: tuple[str, ...]
    """Of KINDS."""
    causes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BaselineAhead:
    """A sample on which a baseline is better on some axis."""

    row: SampleOutcome
    """The baseline's."""
    ours: SampleOutcome
    axes: tuple[str, ...]
    margin: float
    """Difference of the composites; a placement without one counts as 0 [-]."""


def failures_of(rows: Sequence[SampleOutcome]) -> list[ShownFailure]:
    """All failures: errors first, then refusals, then wrong places or orientations, then low scores."""
    found = [one for one in map(failure_of, rows) if one is not None]
    return sorted(found, key=lambda one: (KINDS.index(one.kinds[0]), lowest(one.row)))


def failure_of(row: SampleOutcome) -> ShownFailure | None:
    """A placement's failures; None without any."""
    if row.error:
        return ShownFailure(row, (FAILED,), (shortened(row.error),))
    found: list[tuple[str, str]] = []
    if row.verdict not in RESTING and row.feasible_intended is not False:
        found.append((INFEASIBLE, shortened(": ".join(word for word in (row.reason, row.message) if word))))
    if row.as_expected is False:
        found.append((UNEXPECTED, f"intended: {row.expected}; came out: {outcome_words(row)}"))
    for axis, words in AXES.items():
        score = getattr(row, axis.value)
        if score is not None and score < LOW_SCORE:
            found.append((LOW, f"{words} {score:.1f}{worst_metric_words(row, axis)}"))
    kinds = tuple(dict.fromkeys(kind for kind, _ in found))
    return ShownFailure(row, kinds, tuple(words for _, words in found)) if found else None


def outcome_words(row: SampleOutcome) -> str:
    """An outcome in the same words as intended outcomes."""
    if row.verdict not in RESTING:
        return f"infeasible: {row.reason}"
    where = " ".join(word for word in (row.base, row.part, row.region) if word)
    missed = ", region missed" if row.region_missed else ""
    turned = "" if row.orientation_error_deg is None else f", turned by {row.orientation_error_deg:.0f}°"
    return f"{row.verdict.replace('_', ' ')} on {where}{missed}{turned}"


def worst_metric_words(row: SampleOutcome, axis: JudgedAxis) -> str:
    """The worst metric of an axis, if known."""
    worst = worst_metric(row_metrics(row), axis)
    return f", worst metric {worst}" if worst else ""


def lowest(row: SampleOutcome) -> float:
    """The lower of the two scores."""
    return min((one for one in (row.right_place, row.physics_naturalness) if one is not None), default=0.0)


def composite(row: SampleOutcome) -> float:
    """Geometric mean of the known scores; 0 without any."""
    known = [one for one in (row.right_place, row.physics_naturalness) if one is not None]
    return prod(known) ** (1.0 / len(known)) if known else 0.0


def baselines_ahead(rows: Sequence[SampleOutcome]) -> list[BaselineAhead]:
    """Samples on which a baseline has a higher score than DCAP on some axis, the clearest first."""
    ours = {row.sample: row for row in rows if row.method == DCAP}
    found = []
    for row in rows:
        if row.method not in BASELINES or row.sample not in ours:
            continue
        own = ours[row.sample]
        axes = tuple(words for axis, words in AXES.items() if ahead(row, own, axis))
        if axes:
            found.append(BaselineAhead(row, own, axes, composite(row) - composite(own)))
    return sorted(found, key=lambda one: -one.margin)


def ahead(row: SampleOutcome, other: SampleOutcome, axis: JudgedAxis) -> bool:
    """Whether a score is higher than another one, or the only one."""
    mine, theirs = getattr(row, axis.value), getattr(other, axis.value)
    return mine is not None and (theirs is None or mine > theirs + SURE)


def score_cells(row: SampleOutcome) -> Mapping[str, str]:
    """Scores and their deciding metrics in raw units, as text."""
    numbers: dict[str, tuple[float | None, str]] = {
        "RP": (row.right_place, "{:.1f}"), "P&N": (row.physics_naturalness, "{:.1f}"),
        "penetration": (scaled(row.penetration_m), "{:.2g} mm"), "gap": (scaled(row.gap_m), "{:.2g} mm"),
        "drift by the referee": (scaled(row.referee_drift_m), "{:.2g} mm"),
    }  # fmt: skip
    return {name: NOTHING if value is None else form.format(value) for name, (value, form) in numbers.items()}


def scaled(metres: float | None) -> float | None:
    """A length in millimetres."""
    return None if metres is None else 1e3 * metres
