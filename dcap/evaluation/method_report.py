"""A judge's scores and ranking of a run's methods, as CSV and LaTeX: Table 1 for a model, else *Metrics*.

In: rows of a run with a judge's scores, the comparisons, and the judge. Out: a row per method. Samples are paired: a
sample is a scene with a prompt, and every test compares methods on the same ones. The same judgement gives the same
bytes. The offline rubric's table is never called Table 1.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.judging.judge import JudgeRecord, Standing, standing_of
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.methods import DCAP, METHODS, baselines_among, shown_name
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.statistics.agreement import side_report
from dcap.evaluation.statistics.bootstrap import LEVEL, RESAMPLES
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, on_axis
from dcap.evaluation.statistics.method_tables import ScoreRow, score_rows
from dcap.evaluation.statistics.ratings import ANCHOR_RATING
from dcap.evaluation.statistics.score_summary import ScoreSummary
from dcap.evaluation.table_files import TABLES, csv_of, number, table_files, tex_escaped, write_table

TABLE1, METRIC_SCORES = "table1", "metric_scores"
"""File names of the table by a model, and by the rubric."""
TITLES = {TABLE1: "Table 1: scores", METRIC_SCORES: "Metrics: scores by stated rules"}
"""Titles of the tables."""
REFEREE_HINT = "it needs MuJoCo, pip install dcap[referee], and two methods; measures.json says why it could not judge"
COMPOSITE, ELO = "composite", "elo"
AXES = (JudgedAxis.RIGHT_PLACE, JudgedAxis.PHYSICS_NATURALNESS)
HEAD = (
    "Method",
    "Right Place $\\uparrow$",
    "P \\& N $\\uparrow$",
    "Composite (GM) $\\uparrow$",
    "Elo $\\uparrow$",
    "n",
)


@dataclass(frozen=True, eq=False, slots=True)
class MethodTable:
    """The table with its notes."""

    methods: tuple[str, ...]
    """All of the run, in the order of the table."""
    rows: dict[str, ScoreRow]
    """Rows of methods that have any score."""
    lowest: dict[str, int]
    """Samples of each method that were scored 1 because it made no placement."""
    left_out: dict[str, int]
    """Samples of each method without a score on any axis."""
    anchor: str
    """Method whose Elo is fixed; empty if nothing was compared."""
    record: JudgeRecord
    tie_rate: float
    """Share of ties in all comparisons [-]."""
    left_share: float | None
    """Share of the left side among the decided ones [-]; None without any."""
    offline: bool
    """Whether the baselines ran without a model; their names show it."""
    referee: tuple[int, int]
    """Number of placements that the rubric scored with the drift of the independent referee, and of all that it scored;
    (0, 0) for another judge."""
    changed: tuple[str, ...] = ()
    """Placements that have changed since they were judged, by method and sample."""

    @property
    def file(self) -> str:
        """Name of its files: Table 1 if a model judged."""
        return METRIC_SCORES if self.record.judge == RUBRIC else TABLE1

    def name(self, method: str) -> str:
        """A method's name in the table."""
        return shown_name(method, offline=self.offline)


def method_table(
    rows: Sequence[SampleOutcome],
    comparisons: Sequence[Comparison],
    record: JudgeRecord,
    *,
    offline: bool,
    changed: tuple[str, ...] = (),
    resamples: int = RESAMPLES,
) -> MethodTable:
    """The table of rows with scores."""
    order = list(METHODS)
    methods = tuple(sorted({row.method for row in rows}, key=order.index))
    given = score_arrays(rows, methods)
    scores = {name: value for name, value in given.items() if not np.isnan(value).all()}
    compared = [name for name in methods if any(name in one.pair for one in on_axis(comparisons, JudgedAxis.OVERALL))]
    there = [one for one in compared if one in scores]
    baselines = baselines_among(list(scores))
    anchor = next((name for name in reversed(there) if name in baselines), "")
    found = score_rows(scores, comparisons, baselines, anchor, DCAP, resamples) if scores else []
    habits = side_report(comparisons)
    return MethodTable(
        methods=methods,
        rows={row.method: row for row in found},
        lowest={name: count(rows, name, Standing.LOWEST) for name in methods},
        left_out={name: int(np.isnan(given[name]).all(axis=1).sum()) for name in methods},
        anchor=anchor,
        record=record,
        tie_rate=habits.tie_rate,
        left_share=habits.left_share,
        offline=offline,
        referee=with_referee(rows, record),
        changed=changed,
    )


def score_arrays(rows: Sequence[SampleOutcome], methods: Sequence[str]) -> dict[str, NDArray[np.float64]]:
    """Both scores by method, shape (samples, 2) in one order of samples, nan where missing."""
    known = {(row.method, row.sample): (row.right_place, row.physics_naturalness) for row in rows}
    samples = sorted({row.sample for row in rows})
    none = (None, None)
    return {
        name: np.array([known.get((name, sample), none) for sample in samples], dtype=np.float64) for name in methods
    }


def count(rows: Sequence[SampleOutcome], method: str, standing: Standing) -> int:
    """Rows of a method with a standing."""
    return sum(row.method == method and standing_of(row) is standing for row in rows)


def with_referee(rows: Sequence[SampleOutcome], record: JudgeRecord) -> tuple[int, int]:
    """Number of placements that the rubric scored with the referee's drift, and of all; (0, 0) for another judge."""
    scored = [row for row in rows if record.judge == RUBRIC and standing_of(row) is Standing.JUDGED
              and row.physics_naturalness is not None]  # fmt: skip
    return sum(row.referee_drift_m is not None for row in scored), len(scored)


def write_method_table(run: Path, table: MethodTable) -> tuple[Path, Path]:
    """Write the table into a run, and remove that of an earlier judge of the other kind."""
    other = METRIC_SCORES if table.file == TABLE1 else TABLE1
    for path in table_files(run / TABLES, other):
        path.unlink(missing_ok=True)
    return write_table(run / TABLES, table.file, csv_text(table), tex_text(table))


def csv_text(table: MethodTable) -> str:
    """A row per method; values of the whole judgement are repeated in each row."""
    return csv_of([row_cells(table, method) for method in table.methods])


def row_cells(table: MethodTable, method: str) -> dict[str, object]:
    """Cells of a method's row of the CSV; empty without a score."""
    row, record = table.rows.get(method), table.record
    cells: dict[str, object] = {"method": method, "name": table.name(method)}
    for axis in AXES:
        one = summary(row, axis) if row else None
        values = (one.mean, one.spread, one.interval.low, one.interval.high) if one else (None,) * 4
        cells |= {f"{axis}{k}": number(v) for k, v in zip(("", "_sd", "_low", "_high"), values, strict=True)}
        cells |= {f"{axis}_n": one.samples if one else 0, **tested(row, axis)}
    cells |= {COMPOSITE: number(row.composite if row else None), **tested(row, COMPOSITE)}
    elo = row.elo if row else None
    ratings = (elo.rating, elo.interval.low, elo.interval.high) if elo else (None,) * 3
    cells |= {f"{ELO}{k}": number(v, 1) for k, v in zip(("", "_low", "_high"), ratings, strict=True)}
    cells |= {**tested(row, ELO), "elo_separable": bool(elo and elo.separable), "elo_anchor": table.anchor}
    cells |= {"samples": row.samples if row else 0, "without_placement": table.lowest[method]}
    cells |= {"left_out": table.left_out[method]}
    if table.file == METRIC_SCORES:
        cells |= {"with_referee": "{} of {}".format(*table.referee)}
    cells |= {"judge": record.judge, "same_family": record.same_family}
    return cells | {"tie_rate": number(table.tie_rate), "left_share": number(table.left_share)}


def summary(row: ScoreRow, axis: JudgedAxis) -> ScoreSummary | None:
    """A row's scores on an axis; None where it has none."""
    return row.right_place if axis is JudgedAxis.RIGHT_PLACE else row.physics_naturalness


def samples_of(row: ScoreRow | None) -> str:
    """Number of samples with a score, by axis if they differ."""
    counts = [one.samples if one else 0 for one in (summary(row, axis) for axis in AXES)] if row else [0]
    return "/".join(map(str, dict.fromkeys(counts)))


def tested(row: ScoreRow | None, name: str) -> dict[str, object]:
    """p and mark of a column."""
    return {f"{name}_p": number(row.p.get(name) if row else None), f"{name}_significant": bool(row and row.marks[name])}


def tex_text(table: MethodTable) -> str:
    """The table in the paper's layout, with notes as comments."""
    lines = [f"% {note}" for note in notes(table)]
    lines += ["\\begin{tabular}{lccccr}", "\\hline", f"{' & '.join(HEAD)} \\\\", "\\hline"]
    lines += [f"{' & '.join(tex_cells(table, method))} \\\\" for method in table.methods]
    return "\n".join([*lines, "\\hline", "\\end{tabular}"]) + "\n"


def tex_cells(table: MethodTable, method: str) -> list[str]:
    """A method's row; a dash for a missing score."""
    row, name = table.rows.get(method), tex_escaped(table.name(method))
    if row is None:
        return [name, *["--"] * 4, samples_of(row)]
    marks = {key: "^{\\dagger}" if mark else "" for key, mark in row.marks.items()}
    scored = [(summary(row, axis), marks[axis]) for axis in AXES]
    cells = [f"${one.mean:.2f} \\pm {one.spread:.2f}{mark}$" if one else "--" for one, mark in scored]
    cells.append("--" if row.composite is None else f"${row.composite:.2f}{marks[COMPOSITE]}$")
    elo = row.elo
    ends = f"{{\\small $[{elo.interval.low:.0f}, {elo.interval.high:.0f}]$}}" if elo else ""
    rated = f"${elo.rating:.0f}{marks[ELO]}$ {ends}" if elo else "--"
    return [name, *cells, rated, samples_of(row)]


def notes(table: MethodTable) -> list[str]:
    """Notes for the reader of the table, one sentence each."""
    record = table.record
    said = [f"{TITLES[table.file]}. Judged by: {record.judge}; {record.questions} questions."]
    judged, scored = table.referee
    if judged < scored:
        said.append(
            f"{scored - judged} of {scored} scores of P & N were made without the independent referee's drift "
            f"({REFEREE_HINT})."
        )
    if record.same_family:
        said.append(f"The judge is of the same maker as {record.chooser}, which chose: it may favour its own.")
    if table.changed:
        shown = ", ".join(table.changed[:3]) + (" ..." if len(table.changed) > 3 else "")
        said.append(f"{len(table.changed)} placements have changed since they were judged ({shown}): judge again.")
    left = "" if table.left_share is None else f", {100 * table.left_share:.0f} % of the others for the left side"
    said.append(f"Comparisons in both orders: {100 * table.tie_rate:.0f} % ties{left}.")
    said.append("Mean and standard deviation over samples; composite: geometric mean of the two means.")
    if any(samples_of(row) != str(row.samples) for row in table.rows.values()):
        said.append(
            "Some placements have a score on one axis only: n is by axis, and overall comparisons are those of "
            "placements that have the same axes."
        )
    if table.anchor:
        rated = f"Elo by maximum likelihood, {table.name(table.anchor)} fixed at {ANCHOR_RATING:.0f}"
        said.append(f"{rated}; {100 * LEVEL:.0f} % intervals of a bootstrap over samples.")
    if any(row.elo and row.elo.separable for row in table.rows.values()):
        said.append("Some method won or lost every comparison: a ridge keeps Elo finite, read it as an order.")
    without = ", ".join(f"{table.name(name)} {n}" for name, n in table.lowest.items() if n)
    if without:
        said.append(f"Scored 1 because the method made no placement where one was intended: {without}.")
    said.append("Dagger: better than the best baseline, a baseline also than DCAP (paired bootstrap, p < 0.01).")
    return said


def shown_lines(table: MethodTable) -> list[str]:
    """The table for a terminal."""
    lines = [line_of("", ["right place", "physics & nat.", "composite", "Elo"], "n")]
    for method in table.methods:
        row = table.rows.get(method)
        cells = ["-"] * 4
        if row:
            scored = [(summary(row, axis), row.marks[axis] or " ") for axis in AXES]
            cells = [f"{one.mean:.2f} ± {one.spread:.2f}{mark}" if one else "-" for one, mark in scored]
            cells.append("-" if row.composite is None else f"{row.composite:.2f}{row.marks[COMPOSITE] or ' '}")
            cells.append(f"{row.elo.rating:.0f}{row.marks[ELO] or ' '}" if row.elo else "-")
        lines.append(line_of(table.name(method), cells, samples_of(row)))
    return [*lines, *notes(table)]


def line_of(name: str, cells: Sequence[str], samples: str) -> str:
    """A line of the table for a terminal."""
    return f"{name:32s}{''.join(f'{cell:>16s}' for cell in cells)}{samples:>6s}"
