"""Digests of artifacts: SHA-256 over the names and bytes of all files, so that standard tools can check them.

What cannot be part of an artifact (a link, a pipe, an empty folder) leaves its folder without a digest.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path


def digest_of(digests: Mapping[str, str]) -> str:
    """SHA-256 over lines `DIGEST  NAME` in the order of the names, as `sha256sum` prints them."""
    lines = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.sha256(lines.encode(errors="surrogateescape")).hexdigest()  # a damaged name is no text


def digest_of_bytes(files: Mapping[str, bytes]) -> str:
    """Digest of an artifact whose files are in memory."""
    return digest_of({name: hashlib.sha256(data).hexdigest() for name, data in files.items()})


def digest_of_file(path: Path) -> str:
    """SHA-256 of one file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_of_folder(folder: Path) -> str:
    """Digest of an artifact's folder; empty if it cannot be read, is a link, or holds what is no file."""
    try:
        files = walk(folder)
        if folder.is_symlink() or not all(is_plain_file(path) for path in files):  # a pipe would be read for ever
            return ""
        return digest_of({str(path.relative_to(folder)): digest_of_file(path) for path in files})
    except OSError:
        return ""


def stamps(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, size and modification time of every file; empty if there is none."""
    try:
        status = [(str(path), path.lstat()) for path in walk(folder)]
    except OSError:
        return ()
    return tuple((name, one.st_size, one.st_mtime_ns) for name, one in status)


def walk(folder: Path) -> list[Path]:
    """All files and links below a folder, sorted; and empty folders, which no artifact has and no digest survives."""
    return sorted(path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir() or is_empty(path))


def is_empty(folder: Path) -> bool:
    """Whether nothing lies in a folder."""
    return not any(folder.iterdir())


def is_plain_file(path: Path) -> bool:
    """Whether it is a file and no link to one: what a link leads to may change without us."""
    return path.is_file() and not path.is_symlink()
