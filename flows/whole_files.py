"""A file that appears whole or not at all: what was there stays where a disk is full or the program is killed."""

import os
import tempfile
from pathlib import Path


def write_whole(path: Path, data: bytes) -> None:
    """Write a file beside its place and move it there; OSError names the file."""
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as draft:
            (Path(draft) / path.name).write_bytes(data)
            os.replace(Path(draft) / path.name, path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
