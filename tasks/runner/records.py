"""What a stage has computed before: keys, records, and the reason why a record does not fit.

A record lies at `records/KEY` as Prefect's result file. KEY is the digest of everything that decides the result: stage,
code reachable by import, configuration, inputs and libraries. A record counts only while its artifact is sound; if it
is not, the next name is used (KEY, KEY-r1, KEY-r2, ...), so nothing is ever deleted on the way.
"""

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import Store
from dcap.scene.store.codec import canonical_json
from dcap.scene.store.ref import Ref

MOST_REPEATS = 1000


@dataclass(frozen=True, slots=True)
class Deciders:
    """Everything that decides what a stage returns."""

    stage: str
    code: dict[str, str]
    """Digest per source file."""
    config: object
    """The configuration as JSON."""
    inputs: dict[str, object]
    """References and plain values by parameter name."""
    libraries: dict[str, str]
    """Versions by import name."""

    def to_json(self) -> dict[str, object]:
        """Plain form for the record."""
        return {
            "stage": self.stage,
            "code": self.code,
            "config": self.config,
            "inputs": self.inputs,
            "libraries": self.libraries,
        }

    @property
    def key(self) -> str:
        """Name of the record, readable at the front."""
        return f"{self.stage}-{hashlib.sha256(canonical_json(self.to_json())).hexdigest()[:40]}"


@dataclass(frozen=True, slots=True)
class Record:
    """One finished run of a stage."""

    key: str
    ref: Ref[Any]
    seconds: float
    """Wall time of the function, without loading and saving [s]."""
    size: int
    """Size of the artifact [bytes]."""
    deciders: dict[str, object]

    def to_json(self) -> dict[str, object]:
        """Plain form, the result that Prefect persists."""
        return {
            "key": self.key,
            "ref": self.ref.to_json(),
            "seconds": self.seconds,
            "size": self.size,
            "deciders": self.deciders,
        }

    @classmethod
    def from_json(cls, tree: object) -> "Record":
        """The record that `to_json` wrote; KeyError or TypeError if it is something else."""
        if not isinstance(tree, dict):
            raise TypeError(f"a record is an object, not {type(tree).__name__}")
        return cls(tree["key"], Ref.from_json(tree["ref"]), tree["seconds"], tree["size"], tree["deciders"])


def records_root() -> Path:
    """Folder of all records."""
    return cache_root() / "records"


def usable_key(key: str, store: Store) -> tuple[str, Record | None]:
    """First name that is free or whose record has a sound artifact, and that record."""
    for repeat in range(MOST_REPEATS):
        name = key if repeat == 0 else f"{key}-r{repeat}"
        path = records_root() / name
        if not path.exists():
            return name, None
        record = read_record(path)
        if record is not None and store.has(record.ref):
            return name, record
    raise RuntimeError(f"{key}: {MOST_REPEATS} records whose artifacts are damaged; remove {records_root()}")


def read_record(path: Path) -> Record | None:
    """The record in a file; None if the file is not a whole record."""
    try:
        result = json.loads(path.read_bytes())["result"]
        return Record.from_json(json.loads(result) if isinstance(result, str) else result)
    except (OSError, ValueError, KeyError, TypeError):
        return None


def records_of(stage: str) -> Iterator[Record]:
    """All readable records of a stage, newest first."""
    paths = sorted(records_root().glob(f"{stage}-*"), key=lambda path: path.stat().st_mtime_ns, reverse=True)
    for path in paths:
        record = read_record(path)
        if record is not None and record.deciders.get("stage") == stage:
            yield record


def why_not_cached(wanted: Deciders, store: Store) -> str:
    """What keeps the closest earlier record from being used, in a few words."""
    closest: list[str] | None = None
    for record in records_of(wanted.stage):
        found = differences(record.deciders, wanted.to_json())
        if not found:
            return "artifact missing or damaged" if not store.has(record.ref) else "asked for"
        if closest is None or len(found) < len(closest):
            closest = found
    if closest is None:
        return "never computed"
    if any(one.startswith("input ") for one in closest):
        return "new inputs"
    return ", ".join(closest[:3]) + (f" and {len(closest) - 3} more" if len(closest) > 3 else "")


def differences(old: dict[str, object], new: dict[str, object]) -> list[str]:
    """Names of the deciders that differ: changed files, settings, inputs and libraries."""
    found = []
    for group, words in (("inputs", "input {}"), ("code", "{} changed"), ("libraries", "{} changed version")):
        before, after = old.get(group), new.get(group)
        if isinstance(before, dict) and isinstance(after, dict):
            names = sorted(before.keys() | after.keys())
            found += [words.format(name) for name in names if before.get(name) != after.get(name)]
    if old.get("config") != new.get("config"):
        found.append("settings changed")
    return found
