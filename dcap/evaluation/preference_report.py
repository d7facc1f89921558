"""Preferences by method as CSV and LaTeX, in one layout for people (Table 2) and for a run's judge.

In: rows of `preference_rows`. Out: cells and LaTeX; and, for the comparisons of a judge, the files
`tables/comparisons_by_method.csv` and `.tex`. The same judgement gives the same bytes.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from dcap.evaluation.judging.judge import JudgeRecord
from dcap.evaluation.methods import DCAP, METHODS, baselines_among, shown_name
from dcap.evaluation.statistics.bootstrap import RESAMPLES
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, methods_of, on_axis
from dcap.evaluation.statistics.method_tables import PreferenceRow, preference_rows
from dcap.evaluation.table_files import TABLES, csv_of, number, remove_table, tex_escaped, tex_of, write_table

COMPARISONS = "comparisons_by_method"
HEADINGS = {
    JudgedAxis.OVERALL: "Overall (\\%)", JudgedAxis.RIGHT_PLACE: "Right Place (\\%)",
    JudgedAxis.PHYSICS_NATURALNESS: "Phys. \\& Nat. (\\%)",
}  # fmt: skip
"""Columns in the order of the paper's table."""
MARKED = (
    "$\\dagger$: better than the best baseline; for a baseline, also better than DCAP (paired bootstrap, p < 0.01)."
)


def best_first(rows: Sequence[PreferenceRow]) -> tuple[PreferenceRow, ...]:
    """Rows sorted by the share of won overall comparisons, then by name; methods without comparisons come last."""
    return tuple(sorted(rows, key=lambda row: (not row.rates, -overall_rate(row), row.method)))


def overall_rate(row: PreferenceRow) -> float:
    """Share of the overall comparisons that a method won, 0 without any."""
    won = row.rates.get(JudgedAxis.OVERALL)
    return won.rate if won else 0.0


def row_cells(row: PreferenceRow, name: str) -> dict[str, object]:
    """Cells of a method's row of the CSV; empty if it was not compared."""
    cells: dict[str, object] = {"method": row.method, "name": name}
    for axis in HEADINGS:
        won = row.rates.get(axis)
        rates = (won.rate, won.interval.low, won.interval.high) if won else (None, None, None)
        cells |= {f"{axis}_{end}": number(one) for end, one in zip(("wins", "low", "high"), rates, strict=True)}
        cells |= {f"{axis}_p": number(row.p(axis)), f"{axis}_significant": bool(row.mark(axis))}
    rated = row.rating
    ratings = (rated.rating, rated.interval.low, rated.interval.high) if rated else (None, None, None)
    cells |= {f"bradley_terry{end}": number(x, 1) for end, x in zip(("", "_low", "_high"), ratings, strict=True)}
    cells |= {"bradley_terry_separable": bool(rated and rated.separable)}
    overall = row.rates.get(JudgedAxis.OVERALL)
    return cells | {"comparisons": overall.comparisons if overall else 0}


def preferences_tex(
    rows: Sequence[PreferenceRow], name_of: Callable[[str], str], before: Sequence[str], after: Sequence[str] = ()
) -> str:
    """The table in the paper's layout, with notes as comments."""
    head = ["Method", *HEADINGS.values(), "Bradley--Terry"]
    cells = [
        [tex_escaped(name_of(row.method)), *(tex_rate(row, axis) for axis in HEADINGS), tex_rating(row)] for row in rows
    ]
    return tex_of(head, cells, "lcccc", before, [*after, MARKED])


def tex_rate(row: PreferenceRow, axis: JudgedAxis) -> str:
    """A win rate in percent with its interval; a dash without one."""
    won = row.rates.get(axis)
    if won is None:
        return "--"
    mark = "^{\\dagger}" if row.mark(axis) else ""
    value, low, high = (f"{100 * one:.1f}" for one in (won.rate, won.interval.low, won.interval.high))
    return f"${value}{mark}$ {{\\small $[{low}, {high}]$}}"


def tex_rating(row: PreferenceRow) -> str:
    """A rating with its interval; a dash without one."""
    one = row.rating
    return f"${one.rating:.0f}$ {{\\small $[{one.interval.low:.0f}, {one.interval.high:.0f}]$}}" if one else "--"


def write_comparison_table(
    run: Path, comparisons: Sequence[Comparison], record: JudgeRecord, *, offline: bool, resamples: int = RESAMPLES
) -> None:
    """Write the table of a judge's comparisons into a run; remove an earlier one if nothing is compared any more.

    Args:
        run: its folder.
        comparisons: of all axes.
        record: the judge.
        offline: whether the baselines ran without a model; their names show it.
        resamples: of every bootstrap.
    """
    methods = sorted(methods_of(comparisons), key=list(METHODS).index)
    rows = best_first(preference_rows(methods, comparisons, baselines_among(methods), ours=DCAP, resamples=resamples))
    if not rows:
        remove_table(run / TABLES, COMPARISONS)
        return
    asked = len(on_axis(comparisons, JudgedAxis.OVERALL))
    notes = [
        f"Comparisons by {record.judge}: {asked} overall, each pair in both orders; a tie is half a win of each.",
        "Win rates with 95 % intervals of a bootstrap over samples; Bradley-Terry of the overall comparisons.",
    ]
    if any(row.rating and row.rating.separable for row in rows):
        notes.append("Some method won or lost every comparison: a ridge keeps ratings finite, read them as an order.")
    if record.same_family:
        notes.append(f"The judge is of the same maker as {record.chooser}, which chose.")
    judged = {"judge": record.judge, "same_family": record.same_family}
    names = {row.method: shown_name(row.method, offline=offline) for row in rows}
    cells = csv_of([row_cells(row, names[row.method]) | judged for row in rows])
    write_table(run / TABLES, COMPARISONS, cells, preferences_tex(rows, names.__getitem__, notes))
