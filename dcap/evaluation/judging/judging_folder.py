"""The folder `judging/` of a run: scores, comparisons, and their judge.

`scores.parquet` has a row for each placement, `comparisons.parquet` one for each axis of each comparison, `judge.json`
the judge and how far it can be trusted. The same judgement gives the same bytes, except for its cost.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from dcap.evaluation.judging.judge import JudgedScore
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, on_axis, write_comparisons
from dcap.evaluation.statistics.sides import SideReport, side_report
from dcap.language.model.ledger import Spending
from dcap.scene.errors import FormatError
from dcap.scene.json_tree import object_to_json, whole_file, write_whole

JUDGING, SCORES, COMPARISONS, JUDGE = "judging", "scores.parquet", "comparisons.parquet", "judge.json"
SCORE_COLUMNS = pa.schema([
    ("sample", pa.string()), ("method", pa.string()), ("right_place", pa.float64()),
    ("physics_naturalness", pa.float64()), ("judge", pa.string()), ("analysis", pa.string()),
])  # fmt: skip


@dataclass(frozen=True, slots=True)
class JudgeRecord:
    """Judge of a run: the first keys of judge.json."""

    judge: str
    """Its name in tables."""
    client: str
    """offline, anthropic, openai or replay."""
    same_family: bool
    """Whether the judge and the model that chose the placements have the same maker, which the judge may favour."""
    chooser: str
    """Model that answered the questions of the placements; `offline rules` where none did."""
    questions: int
    """Number of questions: one for each scored placement, two for each pair."""
    judged: int
    """Placements with a final state."""
    lowest: int
    """Scores of 1 for samples without a placement although one was intended."""
    left_out: int
    """Rows of the run that are neither."""
    states: Mapping[str, str] = field(default_factory=dict)
    """Fingerprints of the judged final states, by method and sample: `dcap rerun` may change them afterwards."""


def write_judging(
    run: Path,
    record: JudgeRecord,
    scores: Sequence[JudgedScore],
    comparisons: Sequence[Comparison],
    spending: Spending | None,
) -> Path:
    """Write a judgement into a run; returns its folder."""
    folder = run / JUDGING
    folder.mkdir(exist_ok=True)
    with whole_file(folder / SCORES) as draft:
        pq.write_table(pa.Table.from_pylist([asdict(one) for one in scores], schema=SCORE_COLUMNS), draft)
    write_comparisons(folder / COMPARISONS, comparisons)
    sides = {axis.value: side_tree(side_report(on_axis(comparisons, axis))) for axis in JudgedAxis}
    tree = {**asdict(record), "sides": sides, "language": object_to_json(spending) if spending else None}
    text = json.dumps(tree, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
    write_whole(folder / JUDGE, text.encode())
    return folder


def side_tree(report: SideReport) -> dict[str, object]:
    """A judge's habits with their shares."""
    return {**asdict(report), "tie_rate": report.tie_rate, "left_share": report.left_share}


def read_record(run: Path) -> JudgeRecord | None:
    """Read the judge of a run; None without one; FormatError if judge.json is invalid."""
    path = run / JUDGING / JUDGE
    if not path.is_file():
        return None
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
        return JudgeRecord(**{one.name: tree[one.name] for one in fields(JudgeRecord)})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FormatError(f"{path}: not a judge's record ({type(error).__name__}: {error}); judge again") from None


def read_scores(run: Path) -> list[JudgedScore]:
    """Read the scores of a run; FormatError if they are invalid."""
    path = run / JUDGING / SCORES
    try:
        rows = pq.read_table(path, columns=SCORE_COLUMNS.names).to_pylist()
        return [JudgedScore(**row) for row in rows]
    except (OSError, pa.ArrowInvalid, TypeError) as error:
        raise FormatError(f"{path}: no table of scores ({type(error).__name__}); judge again") from None
