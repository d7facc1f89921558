"""What a stage has computed before: keys and records.

A record lies at `records/KEY` as Prefect's result file. KEY is the digest of everything that decides the result: stage,
code reachable by import, configuration, inputs and libraries. A record counts only if it is a plain file of just the
form that we write, its own key and the digest of its deciders are the wanted ones, and its artifact is sound; if not,
the next name is used (KEY, KEY-r1, KEY-r2, ...), so nothing is ever deleted on the way. With `$DCAP_STORE`, a key
without a record here is looked for in the shared store, and a new record is written there, too.
"""

import hashlib
import json
import math
import os
import re
import stat
import uuid
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dcap.scene.errors import StoreError
from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import DRAFTS, Store
from dcap.scene.store.building import check_folder
from dcap.scene.store.codec import canonical_json
from dcap.scene.store.ref import Ref
from dcap.scene.store.remote import MOST_RECORD_BYTES
from tasks.runner.digests import installed_version

MOST_REPEATS = 1000
MOST_BYTES = 1 << 60
"""No artifact has that many."""
SHA256 = re.compile("[0-9a-f]{64}")
NAME = re.compile("[A-Za-z]+")
"""Of a kind of artifact; it names a folder of the store."""
REPEAT = re.compile(r"-r\d+$")
"""End of a record's name that comes after damaged ones of the same key."""
SERIALIZER = {
    "type": "json",
    "jsonlib": "json",
    "object_encoder": "prefect.serializers.prefect_json_object_encoder",
    "object_decoder": "prefect.serializers.prefect_json_object_decoder",
    "dumps_kwargs": {},
    "loads_kwargs": {},
}
"""How Prefect writes our records. It reads a file as the file itself says: by pickle, or by any function of any module,
so a file that says anything else is not ours, and is never handed to Prefect."""
CLASS_KEYS = frozenset({"__class__", "__exc_type__"})
"""Keys by which its decoder makes objects of any class."""


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
            "check": self.check,
        }

    @property
    def check(self) -> str:
        """Digest of all else: nothing but that binds the reference to the key."""
        told = {"key": self.key, "ref": self.ref.to_json(), "seconds": self.seconds, "size": self.size}
        return hashlib.sha256(canonical_json(told | {"deciders": self.deciders})).hexdigest()

    @classmethod
    def from_json(cls, tree: object) -> "Record":
        """The record that `to_json` wrote; KeyError, TypeError or ValueError if it is something else."""
        if not isinstance(tree, dict) or not isinstance(tree["ref"], dict) or not isinstance(tree["deciders"], dict):
            raise TypeError("no object with a reference and what decided it")
        if tree.keys() - {"check"} != {"key", "ref", "seconds", "size", "deciders"} or len(tree["ref"]) != 2:
            raise ValueError("more than a record holds")
        ref: Ref[Any] = Ref.from_json(tree["ref"])
        if not NAME.fullmatch(ref.kind) or not SHA256.fullmatch(ref.sha256):
            raise ValueError(f"{ref.kind} {ref.sha256} is no reference to an artifact")
        key, seconds, size = tree["key"], tree["seconds"], tree["size"]
        if not isinstance(key, str) or type(size) is not int or type(seconds) not in (int, float):
            raise TypeError("its key, size or seconds are of another type")
        if not 0 <= size < MOST_BYTES or not 0.0 <= seconds < math.inf:
            raise ValueError(f"{size} bytes and {seconds} s")
        record = cls(key, ref, seconds, size, tree["deciders"])
        if tree.get("check", record.check) != record.check:  # records of earlier versions have none
            raise ValueError("it does not match its own digest")
        return record

    def decides(self, key: str) -> bool:
        """Whether it is the record of this key, and not another's under its name."""
        try:
            return self.key == key and key_of(self.deciders) == key
        except (ValueError, RecursionError):  # not a number, half a character, a thousand brackets
            return False


def key_of(deciders: Mapping[str, object]) -> str:
    """Name of the record of what decides a result in its plain form."""
    return f"{deciders.get('stage')}-{hashlib.sha256(canonical_json(dict(deciders))).hexdigest()[:40]}"


def records_root() -> Path:
    """Folder of all records."""
    return cache_root() / "records"


def usable_key(key: str, store: Store) -> tuple[str, Record | None]:
    """First name that is free or whose record has a sound artifact, and that record."""
    root = records_root()
    check_folder(root)
    for repeat in range(MOST_REPEATS):
        name = key if repeat == 0 else f"{key}-r{repeat}"
        path = root / name
        if not os.path.lexists(path):
            return name, shared_record(key, path, store)
        record = read_record(path)
        if record is not None and record.decides(key) and store.has(record.ref):
            return name, record
    raise StoreError(f"{key}: {MOST_REPEATS} records are damaged; `dcap cache verify --repair` moves them away")


def shared_record(key: str, path: Path, store: Store) -> Record | None:
    """The record of a key in the shared store, if its artifact is sound; it lies at a path here, too, then."""
    data = None if store.remote is None else store.remote.record(key)
    if data is None:
        return None
    try:
        record = Record.from_json(json.loads(data))
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    if not record.decides(key) or not store.has(record.ref):
        return None
    write_record(path, record, store)
    return record


def share_record(record: Record, store: Store) -> None:
    """Write a new record into the shared store, if there is one; its artifact is there."""
    if store.remote is not None:
        store.remote.push_record(record.key, canonical_json(record.to_json()))


def write_record(path: Path, record: Record, store: Store) -> None:
    """Write a record as Prefect would; it appears whole."""
    metadata = {
        "storage_key": str(path),
        "expiration": None,
        "serializer": SERIALIZER,
        "prefect_version": installed_version("prefect"),
        "storage_block_id": None,
    }
    draft = store.root / DRAFTS / f"record-{uuid.uuid4().hex}"
    for folder in (draft.parent, path.parent):
        folder.mkdir(parents=True, exist_ok=True)
    draft.write_bytes(json.dumps({"metadata": metadata, "result": json.dumps(record.to_json())}).encode())
    os.replace(draft, path)


def read_record(path: Path) -> Record | None:
    """The record in a file; None if it is not a whole record, or no plain file: a link may lead to another's record, a
    pipe has no end."""
    try:
        return record_in(path)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def record_in(path: Path) -> Record:
    """The record in a file; an error that says what the file is instead: OSError, ValueError, KeyError, TypeError or
    RecursionError."""
    status = path.lstat()
    if not stat.S_ISREG(status.st_mode):
        raise ValueError("no plain file")
    if status.st_size > MOST_RECORD_BYTES:
        raise ValueError(f"{status.st_size} bytes")
    tree = json.loads(path.read_bytes())
    if not isinstance(tree, dict) or tree.keys() != {"metadata", "result"} or not isinstance(tree["metadata"], dict):
        raise TypeError("no result file of Prefect's")
    if tree["metadata"].get("serializer") != SERIALIZER or tree["metadata"].get("expiration") is not None:
        raise ValueError("not written by us")
    result = json.loads(tree["result"]) if isinstance(tree["result"], str) else tree["result"]
    if names_class(result):
        raise ValueError("asks Prefect for an object of a class")
    return Record.from_json(result)


def key_in(name: str) -> str:
    """The key that a record's file name stands for."""
    return REPEAT.sub("", name)


def close_ranks() -> None:
    """Give the records of a key the first names again where damaged ones before them were taken away: nobody looks
    behind a free name."""
    root = records_root()
    names: dict[str, list[str]] = defaultdict(list)
    for path in root.iterdir() if root.is_dir() else ():
        names[key_in(path.name)].append(path.name)
    for key, same in names.items():
        for number, name in enumerate(sorted(same, key=lambda one: (len(one), one))):
            wanted = key if number == 0 else f"{key}-r{number}"
            if name != wanted:
                os.rename(root / name, root / wanted)


def names_class(tree: object) -> bool:
    """Whether Prefect's decoder would make an object of a class of some part of a tree."""
    if isinstance(tree, dict):
        return not CLASS_KEYS.isdisjoint(tree) or any(names_class(one) for one in tree.values())
    return isinstance(tree, list) and any(names_class(one) for one in tree)
