"""Writes every table of a run as CSV and LaTeX.

In: cells. Out: `NAME.csv` and `NAME.tex`. A file with the same bytes is not written again, so that rewriting a page
touches only changed files.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from dcap.scene.written_files import write_whole

TABLES = "tables"
"""Folder of a run's tables."""
ENDS = (".csv", ".tex")


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


def remove_table(folder: Path, name: str) -> None:
    """Remove a table that no longer holds."""
    for path in table_files(folder, name):
        path.unlink(missing_ok=True)


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


def tex_of(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    columns: str,
    before: Sequence[str] = (),
    after: Sequence[str] = (),
) -> str:
    """A table of cells that are LaTeX already; notes become comments `before` and `after` it."""
    lines = [f"% {note}" for note in before]
    lines += [f"\\begin{{tabular}}{{{columns}}}", "\\hline", f"{' & '.join(head)} \\\\", "\\hline"]
    lines += [f"{' & '.join(row)} \\\\" for row in rows]
    lines += ["\\hline", "\\end{tabular}", *(f"% {note}" for note in after)]
    return "\n".join(lines) + "\n"


def number(value: float | None, digits: int = 4) -> str:
    """A number; empty if missing."""
    return "" if value is None or not np.isfinite(value) else f"{value:.{digits}f}"


def tex_escaped(text: str) -> str:
    """Text with TeX's special characters escaped, and signs replaced by their names."""
    signs = {"°": "$^\\circ$", "²": "$^2$", "–": "--", **{sign: f"\\{sign}" for sign in "_&%#${}"},
             "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}"}  # fmt: skip
    return "".join(signs.get(sign, sign) for sign in text)
