"""Table 2: what people preferred, from their votes.

The adapter between the study and the statistics: votes go in as comparisons, whose judge is the rater, and what comes
back is laid out as the table. Attention checks are no comparisons of methods and count nowhere here. Raters who failed
one are told and stay in.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.methods import DCAP, baselines_among, shown_name
from dcap.evaluation.statistics.agreement import krippendorff_alpha, ratings_of
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, Winner, methods_of, on_axis
from dcap.evaluation.statistics.method_tables import PreferenceRow, preference_rows
from dcap.evaluation.study.journal import StudyVote
from dcap.evaluation.study.raters import RaterRow
from dcap.evaluation.study.study_folder import write_whole
from dcap.evaluation.table_text import csv_of, number, tex_escaped

TABLE = "table2"
HEADINGS = {
    JudgedAxis.OVERALL: "Overall (\\%)", JudgedAxis.RIGHT_PLACE: "Right Place (\\%)",
    JudgedAxis.PHYSICS_NATURALNESS: "Phys. \\& Nat. (\\%)",
}  # fmt: skip
"""Columns in the order of the paper's table."""


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
    table.sort(key=lambda row: (-overall_rate(row), row.method))
    return StudyTable(
        rows=tuple(table),
        agreement={axis: krippendorff_alpha(ratings_of(on_axis(rows, axis))) for axis in JudgedAxis},
        comparisons=len(on_axis(rows, JudgedAxis.OVERALL)),
        raters=len({row.judge for row in rows}),
        offline=offline,
    )


def comparison_of(vote: StudyVote) -> Comparison:
    """A vote as a comparison; who judges is the rater."""
    return Comparison(vote.sample, vote.axis, vote.left, vote.right, Winner(vote.winner.value), vote.rater)


def overall_rate(row: PreferenceRow) -> float:
    """Share of the overall comparisons that a method won, 0 without any."""
    won = row.rates.get(JudgedAxis.OVERALL)
    return won.rate if won else 0.0


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


def row_cells(row: PreferenceRow, name: str) -> dict[str, object]:
    """What stands in a method's row of the CSV; empty where it was not compared."""
    cells: dict[str, object] = {"method": row.method, "name": name}
    for axis in HEADINGS:
        won = row.rates.get(axis)
        rates = (won.rate, won.interval.low, won.interval.high) if won else (None, None, None)
        cells |= {f"{axis}_{name}": number(one) for name, one in zip(("wins", "low", "high"), rates, strict=True)}
        cells |= {f"{axis}_p": number(row.p.get(axis)), f"{axis}_significant": bool(row.marks.get(axis))}
    rated, ends = row.rating, ("", "_low", "_high")
    ratings = (f"{one:.1f}" for one in (rated.rating, rated.interval.low, rated.interval.high)) if rated else [""] * 3
    cells |= {f"bradley_terry{end}": one for end, one in zip(ends, ratings, strict=True)}
    cells |= {"bradley_terry_separable": bool(rated and rated.separable)}
    overall = row.rates.get(JudgedAxis.OVERALL)
    return cells | {"comparisons": overall.comparisons if overall else 0}


def tex_text(table: StudyTable, raters: Sequence[RaterRow]) -> str:
    """The table as the paper lays it out."""
    head = " & ".join(["Method", *HEADINGS.values(), "Bradley--Terry"])
    lines = [
        "% Human forced choice, side by side. Win rates with 95 % intervals of a bootstrap over scene-prompt pairs."
    ]
    lines += ["\\begin{tabular}{lcccc}", "\\hline", f"{head} \\\\", "\\hline"]
    for row in table.rows:
        cells = [tex_rate(row, axis) for axis in HEADINGS]
        lines.append(f"{tex_escaped(table.name(row))} & {' & '.join(cells)} & {tex_rating(row)} \\\\")
    lines += ["\\hline", "\\end{tabular}"]
    agreed = ", ".join(f"{axis.replace('_', ' ')} {number(value) or 'n/a'}" for axis, value in table.agreement.items())
    checks, failed = sum(one.checks for one in raters), sum(one.checks_failed for one in raters)
    flagged = sum(one.flagged for one in raters)
    lines += [
        f"% {table.raters} raters, {table.comparisons} comparisons. Krippendorff's alpha: {agreed}.",
        f"% Attention checks failed: {failed} of {checks}, by {flagged} raters, whose votes are included.",
        "% $\\dagger$: better than the best baseline, a baseline also than DCAP (paired bootstrap, p < 0.01).",
    ]
    return "\n".join(lines) + "\n"


def tex_rate(row: PreferenceRow, axis: JudgedAxis) -> str:
    """A win rate in percent with its interval; a dash where there is none."""
    won = row.rates.get(axis)
    if won is None:
        return "--"
    mark = "^{\\dagger}" if row.marks.get(axis) else ""
    value, low, high = (f"{100 * one:.1f}" for one in (won.rate, won.interval.low, won.interval.high))
    return f"${value}{mark}$ {{\\small $[{low}, {high}]$}}"


def tex_rating(row: PreferenceRow) -> str:
    """A rating with its interval; a dash where there is none."""
    rated = row.rating
    if rated is None:
        return "--"
    return f"${rated.rating:.0f}$ {{\\small $[{rated.interval.low:.0f}, {rated.interval.high:.0f}]$}}"
