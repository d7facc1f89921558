"""Which records of finished stages a data folder keeps, and whether one was computed again."""

from pathlib import Path

from dcap.scene.written_files import DRAFTS

Stamp = tuple[int, int]


def kept_records(data: Path) -> dict[str, Stamp]:
    """When each record was written, and as which file: one that is computed again is another."""
    found = {}
    folder = data / "cache" / "records"
    for path in folder.iterdir() if folder.is_dir() else ():
        if not path.name.startswith(DRAFTS):
            one = path.stat()
            found[path.name] = (one.st_mtime_ns, one.st_ino)
    return found
