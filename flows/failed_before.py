"""Which samples `benchmark --only-failed` takes: of the newest run of the same dataset by the same methods."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.spelling import first_of
from dcap.scene.types.sample import Sample
from flows.display import print_lines
from flows.find_run import RUN, read_asked
from flows.place import PlaceConfig
from flows.run_files import UNFINISHED, read_result
from flows.sample_run import plan_sample

SHOWN = 5
"""Ids that a line names."""


def failed_before(dataset: Path, samples: Sequence[Sample], config: PlaceConfig) -> list[Sample]:
    """The samples that failed or did not finish in the last run; and those that finished, for the table of the new run,
    as far as nothing of them would have to run."""
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
    """The methods that place them."""
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
    """Read what was asked of a run; nothing where it cannot be read, or another version made it."""
    try:
        return read_asked(path)
    except (InputError, OSError):
        return {}


def taken_lines(run: str, left: Mapping[str, str], cached: int, changed: int) -> list[str]:
    """What is taken, and what is not and why; `left` are the samples without a result, and what went wrong."""
    broken = [name for name, error in left.items() if error != UNFINISHED]
    unfinished = [name for name, error in left.items() if error == UNFINISHED]
    groups = (("failed", broken), (UNFINISHED, unfinished))
    told = [f"{len(some)} {word} ({first_of(some, SHOWN)})" for word, some in groups if some]
    lines = [f"of {run}: {' and '.join(told)} and run again, {cached} finished and come from the cache"]
    if changed:
        others = "finished with other code or settings; without --only-failed they run, too"
        lines.append(f"left out: {changed} that {others}")
    return lines
