"""Cells of tables as text, the same for CSV and LaTeX of every table."""

import csv
import io
from collections.abc import Mapping, Sequence

import numpy as np


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
