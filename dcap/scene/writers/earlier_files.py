"""Files of results that were made before: copied from where they lie instead of being made again.

What decides the files is their key. A note in the cache says in which folder they were written last, and the digest of
each. What was moved, deleted or edited there is made anew; so a note that is lost or damaged costs time alone.
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
"""What reading a damaged note raises."""


def copy_earlier(key: str, folder: Path) -> dict[str, str]:
    """Copy the files of a key into a folder.

    Returns their names there by what they are; nothing where they are not all there and whole.
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
    """Note where the files of a key have been written: their names in the folder by what they are."""
    digests = {name: digest_of_file(folder / name) for name in files.values()}
    note = {"folder": str(folder.resolve()), "files": dict(files), "sha256": digests}
    path = note_path(key)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, json.dumps({**note, "check": check_of(note)}).encode())


def note_path(key: str) -> Path:
    """Return where the note of a key lies."""
    return cache_root() / FOLDER / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


def read_note(path: Path) -> Any:
    """Return what a note says; ValueError for a damaged one."""
    note = json.loads(path.read_bytes())
    if note.pop("check") != check_of(note):
        raise ValueError(f"{path} does not match its own digest")
    return note


def check_of(note: Mapping[str, object]) -> str:
    """Return the digest of what a note says."""
    return hashlib.sha256(canonical_json(note)).hexdigest()


def lost_notes() -> list[Path]:
    """Return the notes that cannot be read, or whose folder is gone."""
    return [path for path in sorted((cache_root() / FOLDER).glob("*.json")) if not is_there(path)]


def is_there(note: Path) -> bool:
    """Return whether the folder that a note names is still there."""
    try:
        return Path(read_note(note)["folder"]).is_dir()
    except DAMAGED:
        return False
