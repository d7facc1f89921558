"""What the runs need of the cache: each folder below `runs/` with a run.json or a sample.json keeps all that its
placements were made from.

A placement says so itself (`records.json`). One without it, because it failed, is still computed or is of an
earlier version, is planned: what can be looked up of it now is needed.
"""

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from flows.find_run import RUN
from flows.place import PlaceConfig
from flows.run_files import PLACEMENT, Asked, asked_of, asked_of_run
from flows.sample_records import read_needs
from flows.sample_run import looked_up
from tasks.runner.collection import Needs


@dataclass(frozen=True, slots=True)
class KeptRuns:
    """The runs that are there, and what they need."""

    folders: tuple[Path, ...]
    needs: Needs
    unknown: tuple[str, ...]
    """Placements that cannot be looked up, and why."""


def kept_runs(others: Sequence[Path] = ()) -> KeptRuns:
    """All runs below `runs/` and the folders that are named besides; InputError where one cannot be read."""
    for folder in others:
        if not any(run_folders(folder)):
            raise InputError(f"--keep {folder}: no run and no placement lies there; give the folder of one")
    folders = sorted({folder for root in (runs_root(), *others) for folder in run_folders(root)})
    found, unknown = [], []
    for folder in folders:
        asked = asked_in(folder)
        for sample in asked.samples.values():
            known = read_needs(asked.folder_of(sample.id))
            if known is None:
                known, why = planned_needs(sample, asked.config)
                unknown += [f"{folder.name} {sample.id}: {why}"] if why else []
            found.append(known)
    return KeptRuns(tuple(folders), together(found), tuple(unknown))


def run_folders(root: Path) -> Iterator[Path]:
    """Folders at or below one that hold a run or a placement; links are not followed."""
    for place, _, files in os.walk(root):
        if RUN in files or PLACEMENT in files:
            yield Path(place).resolve()


def asked_in(folder: Path) -> Asked:
    """What was asked in a folder; InputError if that cannot be read: nobody knows what it needs, then."""
    try:
        return asked_of_run(folder) if (folder / RUN).is_file() else asked_of(str(folder), None)[0]
    except (InputError, OSError, ValueError, KeyError, TypeError, AssertionError) as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{folder} cannot be read ({told[:200]}), so what it needs is not known; remove it") from None


def planned_needs(sample: Sample, config: PlaceConfig) -> tuple[Needs, str]:
    """What can be looked up of a placement, and what is wrong with it."""
    records, why = looked_up(sample, config)
    return Needs(frozenset(one.key for one in records), frozenset(one.ref for one in records)), why


def together(needs: Iterable[Needs]) -> Needs:
    """All of some needs."""
    every = list(needs)
    return Needs(
        frozenset[str]().union(*(one.keys for one in every)), frozenset().union(*(one.refs for one in every))
    )  # fmt: skip
