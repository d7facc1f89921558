"""Results of a run's comparisons by its judge: win rates by axis and Bradley-Terry ratings, as CSV and LaTeX.

In: comparisons of a run, its judge, and the names of its methods. Out: `tables/comparisons_by_method.csv` and `.tex`,
in the layout of the table of people's preferences. The same judgement gives the same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.judging.judge import JudgeRecord
from dcap.evaluation.methods import DCAP, METHODS, baselines_among, shown_name
from dcap.evaluation.statistics.bootstrap import RESAMPLES
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, methods_of, on_axis
from dcap.evaluation.statistics.method_tables import PreferenceRow, preference_rows
from dcap.evaluation.table_files import MARKED, TABLES, best_first, csv_of, row_cells, table_files, tabular, write_table

TABLE = "comparisons_by_method"


@dataclass(frozen=True, slots=True)
class ComparisonTable:
    """The table with its judge."""

    rows: tuple[PreferenceRow, ...]
    """The best overall first."""
    record: JudgeRecord
    comparisons: int
    """Number of overall comparisons, each pair in both orders."""
    offline: bool
    """Whether the baselines ran without a model; their names show it."""

    def name(self, method: str) -> str:
        """A method's name in the table."""
        return shown_name(method, offline=self.offline)


def comparison_table(
    comparisons: Sequence[Comparison], record: JudgeRecord, *, offline: bool, resamples: int = RESAMPLES
) -> ComparisonTable:
    """The table of a judge's comparisons."""
    methods = sorted(methods_of(comparisons), key=list(METHODS).index)
    rows = preference_rows(methods, comparisons, baselines_among(methods), ours=DCAP, resamples=resamples)
    return ComparisonTable(best_first(rows), record, len(on_axis(comparisons, JudgedAxis.OVERALL)), offline)


def write_comparison_table(run: Path, table: ComparisonTable) -> tuple[Path, ...]:
    """Write the table into a run; remove that of an earlier judgement if nothing is compared any more."""
    if not table.rows:
        for path in table_files(run / TABLES, TABLE):
            path.unlink(missing_ok=True)
        return ()
    judged = {"judge": table.record.judge, "same_family": table.record.same_family}
    cells = csv_of([row_cells(row, table.name(row.method)) | judged for row in table.rows])
    return write_table(run / TABLES, TABLE, cells, tex_text(table))


def tex_text(table: ComparisonTable) -> str:
    """The table in the paper's layout of people's preferences, with notes as comments."""
    asked = f"{table.comparisons} overall, each pair in both orders; a tie is half a win of each"
    lines = [
        f"% Comparisons by {table.record.judge}: {asked}.",
        "% Win rates with 95 % intervals of a bootstrap over samples; Bradley-Terry of the overall comparisons.",
    ]
    if any(row.rating and row.rating.separable for row in table.rows):
        lines.append("% Some method won or lost every comparison: a ridge keeps ratings finite, read them as an order.")
    if table.record.same_family:
        lines.append(f"% The judge is of the same maker as {table.record.chooser}, which chose.")
    return "\n".join([*lines, *tabular(table.rows, table.name), MARKED]) + "\n"
