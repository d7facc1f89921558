"""Files of results that were made before: copied from where they lie instead of being made again.

What decides the files is their key. A note in the cache says in which folder they were written last, and the digest of
each. What was moved, deleted or edited there is not whole any more, and they are made anew; so a note that is lost or
damaged costs time alone.
"""

import hashlib
import json
import shutil
import uuid
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dcap.scene.settings import cache_root
from dcap.scene.store.building import free_place, make_folder
from dcap.scene.store.digest import digest_of_file, is_plain_file
from dcap.scene.whole_files import write_whole

FOLDER = "earlier"
CHECK = "check"
"""Key of a note under which the digest of all else in it stands: nothing but that binds the files to what they are."""
DAMAGED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""What reading a note raises that is damaged."""


def copy_earlier(key: str, folder: Path) -> dict[str, str]:
    """Copy the files of a key into a folder; their names there by what they are, nothing where they are not all there
    and whole."""
    try:
        path = note_of(key)
        note = read_note(path)
        if note["key"] != path.stem:  # another's, moved or copied here
            return {}
        files = {str(what): str(name) for what, name in note["files"].items()}
        if any(Path(name).is_absolute() or ".." in Path(name).parts for name in files.values()):
            return {}
        for name in files.values():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(Path(note["folder"], name), folder / name)
            if digest_of_file(folder / name) != note["sha256"][name]:
                return {}
    except DAMAGED:
        return {}
    return files


def note_files(key: str, folder: Path, files: Mapping[str, str]) -> None:
    """Note where the files of a key have been written: their names in the folder by what they are."""
    digests = {name: digest_of_file(folder / name) for name in files.values()}
    path = note_of(key)
    tree = {"key": path.stem, "folder": str(folder.resolve()), "files": dict(files), "sha256": digests}
    note = {**tree, CHECK: check_of(tree)}
    make_folder(path.parent, path.parent.with_name(f"{FOLDER}-{uuid.uuid4().hex}"))
    free_place(path)
    write_whole(path, json.dumps(note).encode())


def note_of(key: str) -> Path:
    """Where the note of a key lies."""
    return cache_root() / FOLDER / f"{hashlib.sha256(key.encode()).hexdigest()}.json"


def read_note(path: Path) -> Any:
    """What a note says; ValueError for one that is damaged, and for what is no file: of a pipe, reading would not
    end."""
    if not is_plain_file(path):
        raise ValueError(f"{path} is no plain file")
    note = json.loads(path.read_bytes())
    if note[CHECK] != check_of({name: one for name, one in note.items() if name != CHECK}):
        raise ValueError(f"{path} does not match its own digest")
    return note


def check_of(tree: Mapping[str, object]) -> str:
    """Digest of what a note says."""
    return hashlib.sha256(json.dumps(tree, sort_keys=True).encode()).hexdigest()


def lost_notes() -> list[Path]:
    """Notes that cannot be read, or whose folder is gone."""
    folder = cache_root() / FOLDER
    return [path for path in sorted(folder.glob("*.json")) if not is_there(path)] if folder.is_dir() else []


def is_there(note: Path) -> bool:
    """Whether the folder that a note names is still there."""
    try:
        return Path(read_note(note)["folder"]).is_dir()
    except DAMAGED:
        return False
