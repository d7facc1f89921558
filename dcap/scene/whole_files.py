"""Files that appear whole or not at all: what was there stays where a disk is full or the program is killed."""

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

NEW_FILE = 0o666
"""Rights of a new file, but for those that the user's mask takes away."""


@contextmanager
def whole_file(path: Path, mode: int = NEW_FILE) -> Iterator[Path]:
    """An empty file beside `path`, of the same suffix, that takes its place once the block has written it; OSError
    names `path`. What is no file, as a pipe, is written itself; of a link, what it leads to."""
    path = path.resolve()
    if path.exists() and not path.is_file():
        yield path
        return
    draft = path.with_name(f".{secrets.token_hex(4)}{path.suffix}")
    try:
        os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode))
        try:
            yield draft
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(draft), draft):
            raise  # of another file that the block reads, or of what a library has to say
        raise OSError(error.errno, error.strerror, str(path)) from error


def write_whole(path: Path, data: bytes, mode: int = NEW_FILE) -> None:
    """Write a file beside its place and move it there; OSError names the file."""
    with whole_file(path, mode) as draft:
        draft.write_bytes(data)
