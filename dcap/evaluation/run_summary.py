"""The counts of a benchmark run, for summary.json and the head of its report."""

from collections.abc import Sequence
from dataclasses import dataclass

from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.language.model.ledger import Spending


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Counts of samples, times, and the use of a model; summary.json has these keys in this order."""

    run: str
    """Folder of the run."""
    samples: int
    at_rest: int
    as_posed: int
    """Placements of methods that do not simulate."""
    infeasible: int
    failed: int
    """Samples with an error; neither at rest nor infeasible."""
    region_missed: int
    """Samples at rest outside of the requested region."""
    feasible_intended: int
    feasible_as_intended: int
    """Of these, the samples at rest as intended."""
    infeasible_intended: int
    infeasible_with_right_reason: int
    """Of these, the samples that are infeasible for the intended reason."""
    compute_s: float
    """Sum of the stages' times when they were computed [s]."""
    wall_s: float
    """Duration of the run [s]."""
    language: Spending | None = None
    """Number of questions and spending; None if no model was asked."""


def summary_of(
    rows: Sequence[SampleOutcome], *, run: str, wall_s: float, language: Spending | None = None
) -> RunSummary:
    """The counts of a run's samples; `wall_s` is the duration of the run [s]."""
    feasible = [row for row in rows if row.feasible_intended is True]
    infeasible = [row for row in rows if row.feasible_intended is False]
    return RunSummary(
        run=run,
        samples=len(rows),
        at_rest=sum(row.verdict == AT_REST for row in rows),
        as_posed=sum(row.verdict == AS_POSED for row in rows),
        infeasible=sum(row.verdict == "infeasible" for row in rows),
        failed=sum(row.error != "" for row in rows),
        region_missed=sum(row.verdict == AT_REST and row.region_missed for row in rows),
        feasible_intended=len(feasible),
        feasible_as_intended=sum(bool(row.as_expected) for row in feasible),
        infeasible_intended=len(infeasible),
        infeasible_with_right_reason=sum(bool(row.as_expected) for row in infeasible),
        compute_s=round(sum(row.seconds for row in rows), 1),
        wall_s=round(wall_s, 1),
        language=language,
    )
