"""A table of the page, and that of metrics by method, which is also written as CSV and LaTeX.

In: rows of a run. Out: headings and cells as text; `tables/metrics.csv`, `tables/metrics.tex` (SI in the CSV, readable
units elsewhere).
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.evaluation.table_files import TABLES, table_links, tex_escaped, write_table

METRICS = "metrics"
NOTHING = "–"
RESTING = (AT_REST, AS_POSED)
"""Verdicts of placements that can be measured."""


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
    write_table(run / TABLES, METRICS, metrics_csv(there, found, names), metrics_tex(there, found, names, counts))
    placed_rows = ("placed", *(placed(own) for own in rows.values()))
    cells = [
        (f"{one.words} [{one.unit}]" if one.unit else one.words,
         *(cell(one, found[method][one.column], counts[method]) for method in rows))
        for one in there
    ]  # fmt: skip
    return ShownTable(
        "Metrics", ("", *(names[method] for method in rows)), (placed_rows, *cells),
        table_links(METRICS),
        "Median (mean) over the placements; for yes or no the share of yes; n if a metric is known for fewer. "
        "Metrics marked (ours) come from DCAP's own solver or contact model and are in no score. "
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


def placed(rows: Sequence[SampleOutcome]) -> str:
    """Number of a method's samples with a placement."""
    return f"{len(resting(rows))} of {len(rows)}"


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
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["method", "name", "metric", "n", "median", "mean", "least", "largest"])
    for method, own in found.items():
        for one in metrics:
            values = own[one.column]
            numbers = [median(values), mean(values), min(values), max(values)] if values else []
            out.writerow([method, names[method], one.column, len(values), *(f"{x:.6g}" for x in numbers)]
                         + [""] * (4 - len(numbers)))  # fmt: skip
    return text.getvalue()


def metrics_tex(
    metrics: Sequence[ShownMetric],
    found: Mapping[str, Mapping[str, list[float]]],
    names: Mapping[str, str],
    counts: Mapping[str, int],
) -> str:
    """A row per metric, a column per method: median (mean), or a share; n if a metric is known for fewer than the
    placements of the method."""
    lines = ["% Median (mean) over placements; for yes or no the share of yes; n if it is known for fewer.",
             f"\\begin{{tabular}}{{l{'c' * len(found)}}}", "\\hline",
             f"{' & '.join(['Metric', *(tex_escaped(names[one]) for one in found)])} \\\\", "\\hline"]  # fmt: skip
    for one in metrics:
        cells = [tex_escaped(cell(one, own[one.column], counts[method])) for method, own in found.items()]
        label = tex_escaped(f"{one.words} [{one.unit}]" if one.unit else one.words)
        lines.append(f"{' & '.join([label, *cells])} \\\\")
    return "\n".join([*lines, "\\hline", "\\end{tabular}"]) + "\n"
