"""Differences between two runs, or two folders that `place` wrote: outcomes, poses, numbers, requests, settings.

The same code, settings and inputs give the same bytes, so numbers are compared exactly; times do not count as
differences and are listed separately.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from math import inf, isfinite, isnan
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from dcap.evaluation.methods import joined_id
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
SHOWN = 40
"""Rows of a table of differences; `--json` has all."""
DIGITS = 6

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Position [m] and quaternion (w, x, y, z)."""
Facts = Mapping[str, object]
Row = dict[str, Any]
"""One difference; docs/formats.md has the keys."""


@dataclass(frozen=True, eq=False, slots=True)
class SampleFacts:
    """Facts of a sample in a run."""

    asked: Facts
    outcome: Facts
    """Verdict, reason, support and other words."""
    pose: Pose | None
    numbers: Mapping[str, float | None]
    times: Mapping[str, float]
    """[s]."""


@dataclass(frozen=True, eq=False, slots=True)
class RunFacts:
    """Facts of a run."""

    folder: str
    samples: Mapping[str, SampleFacts]
    config: Facts
    """Settings by dotted keys; empty if unknown."""
    versions: Facts


@dataclass(frozen=True, slots=True)
class RunDiff:
    """Everything that differs between a run `a` and a run `b`."""

    a: str
    b: str
    only_a: list[str]
    only_b: list[str]
    """Samples that only one has."""
    outcomes: list[Row]
    poses: list[Row]
    """Distance [m] and angle of the rotation between them [degrees]."""
    metrics: list[Row]
    """Numbers that only one run has first, then by relative change, the largest first."""
    asked: list[Row]
    config: list[Row]
    versions: list[Row]
    times: list[Row]
    """[s]; no difference between runs."""

    @property
    def equal(self) -> bool:
        """Whether nothing differs, apart from times."""
        return not any(getattr(self, one.name) for one in fields(self) if one.name not in ("a", "b", "times"))


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


# facts of a run -------------------------------------------------------------------------------------------------------


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
    return {joined_id(row["method"], row["sample"]): row for row in rows}


def sample_facts(asked: Sample | None, row: Mapping[str, Any] | None, folder: Path) -> SampleFacts:
    """Facts of a sample whose files lie in a folder."""
    tree = read_keys(folder / RESULT) if (folder / RESULT).is_file() else None
    if row is None and asked is not None:
        row = asdict(scored_row(asked, tree, UNFINISHED, None, folder))
    if row is None:
        row = {"verdict": (tree or {}).get("verdict", "failed"), "reason": (tree or {}).get("reason") or ""}
    with input_errors(folder / RESULT):
        pose = pose_at_rest(tree) if tree and isinstance(tree.get("pose"), Mapping) else None
        times = {name: float(one) for name, one in ((tree or {}).get("timings") or {}).items()}
    told = {name: value for name, value in row.items() if name not in NO_WORDS}
    return SampleFacts(
        asked=dict(request_facts(asked)) if asked else {},
        outcome={name: value for name, value in told.items() if isinstance(value, str | bool)},
        pose=pose,
        numbers={name: value for name, value in told.items() if not isinstance(value, str | bool)},
        times=times | {"total": row.get("seconds") or 0.0},
    )


def request_facts(asked: Sample) -> Iterator[tuple[str, object]]:
    """Request of a sample, by dotted keys."""
    for key, value in flattened({name: one for name, one in asdict(asked).items() if name not in UNASKED}):
        yield key, Path(str(value)).name if key in FILES else value


def settings_of(tree: Mapping[str, Any]) -> Facts:
    """The settings of a run by dotted keys, without those that never change a result."""
    methods = tree.get("methods")
    told = {"methods": ", ".join(methods)} if isinstance(methods, list) else {}
    dataset = {"dataset": Path(str(tree["dataset"])).name} if "dataset" in tree else {}
    return {**told, **dataset, **dict(flattened(deciding(tree.get("config") or {})))}


# comparison -----------------------------------------------------------------------------------------------------------


def diff_runs(a: RunFacts, b: RunFacts) -> RunDiff:
    """Compare two runs, sample by sample."""
    both = [({"sample": name}, a.samples[name], b.samples[name]) for name in a.samples if name in b.samples]
    return RunDiff(
        a=a.folder,
        b=b.folder,
        only_a=[name for name in a.samples if name not in b.samples],
        only_b=[name for name in b.samples if name not in a.samples],
        outcomes=[name | row for name, x, y in both for row in words(x.outcome, y.outcome)],
        poses=[name | row for name, x, y in both for row in poses(x.pose, y.pose)],
        metrics=most_changed(name | row for name, x, y in both for row in numbers(x.numbers, y.numbers)),
        asked=[name | row for name, x, y in both for row in words(x.asked, y.asked)],
        config=list(words(a.config, b.config)),
        versions=list(words(a.versions, b.versions)),
        times=most_changed(name | row for name, x, y in both for row in numbers(x.times, y.times)),
    )


def words(a: Facts, b: Facts) -> Iterator[Row]:
    """Keys whose values differ; none if one side knows nothing at all."""
    for key in dict.fromkeys([*a, *b]) if a and b else ():
        if a.get(key) != b.get(key):
            yield {"key": key, "a": a.get(key), "b": b.get(key)}


def poses(a: Pose | None, b: Pose | None) -> Iterator[Row]:
    """The difference of two poses, if any; a missing pose shows in the verdict instead."""
    if a is None or b is None:
        return
    distance, angle = float(np.linalg.norm(a[0] - b[0])), angle_between_deg(a[1], b[1])
    if distance > 0.0 or angle > 0.0:
        yield {"position_m": distance, "angle_deg": angle}


def angle_between_deg(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle of the rotation between two unit quaternions, of which each and its negative are the same rotation."""
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    b = b if a @ b >= 0.0 else -b
    return float(np.degrees(4.0 * np.arcsin(min(1.0, 0.5 * float(np.linalg.norm(a - b))))))  # exact for small angles


def numbers(a: Mapping[str, float | None], b: Mapping[str, float | None]) -> Iterator[Row]:
    """Numbers that differ, with their absolute change, and that over the larger of the two; both None if one of them
    is missing or not finite."""
    for name in dict.fromkeys([*a, *b]):
        x, y = a.get(name), b.get(name)
        if x == y or (x is not None and y is not None and isnan(x) and isnan(y)):
            continue
        row: Row = {"metric": name, "a": x, "b": y, "difference": None, "relative": None}
        if x is not None and y is not None and isfinite(x) and isfinite(y):
            row |= {"difference": abs(y - x), "relative": abs(y - x) / max(abs(x), abs(y))}
        yield row


def most_changed(found: Iterator[Row]) -> list[Row]:
    """Largest relative change first."""
    return sorted(found, key=lambda one: -(inf if one["relative"] is None else one["relative"]))


# text -----------------------------------------------------------------------------------------------------------------


def difference_lines(found: RunDiff, *, times: bool) -> list[str]:
    """All tables as lines."""
    lines = [f"only in {name}: {', '.join(samples)}" for name, samples in (("a", found.only_a), ("b", found.only_b))
             if samples]  # fmt: skip
    for name in ("outcomes", "poses", "metrics", "asked", "config", "versions", *(["times"] if times else [])):
        lines += table_lines(name, getattr(found, name))
    return lines


def table_lines(name: str, rows: Sequence[Row]) -> list[str]:
    """A table with its heading; nothing for no rows."""
    if not rows:
        return []
    cells = [list(rows[0]), *([table_cell(value) for value in row.values()] for row in rows[:SHOWN])]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join(f"{word:<{width}}" for word, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    more = [f"... {len(rows) - SHOWN} more, all with --json"] if len(rows) > SHOWN else []
    return ["", f"{name} ({len(rows)})", *lines, *more]


def table_cell(value: object) -> str:
    """A value as a table shows it."""
    if value is None:
        return "-"
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
