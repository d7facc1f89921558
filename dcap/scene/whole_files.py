"""Files that appear whole or not at all: what was there stays where a disk is full or the program is killed."""

import errno
import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT)
"""Errors of a full disk."""
NEW_FILE = 0o666
"""Rights of a new file, but for those that the user's mask takes away."""
DRAFTS = ".writing-"
"""How the names of folders begin in which files are written: nobody who lists pictures or tables finds half of one."""


@contextmanager
def whole_file(path: Path, mode: int = NEW_FILE) -> Iterator[Path]:
    """An empty file in a folder beside `path`, of the same name, that takes its place once the block has written it;
    OSError names `path`. What is no file, as a pipe, is written itself; of a link, what it leads to."""
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
            raise  # of another file that the block reads, or of what a library has to say
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def draft_folder(folder: Path) -> Iterator[Path]:
    """A folder inside of `folder`, which is made, for files that the block writes and then moves there. OSError of a
    full disk names `folder`: the system does not name a file that is open."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=DRAFTS) as draft:
            yield Path(draft)
    except OSError as error:
        if error.errno in FULL and error.filename is None:
            error.filename = str(folder)
        raise


def write_whole(path: Path, data: bytes, mode: int = NEW_FILE) -> None:
    """Write a file beside its place and move it there; OSError names the file."""
    with whole_file(path, mode) as draft:
        draft.write_bytes(data)


def digest_of_file(path: Path) -> str:
    """SHA-256 of one file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
