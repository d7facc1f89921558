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

from dcap.evaluation.judging.judge import JudgeRecord, Standing, standing_of, without_placement
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.methods import DCAP, METHODS, baselines_among, shown_name
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.statistics.agreement import SideReport, side_report
from dcap.evaluation.statistics.bootstrap import LEVEL, RESAMPLES
from dcap.evaluation.statistics.comparisons import AXES, Comparison, JudgedAxis, on_axis
from dcap.evaluation.statistics.method_tables import COMPOSITE, DAGGER, ELO, ScoreRow, score_rows
from dcap.evaluation.statistics.ratings import ANCHOR_RATING
from dcap.evaluation.table_files import TABLES, csv_of, number, remove_table, tex_escaped, tex_of, write_table

TABLE1, METRIC_SCORES = "table1", "metric_scores"
"""File names of the table by a model, and by the rubric."""
TITLES = {TABLE1: "Table 1: scores", METRIC_SCORES: "Metrics: scores by stated rules"}
"""Titles of the tables."""
REFEREE_HINT = "it needs MuJoCo, pip install dcap[referee], and two methods; measures.json says why it could not judge"
HEADINGS = ("right place", "physics & nat.", "composite", "Elo", "n")
TEX_HEADINGS = (
    "Method", "Right Place $\\uparrow$", "P \\& N $\\uparrow$", "Composite (GM) $\\uparrow$", "Elo $\\uparrow$", "n",
)  # fmt: skip
NO_SCORE = "-"


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
    sides: SideReport
    """Ties and preference of a side in all comparisons."""
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
    methods = tuple(sorted({row.method for row in rows}, key=list(METHODS).index))
    given = score_arrays(rows, methods)
    scores = {name: value for name, value in given.items() if not np.isnan(value).all()}
    compared = {name for one in on_axis(comparisons, JudgedAxis.OVERALL) for name in one.pair}
    baselines = baselines_among(list(scores))
    anchor = next((name for name in reversed(methods) if name in compared and name in baselines), "")
    found = score_rows(scores, comparisons, baselines, anchor, DCAP, resamples) if scores else []
    scored = [row for row in rows if record.judge == RUBRIC and standing_of(row) is Standing.JUDGED
              and row.physics_naturalness is not None]  # fmt: skip
    return MethodTable(
        methods=methods,
        rows={row.method: row for row in found},
        lowest=without_placement(rows),
        left_out={name: int(np.isnan(given[name]).all(axis=1).sum()) for name in methods},
        anchor=anchor,
        record=record,
        sides=side_report(comparisons),
        offline=offline,
        referee=(sum(row.referee_drift_m is not None for row in scored), len(scored)),
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


def write_method_table(run: Path, table: MethodTable) -> tuple[Path, Path]:
    """Write the table into a run, and remove that of an earlier judge of the other kind."""
    remove_table(run / TABLES, METRIC_SCORES if table.file == TABLE1 else TABLE1)
    return write_table(run / TABLES, table.file, csv_text(table), tex_text(table))


def csv_text(table: MethodTable) -> str:
    """A row per method; values of the whole judgement are repeated in each row."""
    return csv_of([row_cells(table, method) for method in table.methods])


def row_cells(table: MethodTable, method: str) -> dict[str, object]:
    """Cells of a method's row of the CSV; empty without a score."""
    row, record = table.rows.get(method), table.record
    cells: dict[str, object] = {"method": method, "name": table.name(method)}
    for axis in AXES:
        one = row.scores.get(axis) if row else None
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
    return cells | {"tie_rate": number(table.sides.tie_rate), "left_share": number(table.sides.left_share)}


def samples_of(row: ScoreRow | None) -> str:
    """Number of samples with a score, by axis if they differ."""
    counts = [row.scores[axis].samples if axis in row.scores else 0 for axis in AXES] if row else [0]
    return "/".join(map(str, dict.fromkeys(counts)))


def tested(row: ScoreRow | None, name: str) -> dict[str, object]:
    """p and mark of a column."""
    return {f"{name}_p": number(row.p(name) if row else None), f"{name}_significant": bool(row and row.mark(name))}


def shown_cells(row: ScoreRow | None) -> list[str]:
    """Scores, composite, Elo with its interval, and samples of a method as text."""
    if row is None:
        return [NO_SCORE] * 4 + [samples_of(row)]
    cells = [f"{one.mean:.2f} ± {one.spread:.2f}{row.mark(axis)}" if (one := row.scores.get(axis)) else NO_SCORE
             for axis in AXES]  # fmt: skip
    cells.append(NO_SCORE if row.composite is None else f"{row.composite:.2f}{row.mark(COMPOSITE)}")
    elo = row.elo
    ends = f" [{elo.interval.low:.0f}, {elo.interval.high:.0f}]" if elo else ""
    return [*cells, f"{elo.rating:.0f}{row.mark(ELO)}{ends}" if elo else NO_SCORE, samples_of(row)]


def tex_text(table: MethodTable) -> str:
    """The table in the paper's layout, with notes as comments."""
    rows = []
    for method in table.methods:
        *cells, count = shown_cells(table.rows.get(method))
        rows.append([tex_escaped(table.name(method)), *map(tex_cell, cells), count])
    return tex_of(TEX_HEADINGS, rows, "lccccr", notes(table))


def tex_cell(text: str) -> str:
    """A cell of `shown_cells` in LaTeX: intervals are small."""
    if text == NO_SCORE:
        return "--"
    value, bracket, interval = text.partition(" [")
    value = value.replace("±", "\\pm").replace(DAGGER, "^{\\dagger}")
    return f"${value}$" + (f" {{\\small $[{interval}$}}" if bracket else "")


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
    share = table.sides.left_share
    left = "" if share is None else f", {100 * share:.0f} % of the others for the left side"
    said.append(f"Comparisons in both orders: {100 * table.sides.tie_rate:.0f} % ties{left}.")
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
    said.append(
        "Dagger: better than the best baseline; for a baseline, also better than DCAP (paired bootstrap, p < 0.01)."
    )
    return said


def shown_lines(table: MethodTable) -> list[str]:
    """The table for a terminal."""
    rows = [("", *HEADINGS), *((table.name(one), *shown_cells(table.rows.get(one))) for one in table.methods)]
    lines = []
    for name, *cells, count in rows:
        plain = (cell.partition(" [")[0] for cell in cells)  # intervals are in the files
        lines.append(f"{name:32s}{''.join(f'{cell:>16s}' for cell in plain)}{count:>6s}")
    return [*lines, *notes(table)]
