"""Statistics of each rater: progress, attention, and balance between the sides."""

import csv
import io
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from statistics import median

from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.study.design import Side
from dcap.evaluation.study.journal import StudyVote
from dcap.evaluation.study.study_folder import StudyDesign, write_lasting

RATERS = "raters.csv"


@dataclass(frozen=True, slots=True)
class RaterRow:
    """One rater's row of raters.csv."""

    rater: str
    answered: int
    """Comparisons, attention checks included [-]."""
    of: int
    checks: int
    """Attention checks among those answered [-]."""
    checks_failed: int
    """Checks in which the rater took the floating copy for the more natural one [-]."""
    flagged: bool
    """Whether any check was failed. The votes count nevertheless."""
    left_share: float | None
    """Share of the votes on true comparisons, to all questions, that went to the left side [-]; None without votes."""
    median_seconds: float | None
    """Median time per comparison [s]."""


def rater_rows(design: StudyDesign, votes: Sequence[StudyVote]) -> tuple[RaterRow, ...]:
    """A row for each rater of the design, those without votes included."""
    return tuple(rater_row(rater, len(items), votes) for rater, items in design.raters.items())


def rater_row(rater: str, items: int, votes: Sequence[StudyVote]) -> RaterRow:
    """The row of one rater."""
    given = [vote for vote in votes if vote.rater == rater]
    mine = [vote for vote in given if vote.axis is JudgedAxis.RIGHT_PLACE]
    checks = [v for v in given if v.axis is JudgedAxis.PHYSICS_NATURALNESS and v.lifted is not None]
    failed = sum(vote.winner is vote.lifted for vote in checks)
    true = [vote for vote in given if vote.lifted is None]
    return RaterRow(
        rater=rater,
        answered=len(mine),
        of=items,
        checks=len(checks),
        checks_failed=failed,
        flagged=failed > 0,
        left_share=round(sum(v.winner is Side.LEFT for v in true) / len(true), 4) if true else None,
        median_seconds=round(median(v.seconds for v in mine), 1) if mine else None,
    )


def write_raters(folder: Path, rows: Sequence[RaterRow]) -> Path:
    """Write raters.csv."""
    text = io.StringIO()
    table = csv.DictWriter(text, [one.name for one in fields(RaterRow)], lineterminator="\n")
    table.writeheader()
    table.writerows(asdict(row) for row in rows)
    write_lasting(folder / RATERS, text.getvalue().encode())
    return folder / RATERS
