"""Tables of the page of a run: metrics by method, and the run's CSV tables in words.

In: rows of a run, and `tables/NAME.csv` with columns for a value, its spread, its interval and its significance. Out:
headings and cells as text: one cell for each such group, rounded for reading, and one sentence for columns that are
equal in every row; `tables/metrics.csv` (SI) and `tables/metrics.tex` (readable units).
"""

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.evaluation.table_files import ENDS, TABLES, csv_of, table_links, tex_escaped, tex_of, write_table

METRICS = "metrics"
NOTHING = "–"
RESTING = (AT_REST, AS_POSED)
"""Verdicts of placements that can be measured."""
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


@dataclass(frozen=True, slots=True)
class ShownTable:
    """A table of the page."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    files: tuple[str, ...]
    """Its files in CSV and LaTeX, relative to the run."""
    note: str = ""


@dataclass(frozen=True, slots=True)
class ShownMetric:
    """A column of results.parquet in a form for people."""

    column: str
    words: str
    unit: str
    factor: float
    """Factor from SI to `unit`."""
    share: bool = False
    """Whether it is yes or no: its mean is a share, and a median says nothing."""


SHOWN_METRICS = (
    ShownMetric("support_hit", "support hit", "%", 100.0, share=True),
    ShownMetric("part_hit", "part hit", "%", 100.0, share=True),
    ShownMetric("region_distance_m", "off the region", "cm", 100.0),
    ShownMetric("orientation_error_deg", "orientation error", "°", 1.0),
    ShownMetric("penetration_m", "penetration", "mm", 1e3),
    ShownMetric("penetration_given_m", "penetration, support as given", "mm", 1e3),
    ShownMetric("gap_m", "gap", "mm", 1e3),
    ShownMetric("contact_area_m2", "contact area", "cm²", 1e4),
    ShownMetric("com_supported", "centre of mass supported", "%", 100.0, share=True),
    ShownMetric("indentation_m", "indentation", "mm", 1e3),
    ShownMetric("indentation_error_m", "indentation error (ours)", "mm", 1e3),
    ShownMetric("force_residual", "force residual (ours)", "", 1.0),
    ShownMetric("drift_m", "drift (ours)", "mm", 1e3),
    ShownMetric("drift_deg", "turn while drifting (ours)", "°", 1.0),
    ShownMetric("drift_s", "simulated on (ours)", "s", 1.0),
    ShownMetric("referee_drift_m", "drift by the referee", "mm", 1e3),
    ShownMetric("referee_drift_deg", "turn by the referee", "°", 1.0),
    ShownMetric("referee_supported", "still supported by the referee", "%", 100.0, share=True),
    ShownMetric("referee_penetration_m", "penetration by the referee", "mm", 1e3),
    ShownMetric("visible_fraction", "visible", "%", 100.0),
    ShownMetric("right_place", "Right Place", "1–10", 1.0),
    ShownMetric("physics_naturalness", "P&N", "1–10", 1.0),
)


def values_of(rows: Sequence[SampleOutcome], metric: ShownMetric) -> list[float]:
    """Known values of a metric [SI]."""
    found = [getattr(row, metric.column) for row in resting(rows)]
    return [float(one) for one in found if one is not None]


def metrics_table(
    run: Path, rows: Mapping[str, Sequence[SampleOutcome]], names: Mapping[str, str]
) -> ShownTable | None:
    """Write the metrics of each method into the run and return them as a table; None if nothing was measured.

    Args:
        run: its folder.
        rows: of each method.
        names: shown names of the methods.
    """
    found = {method: {one.column: values_of(own, one) for one in SHOWN_METRICS} for method, own in rows.items()}
    there = [one for one in SHOWN_METRICS if any(values[one.column] for values in found.values())]
    if all(one.column == "visible_fraction" for one in there):
        return None
    counts = {method: len(resting(own)) for method, own in rows.items()}
    placed_rows = ("placed", *(f"{counts[method]} of {len(own)}" for method, own in rows.items()))
    cells = tuple(
        (f"{one.words} [{one.unit}]" if one.unit else one.words,
         *(cell(one, found[method][one.column], counts[method]) for method in rows))
        for one in there
    )  # fmt: skip
    shown = [names[method] for method in rows]
    note = "Median (mean) over the placements; for yes or no the share of yes; n if a metric is known for fewer."
    tex = [[tex_escaped(text) for text in row] for row in (("Metric", *shown), *cells)]
    write_table(run / TABLES, METRICS, metrics_csv(there, found, names),
                tex_of(tex[0], tex[1:], f"l{'c' * len(found)}", [note]))  # fmt: skip
    return ShownTable(
        "Metrics", ("", *shown), (placed_rows, *cells), table_links(METRICS),
        f"{note} Metrics marked (ours) come from DCAP's own solver or contact model and are in no score. "
        f"{without_referee(rows)}Definitions: docs/metrics.md.",
    )  # fmt: skip


def without_referee(rows: Mapping[str, Sequence[SampleOutcome]]) -> str:
    """A sentence for the case that the simulation was continued but the independent referee judged nothing."""
    own = [row for rows_of in rows.values() for row in resting(rows_of)]
    if all(row.drift_s is None for row in own) or any(row.referee_s is not None for row in own):
        return ""
    return "The independent referee judged none of them (it needs MuJoCo: pip install dcap[referee]). "


def resting(rows: Sequence[SampleOutcome]) -> list[SampleOutcome]:
    """The rows that are placements."""
    return [row for row in rows if row.verdict in RESTING and not row.error]


def cell(metric: ShownMetric, values: Sequence[float], of: int) -> str:
    """Median and mean, or a share; with the count if it is less than `of`."""
    if not values:
        return NOTHING
    middle = mean(values) if metric.share else median(values)
    rest = "" if metric.share else f" ({format_number(metric.factor * mean(values))})"
    return f"{format_number(metric.factor * middle)}{rest}" + (f", n {len(values)}" if len(values) < of else "")


def format_number(value: float) -> str:
    """A number for people; less than a millionth of its unit is rounding and shown as 0."""
    return f"{round(value, 6) + 0.0:.3g}"


def metrics_csv(
    metrics: Sequence[ShownMetric], found: Mapping[str, Mapping[str, list[float]]], names: Mapping[str, str]
) -> str:
    """A row per method and metric, in SI."""
    statistics: Mapping[str, Callable[[list[float]], float]] = {
        "median": median, "mean": mean, "least": min, "largest": max,
    }  # fmt: skip
    return csv_of([
        {"method": method, "name": names[method], "metric": one.column, "n": len(own[one.column]),
         **{name: f"{f(own[one.column]):.6g}" if own[one.column] else "" for name, f in statistics.items()}}
        for method, own in found.items() for one in metrics
    ])  # fmt: skip


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
    exact = joined(rows[0], rows[1:], str)[1]
    same = [at for at in range(1, len(exact[0])) if len(exact) > 1 and len({row[at] for row in exact}) == 1]
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
