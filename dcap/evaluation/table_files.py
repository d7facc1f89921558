"""Writes files of a run atomically, every table as CSV and LaTeX, and the layout of preferences.

In: text. Out: `NAME.csv` and `NAME.tex`. A file with the same bytes is not written again, so that rewriting a page
touches only changed files.

Preferences by method as CSV cells and LaTeX: one layout for people and for a run's judges.

In: rows of `preference_rows`. Out: cells and lines; the callers add notes on the whole table.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.evaluation.statistics.method_tables import PreferenceRow
from dcap.scene.written_files import write_whole

TABLES = "tables"
"""Folder of a run's tables."""
ENDS = (".csv", ".tex")
HEADINGS = {
    JudgedAxis.OVERALL: "Overall (\\%)", JudgedAxis.RIGHT_PLACE: "Right Place (\\%)",
    JudgedAxis.PHYSICS_NATURALNESS: "Phys. \\& Nat. (\\%)",
}  # fmt: skip
"""Columns in the order of the paper's table."""
MARKED = "% $\\dagger$: better than the best baseline, a baseline also than DCAP (paired bootstrap, p < 0.01)."


def table_files(folder: Path, name: str) -> tuple[Path, Path]:
    """Paths of a table."""
    return folder / f"{name}{ENDS[0]}", folder / f"{name}{ENDS[1]}"


def table_links(name: str) -> tuple[str, ...]:
    """Links of a table for a run's page."""
    return tuple(f"{TABLES}/{name}{end}" for end in ENDS)


def write_table(folder: Path, name: str, csv_text: str, tex_text: str) -> tuple[Path, Path]:
    """Write a table into a folder, which is created if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = table_files(folder, name)
    for path, text in zip(paths, (csv_text, tex_text), strict=True):
        write_if_other(path, text.encode())
    return paths


def write_if_other(path: Path, data: bytes) -> None:
    """Write a file atomically, unless it already has these bytes."""
    if path.is_file() and path.read_bytes() == data:
        return
    write_whole(path, data)


def csv_of(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows with the same keys as CSV with a header."""
    text = io.StringIO()
    out = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    out.writeheader()
    out.writerows(rows)
    return text.getvalue()


def number(value: float | None, digits: int = 4) -> str:
    """A number; empty if missing."""
    return "" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def tex_escaped(text: str) -> str:
    """Text with TeX's special characters escaped, and signs replaced by their names."""
    signs = {"°": "$^\\circ$", "²": "$^2$", "–": "--", **{sign: f"\\{sign}" for sign in "_&%#${}"},
             "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}"}  # fmt: skip
    return "".join(signs.get(sign, sign) for sign in text)


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
        cells |= {f"{axis}_{name}": number(one) for name, one in zip(("wins", "low", "high"), rates, strict=True)}
        cells |= {f"{axis}_p": number(row.p.get(axis)), f"{axis}_significant": bool(row.marks.get(axis))}
    rated, ends = row.rating, ("", "_low", "_high")
    ratings = (f"{one:.1f}" for one in (rated.rating, rated.interval.low, rated.interval.high)) if rated else [""] * 3
    cells |= {f"bradley_terry{end}": one for end, one in zip(ends, ratings, strict=True)}
    cells |= {"bradley_terry_separable": bool(rated and rated.separable)}
    overall = row.rates.get(JudgedAxis.OVERALL)
    return cells | {"comparisons": overall.comparisons if overall else 0}


def tabular(rows: Sequence[PreferenceRow], name_of: Callable[[str], str]) -> list[str]:
    """The table in the paper's layout, line by line."""
    head = " & ".join(["Method", *HEADINGS.values(), "Bradley--Terry"])
    lines = ["\\begin{tabular}{lcccc}", "\\hline", f"{head} \\\\", "\\hline"]
    for row in rows:
        cells = [tex_rate(row, axis) for axis in HEADINGS]
        lines.append(f"{tex_escaped(name_of(row.method))} & {' & '.join(cells)} & {tex_rating(row)} \\\\")
    return [*lines, "\\hline", "\\end{tabular}"]


def tex_rate(row: PreferenceRow, axis: JudgedAxis) -> str:
    """A win rate in percent with its interval; a dash without one."""
    won = row.rates.get(axis)
    if won is None:
        return "--"
    mark = "^{\\dagger}" if row.marks.get(axis) else ""
    value, low, high = (f"{100 * one:.1f}" for one in (won.rate, won.interval.low, won.interval.high))
    return f"${value}{mark}$ {{\\small $[{low}, {high}]$}}"


def tex_rating(row: PreferenceRow) -> str:
    """A rating with its interval; a dash without one."""
    rated = row.rating
    if rated is None:
        return "--"
    return f"${rated.rating:.0f}$ {{\\small $[{rated.interval.low:.0f}, {rated.interval.high:.0f}]$}}"
