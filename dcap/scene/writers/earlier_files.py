"""Copies the files of earlier results instead of making them again.

A key identifies the files. A note in the cache holds the folder where they were written last, and the digest of each.
Files that were moved, deleted or edited there are made again, so a lost or damaged note only costs time.
"""

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dcap.scene.json_tree import canonical_json
from dcap.scene.settings import cache_root
from dcap.scene.whole_files import digest_of_file, write_whole

FOLDER = "earlier"
DAMAGED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""Errors of reading a damaged note."""


def copy_earlier(key: str, folder: Path) -> dict[str, str]:
    """Copy the files of a key into a folder.

    Returns their names there by kind; none unless all are complete.
    """
    try:
        note = read_note(note_path(key))
        for name, digest in note["sha256"].items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(note["folder"], name), folder / name)
            if digest_of_file(folder / name) != digest:
                return {}
    except DAMAGED:
        return {}
    return dict(note["files"])


def note_files(key: str, folder: Path, files: Mapping[str, str]) -> None:
    """Record where the files of a key were written: their names in the folder by kind."""
    digests = {name: digest_of_file(folder / name) for name in files.values()}
    note = {"folder": str(folder.resolve()), "files": dict(files), "sha256": digests}
    path = note_path(key)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({**note, "check": check_of(note)}).encode())


def note_path(key: str) -> Path:
    """Return the path of a key's note."""
    return cache_root() / FOLDER / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


def read_note(path: Path) -> Any:
    """Return the content of a note; ValueError for a damaged one."""
    note = json.loads(path.read_bytes())
    if note.pop("check") != check_of(note):
        raise ValueError(f"{path} does not match its own digest")
    return note


def check_of(note: Mapping[str, object]) -> str:
    """Return the digest of a note's content."""
    return hashlib.sha256(canonical_json(note)).hexdigest()


def lost_notes() -> list[Path]:
    """Return the notes that cannot be read, or whose folder is gone."""
    return [path for path in sorted((cache_root() / FOLDER).glob("*.json")) if not is_there(path)]


def is_there(note: Path) -> bool:
    """Return whether the folder in a note still exists."""
    try:
        return Path(read_note(note)["folder"]).is_dir()
    except DAMAGED:
        return False
