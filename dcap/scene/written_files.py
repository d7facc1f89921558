"""Converts values to JSON, and writes files that appear whole or not at all.

If the disk is full or the program is killed, the old file stays.
"""

import errno
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from enum import Enum
from math import isfinite, isnan
from pathlib import Path
from typing import TypeAlias

import numpy as np
from pydantic import BaseModel

JsonValue: TypeAlias = "bool | int | float | str | Sequence[JsonValue] | Mapping[str, JsonValue] | None"
"""Any JSON value."""
JsonObject: TypeAlias = dict[str, JsonValue]
"""A JSON object: the content of a file such as placement.json."""
FULL = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a full disk."""
NEW_FILE = 0o666
"""Permissions of a new file, before the user's mask."""
DRAFTS = ".writing-"
"""Prefix of the folders for drafts, so that no listing of pictures or tables shows half a file."""


def to_json(value: object, name: str = "value") -> JsonValue:
    """A value as JSON: dataclasses become objects with their fields in order, arrays become lists, enums their values.

    A field whose default is None is left out while it is None; infinite numbers become null, as JSON has no infinity. A
    configuration becomes an object of all its fields. Raises TypeError for other types, and ValueError with the name
    for NaN, because null would hide the mistake.
    """
    if isinstance(value, Enum):
        return to_json(value.value, name)
    if isinstance(value, np.ndarray | np.generic):
        return to_json(value.tolist(), name)
    if isinstance(value, float):
        if isnan(value):
            raise ValueError(f"{name} is NaN")
        return value if isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, tuple | list):
        return [to_json(item, name) for item in value]
    return object_to_json(value)


def object_to_json(value: object) -> JsonObject:
    """A dataclass, mapping or configuration as a JSON object, converted like `to_json`."""
    if isinstance(value, BaseModel):
        value = value.model_dump(mode="json")
    if isinstance(value, Mapping):
        return {str(key): to_json(item, str(key)) for key, item in value.items()}
    if not is_dataclass(value) or isinstance(value, type):
        raise TypeError(f"a {type(value).__name__} cannot be written as JSON")
    found = {one.name: (getattr(value, one.name), one.default) for one in fields(value)}
    return {
        name: to_json(item, name) for name, (item, default) in found.items() if item is not None or default is not None
    }


def sorted_keys(tree: Mapping[str, JsonValue]) -> JsonObject:
    """The same object with its keys, and those of all nested objects, in alphabetical order."""
    return {key: _sorted(tree[key]) for key in sorted(tree)}


def _sorted(tree: JsonValue) -> JsonValue:
    if isinstance(tree, Mapping):
        return sorted_keys(tree)
    return [_sorted(item) for item in tree] if isinstance(tree, list) else tree


def canonical_json(tree: object, *, indent: int | None = None) -> bytes:
    """JSON with sorted keys and without NaN: equal trees give equal bytes."""
    text = json.dumps(tree, sort_keys=True, allow_nan=False, ensure_ascii=False, indent=indent)
    return text.encode()


@contextmanager
def whole_file(path: Path, mode: int = NEW_FILE) -> Iterator[Path]:
    """Yield an empty file of the same name in a folder next to `path`; it replaces `path` after the block. OSError
    names `path`. A path that is not a regular file, such as a pipe, is written directly; a link is followed."""
    path = path.resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=DRAFTS) as folder:
            draft = Path(folder, path.name)
            os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode))
            yield draft
            os.replace(draft, path)
    except OSError as error:
        if error.errno is None or not (error.filename is None or str(path.parent / DRAFTS) in str(error.filename)):
            raise  # about another file that the block reads, or from a library
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def draft_folder(folder: Path) -> Iterator[Path]:
    """Create `folder` and yield a draft folder in it; the block writes files there and moves them to `folder`. OSError
    of a full disk names `folder`, because the system does not name an open file."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=DRAFTS) as draft:
            yield Path(draft)
    except OSError as error:
        if error.errno in FULL and error.filename is None:
            error.filename = str(folder)
        raise


def write_whole(path: Path, data: bytes, mode: int = NEW_FILE) -> None:
    """Write a draft and move it to `path`; OSError names the file."""
    with whole_file(path, mode) as draft:
        draft.write_bytes(data)


def digest_of_file(path: Path) -> str:
    """SHA-256 of the bytes of one file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
