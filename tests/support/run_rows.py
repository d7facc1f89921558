"""Rows of the small run of several methods (many_methods_run.py), and its page."""

from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
from many_methods_run import METHODS

from dcap.evaluation.outcome_table import SampleOutcome, row_of
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import summary_of
from dcap.scene.types.sample import Sample


def outcomes(run: Path) -> list[SampleOutcome]:
    """The rows of the small run, with metrics that are told apart."""
    rows = []
    for one in pq.read_table(run / "results.parquet").to_pylist():
        given = Sample(str(one["sample"]), str(one["scene"]), str(one["object"]), str(one["prompt"]))
        row = row_of(given, {"verdict": one["verdict"], "base": {"id": "1", "label": "bed"}}, "", None)
        number = METHODS.index(one["method"])
        rows.append(replace(row, method=one["method"], right_place=9.0, judge="metric rubric", support_hit=number < 2,
                            physics_naturalness=one["physics_naturalness"], penetration_m=0.001 * number,
                            gap_m=0.002, drift_m=None if number else 1e-4))  # fmt: skip
    return rows


def written(run: Path, rows: list[SampleOutcome]) -> str:
    """The page of these rows."""
    return write_report(run, rows, summary_of(rows, run="run", wall_s=1.0)).read_text(encoding="utf-8")
