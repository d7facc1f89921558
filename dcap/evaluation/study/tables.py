"""Table 2: what people preferred, from their votes.

The adapter between the study and the statistics: votes go in as comparisons, whose judge is the rater, and what comes
back is laid out as the table. Attention checks are no comparisons of methods and count nowhere here. Raters who failed
one are told and stay in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.methods import DCAP, baselines_among, shown_name
from dcap.evaluation.preference_table import MARKED, best_first, row_cells, tabular
from dcap.evaluation.statistics.agreement import krippendorff_alpha, ratings_of
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, Winner, methods_of, on_axis
from dcap.evaluation.statistics.method_tables import PreferenceRow, preference_rows
from dcap.evaluation.study.journal import StudyVote
from dcap.evaluation.study.raters import RaterRow
from dcap.evaluation.study.study_folder import write_whole
from dcap.evaluation.table_text import csv_of, number

TABLE = "table2"


@dataclass(frozen=True, slots=True)
class StudyTable:
    """Table 2 and what belongs to it."""

    rows: tuple[PreferenceRow, ...]
    """The best overall first."""
    agreement: Mapping[JudgedAxis, float | None]
    """Krippendorff's alpha between raters [-]; None where no two raters answered the same comparison."""
    comparisons: int
    raters: int
    offline: bool
    """Whether no model answered for the baselines: their names say so."""

    def name(self, row: PreferenceRow) -> str:
        """A row's method as the table shows it."""
        return shown_name(row.method, offline=self.offline)


def study_table(votes: Sequence[StudyVote], seed: int, *, offline: bool = False) -> StudyTable:
    """Table 2 of the votes on true comparisons."""
    rows = [comparison_of(vote) for vote in votes if vote.lifted is None]
    methods = methods_of(rows)
    table = preference_rows(methods, rows, baselines_among(methods), ours=DCAP, seed=seed)
    return StudyTable(
        rows=best_first(table),
        agreement={axis: krippendorff_alpha(ratings_of(on_axis(rows, axis))) for axis in JudgedAxis},
        comparisons=len(on_axis(rows, JudgedAxis.OVERALL)),
        raters=len({row.judge for row in rows}),
        offline=offline,
    )


def comparison_of(vote: StudyVote) -> Comparison:
    """A vote as a comparison; who judges is the rater."""
    return Comparison(
        vote.sample, JudgedAxis(vote.axis.value), vote.left, vote.right, Winner(vote.winner.value), vote.rater
    )


def write_study_table(folder: Path, table: StudyTable, raters: Sequence[RaterRow]) -> tuple[Path, Path]:
    """Write table2.csv and table2.tex into a folder."""
    folder.mkdir(exist_ok=True)
    paths = folder / f"{TABLE}.csv", folder / f"{TABLE}.tex"
    write_whole(paths[0], csv_text(table, raters).encode())
    write_whole(paths[1], tex_text(table, raters).encode())
    return paths


def csv_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """A row per method; what is of the whole study stands in each row."""
    study: dict[str, object] = {"raters": table.raters, "study_comparisons": table.comparisons}
    study |= {f"agreement_{axis}": number(value) for axis, value in table.agreement.items()}
    study |= {"attention_checks": sum(one.checks for one in raters)}
    study |= {"attention_failures": sum(one.checks_failed for one in raters)}
    study |= {"raters_flagged": sum(one.flagged for one in raters)}
    return csv_of([row_cells(row, table.name(row)) | study for row in table.rows])


def tex_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """The table as the paper lays it out."""
    lines = [
        "% Human forced choice, side by side. Win rates with 95 % intervals of a bootstrap over scene-prompt pairs."
    ]
    lines += tabular(table.rows, table.name)
    agreed = ", ".join(f"{axis.replace('_', ' ')} {number(value) or 'n/a'}" for axis, value in table.agreement.items())
    checks, failed = sum(one.checks for one in raters), sum(one.checks_failed for one in raters)
    flagged = sum(one.flagged for one in raters)
    lines += [
        f"% {table.raters} raters, {table.comparisons} comparisons. Krippendorff's alpha: {agreed}.",
        f"% Attention checks failed: {failed} of {checks}, by {flagged} raters, whose votes are included.",
        MARKED,
    ]
    return "\n".join(lines) + "\n"
