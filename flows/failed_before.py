"""Samples of `benchmark --only-failed`, from the newest run of the same dataset by the same methods."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.text import first_of
from dcap.scene.types.sample import Sample
from flows.display import print_lines
from flows.find_run import RUN, read_request
from flows.place import PlaceConfig
from flows.run_files import UNFINISHED, read_result
from flows.sample_run import plan_sample

SHOWN = 5
"""Most ids that one line names."""


def failed_before(dataset: Path, samples: Sequence[Sample], config: PlaceConfig) -> list[Sample]:
    """Samples that failed or did not finish in the last run; and, for the table of the new run, finished ones whose
    stages are all still cached."""
    folder, asked = last_run(dataset, methods_of_samples(samples))
    known = [sample for sample in samples if sample.id in asked]
    results = {one.id: read_result(sample_folder(folder, one.id)) for one in known}
    left = {name: error for name, (tree, error) in results.items() if tree is None}
    if not left:
        raise InputError(f"nothing failed in {folder.name}; run without --only-failed")
    done = [one for one in known if one.id not in left]
    cached = {one.id for one in done if plan_sample(one, config, bring=False).finished is not None}
    print_lines(taken_lines(folder.name, left, len(cached), len(done) - len(cached)))
    return [one for one in known if one.id in left or one.id in cached]


def methods_of_samples(samples: Sequence[Sample]) -> set[str]:
    """The methods that place the samples."""
    return {sample.method for sample in samples}


def last_run(dataset: Path, methods: set[str]) -> tuple[Path, set[str]]:
    """The newest run of a dataset by these methods, and the ids of its samples."""
    found = []
    for path in runs_root().glob(f"*/{RUN}"):
        tree = readable_run(path)
        same = tree.get("dataset") == str(dataset.resolve()) and set(tree.get("methods", ())) == methods
        if same and not path.parent.is_symlink():
            found.append((str(tree.get("started")), path.stat().st_mtime_ns, path.parent, tree))
    if not found:
        raise InputError(
            f"--only-failed: no run of {dataset} by {', '.join(sorted(methods))} in {runs_root()}; run without it"
        )
    _, _, folder, tree = max(found, key=lambda one: one[:2])
    return folder, {str(one.get("id")) for one in tree.get("samples", ())}


def readable_run(path: Path) -> dict[str, Any]:
    """Read the request of a run; empty if it cannot be read, or another version wrote it."""
    try:
        return read_request(path)
    except (InputError, OSError):
        return {}


def taken_lines(run: str, left: Mapping[str, str], cached: int, changed: int) -> list[str]:
    """Lines that say which samples are taken, and which are not and why. `left` are the samples without a result, with
    their errors."""
    broken = [name for name, error in left.items() if error != UNFINISHED]
    unfinished = [name for name, error in left.items() if error == UNFINISHED]
    groups = (("failed", broken), (UNFINISHED, unfinished))
    told = [f"{len(some)} {word} ({first_of(some, SHOWN)})" for word, some in groups if some]
    lines = [f"of {run}: {' and '.join(told)} and run again, {cached} finished and come from the cache"]
    if changed:
        others = "finished with other code or settings; without --only-failed they run, too"
        lines.append(f"left out: {changed} that {others}")
    return lines
