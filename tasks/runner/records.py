"""What a stage has computed before: keys, records, and the reason why a record does not fit.

A record lies at `records/KEY` as Prefect's result file. KEY is the digest of everything that decides the result: stage,
code reachable by import, configuration, inputs and libraries. A record counts only if it is a plain file, its own key
and the digest of its deciders are the wanted ones, and its artifact is sound; if not, the next name is used (KEY,
KEY-r1, KEY-r2, ...), so nothing is ever deleted on the way.
"""

import hashlib
import json
import math
import os
import re
import stat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import Store
from dcap.scene.store.codec import canonical_json
from dcap.scene.store.ref import Ref

MOST_REPEATS = 1000
SHA256 = re.compile("[0-9a-f]{64}")
NAME = re.compile("[A-Za-z]+")
"""Of a kind of artifact; it names a folder of the store."""


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
        return key_of(self.to_json())


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
        """The record that `to_json` wrote; KeyError, TypeError or ValueError if it is something else."""
        if not isinstance(tree, dict) or not isinstance(tree["ref"], dict) or not isinstance(tree["deciders"], dict):
            raise TypeError("a record is an object with a reference and what decided it")
        ref: Ref[Any] = Ref.from_json(tree["ref"])
        if not NAME.fullmatch(ref.kind) or not SHA256.fullmatch(ref.sha256):
            raise ValueError(f"{ref.kind} {ref.sha256} is no reference to an artifact")
        key, seconds, size = tree["key"], tree["seconds"], tree["size"]
        if not isinstance(key, str) or type(size) is not int or type(seconds) not in (int, float):
            raise TypeError("a record's key, size or seconds are of another type")
        if size < 0 or not 0.0 <= seconds < math.inf:
            raise ValueError(f"a record of {size} bytes and {seconds} s")
        return cls(key, ref, seconds, size, tree["deciders"])

    def decides(self, key: str) -> bool:
        """Whether it is the record of this key, and not another's under its name."""
        return self.key == key and key_of(self.deciders) == key


def key_of(deciders: Mapping[str, object]) -> str:
    """Name of the record of what decides a result in its plain form."""
    return f"{deciders.get('stage')}-{hashlib.sha256(canonical_json(dict(deciders))).hexdigest()[:40]}"


def records_root() -> Path:
    """Folder of all records."""
    return cache_root() / "records"


def usable_key(key: str, store: Store) -> tuple[str, Record | None]:
    """First name that is free or whose record has a sound artifact, and that record."""
    for repeat in range(MOST_REPEATS):
        name = key if repeat == 0 else f"{key}-r{repeat}"
        path = records_root() / name
        if not os.path.lexists(path):
            return name, None
        record = read_record(path)
        if record is not None and record.decides(key) and store.has(record.ref):
            return name, record
    raise RuntimeError(f"{key}: {MOST_REPEATS} records whose artifacts are damaged; remove {records_root()}")


def read_record(path: Path) -> Record | None:
    """The record in a file; None if it is not a whole record, or no plain file: a link may lead to another's record, a
    pipe has no end."""
    try:
        if not stat.S_ISREG(path.lstat().st_mode):
            return None
        result = json.loads(path.read_bytes())["result"]
        return Record.from_json(json.loads(result) if isinstance(result, str) else result)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def records_of(stage: str) -> Iterator[Record]:
    """All readable records of a stage, newest first."""
    paths = sorted(records_root().glob(f"{stage}-*"), key=lambda path: path.lstat().st_mtime_ns, reverse=True)
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
