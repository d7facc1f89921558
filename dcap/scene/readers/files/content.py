"""The bytes of a file, or one line that says why there are none."""

from pathlib import Path

from dcap.scene.errors import FormatError, InputError

MAX_FILE_BYTES = 4 * 1024**3
"""Largest file that is opened at all [bytes]."""


def read_bytes(path: Path, most: int = -1) -> bytes:
    """The whole file, or its first bytes; a missing, empty or absurdly large one is refused with one line."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    size = path.stat().st_size
    if size == 0:
        raise FormatError(f"{path}: the file is empty")
    if size > MAX_FILE_BYTES:
        raise InputError(
            f"{path}: {size / 1024**3:.1f} GiB > {MAX_FILE_BYTES / 1024**3:.0f} GiB; decimate the mesh first"
        )
    with path.open("rb") as stream:
        return stream.read(most)
