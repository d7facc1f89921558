"""Formats a run's CSV tables for people on its page.

In: `tables/NAME.csv`, with columns for a value, its spread, its interval and its significance. Out: one cell for each
group, rounded for reading; columns that are equal in every row become one sentence below.
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from dcap.evaluation.run_page.tables import NOTHING, ShownTable
from dcap.evaluation.table_files import ENDS, TABLES

DAGGER, SIGNIFICANT, SPREAD, LOW, HIGH, WINS = "†", "_significant", "_sd", "_low", "_high", "_wins"
MOST_ROWS, MOST_COLUMNS = 60, 24
"""Most rows of a table that are shown [-]; the file has all."""
LEAST_WHOLE = 100.0
"""Size from which a number that is not whole is shown without decimals, else with two [-]."""
LEAST_FIXED = 0.1
"""Size below which two significant digits are shown [-]."""
YES_OR_NO = {"True": "yes", "False": "no"}
SHOWN_WORDS = {
    "right_place": "Right Place",
    "physics_naturalness": "P&N",
    "bradley_terry": "Bradley–Terry",
    "elo": "Elo",
}
"""Spelling of prefixes of the columns' names for people."""


def table_from_csv(run: Path, name: str, title: str) -> ShownTable | None:
    """A table from a run's folder; None if it is missing or invalid."""
    path = run / TABLES / f"{name}.csv"
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
    except (OSError, ValueError, csv.Error):
        return None
    if len(rows) < 2 or any(len(row) != len(rows[0]) for row in rows):
        return None
    head, shown = joined(rows[0], rows[1:], readable_cell)
    same = same_columns(joined(rows[0], rows[1:], str)[1])
    head, shown, same_words = constant_columns(head, shown, same)
    cut = f"{len(shown)} rows, the first {MOST_ROWS} shown" if len(shown) > MOST_ROWS else ""
    files = tuple(f"{TABLES}/{name}{end}" for end in ENDS if (run / TABLES / f"{name}{end}").is_file())
    return ShownTable(title, tuple(head[:MOST_COLUMNS]), tuple(tuple(row[:MOST_COLUMNS]) for row in shown[:MOST_ROWS]),
                      files, ". ".join(one for one in (same_words, cut) if one))  # fmt: skip


def joined(
    head: Sequence[str], rows: Sequence[Sequence[str]], show: Callable[[str], str]
) -> tuple[list[str], list[list[str]]]:
    """Headings and cells where X, X_sd, X_low and X_high are one column, and a mark stands for X_significant.

    p-values stay in the file; of `method` and `name` the latter is shown.
    """
    known = set(head)
    inner = {f"{one.removesuffix(WINS)}{end}" for one in head for end in (SPREAD, LOW, HIGH)} & known
    marks = {one: one.removesuffix(SIGNIFICANT) for one in head if one.endswith(SIGNIFICANT)}
    hidden = inner | set(marks) | {one for one in head if one.endswith("_p") or one == "p"}
    hidden |= {"method"} if {"method", "name"} <= known else set()
    shown = [one for one in head if one not in hidden]
    cells = [[joined_cell(dict(zip(head, row, strict=True)), one, marks, show) for one in shown] for row in rows]
    return [heading(one) for one in shown], cells


def heading(column: str) -> str:
    """A column's name for people."""
    for name, words in SHOWN_WORDS.items():
        if f"{column}_".startswith(f"{name}_"):
            column = f"{words}{column.removeprefix(name)}"
    return column.replace("_", " ").strip()


def joined_cell(row: Mapping[str, str], column: str, marks: Mapping[str, str], show: Callable[[str], str]) -> str:
    """A cell with its mark, spread and interval."""
    about = column.removesuffix(WINS)
    spread, low, high = (show(row.get(f"{about}{end}", "")) for end in (SPREAD, LOW, HIGH))
    starred = any(row[mark].lower() in ("true", "1") for mark, of in marks.items() if of == about)
    return (f"{show(row[column]) or NOTHING}{DAGGER if starred else ''}{f' ± {spread}' if spread else ''}"
            f"{f' [{low}, {high}]' if low and high else ''}")  # fmt: skip


def readable_cell(text: str) -> str:
    """A cell of the file rounded for reading, with words instead of Python's truth values."""
    if text in YES_OR_NO or "." not in text:
        return YES_OR_NO.get(text, text)
    try:
        value = float(text)
    except ValueError:
        return text
    if 0.0 < abs(value) < LEAST_FIXED:
        return f"{value:.2g}"
    return f"{value:.0f}" if abs(value) >= LEAST_WHOLE else f"{value:.2f}"


def same_columns(rows: Sequence[Sequence[str]]) -> list[int]:
    """The columns after the first in which no two rows differ."""
    return [at for at in range(1, len(rows[0])) if len(rows) > 1 and len({row[at] for row in rows}) == 1]


def constant_columns(
    head: Sequence[str], rows: Sequence[Sequence[str]], same: Sequence[int]
) -> tuple[list[str], list[list[str]], str]:
    """The columns that differ between rows, and the others as a sentence."""
    kept = [at for at in range(len(head)) if at not in same]
    words = "; ".join(f"{head[at]} {rows[0][at]}" for at in same)
    return (
        [head[at] for at in kept],
        [[row[at] for at in kept] for row in rows],
        f"In every row: {words}" if words else "",
    )
