"""Reads the facts of two runs, or of two folders that `place` wrote, for a comparison."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from dcap.evaluation.methods import DCAP
from dcap.evaluation.run_diff import Pose, RunDiff, RunFacts, SampleFacts, diff_runs
from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from flows.find_run import RUN, find_run, input_errors, read_keys, read_request
from flows.output import RESULT
from flows.run_files import PLACEMENT, UNFINISHED, sample_from_json
from flows.scoring import pose_at_rest, scored_row
from tasks.cache import deciding
from tasks.upkeep import flattened

TABLE = "results.parquet"
NO_WORDS = frozenset({"sample", "method", "scene", "object", "prompt", "message", "seconds"})
"""Columns that are not compared: the request, durations, and numbers within a sentence."""
FILES = ("scene", "object", "labels")
"""Inputs that are paths: the same file may lie elsewhere, so only its name is compared."""
UNASKED = frozenset({"id", "method", "examples"})


def diff_folders(one: str, other: str) -> RunDiff:
    """Compare two runs by name, path or `last`, or two folders of placements."""
    a, b = placed_folder(one), placed_folder(other)
    facts_a, facts_b = run_facts(a), run_facts(b)
    if not (a / RUN).is_file() and not (b / RUN).is_file():  # one placement each, whatever the files are called
        (name,) = facts_a.samples
        facts_b = RunFacts(facts_b.folder, {name: next(iter(facts_b.samples.values()))}, facts_b.config, {})
    return diff_runs(facts_a, facts_b)


def placed_folder(run: str) -> Path:
    """Folder of a run, or of one placement."""
    for folder in (runs_root() / run, Path(run)):
        if (folder / RESULT).is_file() and not (folder / RUN).is_file():
            return folder.resolve()
    return find_run(run)


def run_facts(folder: Path) -> RunFacts:
    """Facts of the run or placement in a folder."""
    if not (folder / RUN).is_file():
        return placement_facts(folder)
    tree = read_request(folder / RUN)
    rows = rows_of(folder)
    with input_errors(folder / RUN):
        asked = [sample_from_json(one) for one in tree["samples"]]
    samples = {one.id: sample_facts(one, rows.get(one.id), sample_folder(folder, one.id)) for one in asked}
    return RunFacts(str(folder), samples, settings_of(tree), tree.get("versions") or {})


def placement_facts(folder: Path) -> RunFacts:
    """Facts of the placement in a folder."""
    tree = read_request(folder / PLACEMENT) if (folder / PLACEMENT).is_file() else {}
    with input_errors(folder / PLACEMENT):
        asked = sample_from_json(tree["sample"]) if tree else None
    facts = {asked.id if asked else "placement": sample_facts(asked, None, folder)}
    return RunFacts(str(folder), facts, settings_of(tree) if tree else {}, {})


def rows_of(folder: Path) -> dict[str, dict[str, Any]]:
    """Rows of the run's table by the samples' ids; empty where a run has not ended."""
    path = folder / TABLE
    if not path.is_file():
        return {}
    try:
        rows = pq.read_table(path).to_pylist()
    except (OSError, pa.ArrowException) as error:
        raise InputError(f"{path}: cannot be read: {error}") from None
    return {sample_id(row): row for row in rows}


def sample_id(row: Mapping[str, Any]) -> str:
    """The id of a row's sample in its run."""
    method = row.get("method", DCAP)
    return str(row["sample"]) if method == DCAP else f"{method}/{row['sample']}"


def sample_facts(asked: Sample | None, row: Mapping[str, Any] | None, folder: Path) -> SampleFacts:
    """Facts of a sample whose files lie in a folder."""
    tree = read_keys(folder / RESULT) if (folder / RESULT).is_file() else None
    if row is None:
        row = row_from_files(asked, tree, folder)
    with input_errors(folder / RESULT):
        pose = pose_of(tree)
        times = {name: float(one) for name, one in ((tree or {}).get("timings") or {}).items()}
    told = {name: value for name, value in row.items() if name not in NO_WORDS}
    return SampleFacts(
        asked=dict(request_facts(asked)) if asked else {},
        outcome={name: value for name, value in told.items() if isinstance(value, str | bool)},
        pose=pose,
        numbers={name: value for name, value in told.items() if not isinstance(value, str | bool)},
        times=times | {"total": row.get("seconds") or 0.0},
    )


def row_from_files(asked: Sample | None, tree: dict[str, Any] | None, folder: Path) -> Mapping[str, Any]:
    """The row of a sample by its own files."""
    if asked is None:
        return {"verdict": (tree or {}).get("verdict", "failed"), "reason": (tree or {}).get("reason") or ""}
    return asdict(scored_row(asked, tree, UNFINISHED, None, folder))


def request_facts(asked: Sample) -> Iterator[tuple[str, object]]:
    """Request of a sample, by dotted keys."""
    for key, value in flattened({name: one for name, one in asdict(asked).items() if name not in UNASKED}):
        yield key, Path(str(value)).name if key in FILES else value


def settings_of(tree: Mapping[str, Any]) -> dict[str, object]:
    """The settings of a run by dotted keys, without those that never change a result."""
    found = dict(flattened(deciding(tree.get("config") or {})))
    methods = tree.get("methods")
    told = {"methods": ", ".join(methods)} if isinstance(methods, list) else {}
    dataset = {"dataset": Path(str(tree["dataset"])).name} if "dataset" in tree else {}
    return {**told, **dataset, **found}


def pose_of(tree: Mapping[str, Any] | None) -> Pose | None:
    """Return the pose at rest; None where nothing came to rest."""
    return pose_at_rest(tree) if tree and isinstance(tree.get("pose"), Mapping) else None
