"""What the cache holds, by the stage that made it."""

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import DRAFTS, Source, Store
from dcap.scene.store.earlier_files import lost_notes
from dcap.scene.store.ref import Ref
from dcap.scene.whole_files import DRAFTS as DRAFTS_OF_FILES
from tasks.runner.records import Record, key_in, record_in, records_root

SOURCES, UNRECORDED, RECORDS, LITTER = "source files", "without a record", "records", "litter"
"""Rows beside those of stages."""
LITTER_HOURS = 6.0
"""Age at which what is half-made counts as left behind by a killed program: no stage takes that long [h]."""
DAMAGED_FOLDER = "damaged"
"""Where a repair moves what is damaged, below the folder of the cache."""


@dataclass(frozen=True, slots=True)
class RecordFile:
    """A file among the records."""

    path: Path
    record: Record | None
    problem: str
    """Why it is no record; empty if it is one."""


@dataclass(frozen=True, slots=True)
class CacheUsage:
    """What a stage has in the cache."""

    stage: str
    records: int = 0
    artifacts: int = 0
    """Those that no stage before it in the list made as well."""
    size: int = 0
    """Bytes of these artifacts."""
    seconds: float = 0.0
    """What computing them took [s]."""


def record_files() -> Iterator[RecordFile]:
    """Everything among the records, sorted."""
    root = records_root()
    for path in sorted(root.iterdir()) if root.is_dir() else ():
        try:
            record = record_in(path)
        except FileNotFoundError:  # of a program that ended meanwhile
            continue
        except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
            yield RecordFile(path, None, f"{type(error).__name__}: {error}")
            continue
        own = record.decides(key_in(path.name))
        yield RecordFile(path, record if own else None, "" if own else f"the record of {record.key}")


def usages(store: Store) -> list[CacheUsage]:
    """What each stage has in the cache, then what no stage made, the records and litter; each artifact counts once."""
    sound = [(one.path, one.record) for one in record_files() if one.record is not None]
    return [
        *usages_of(store, [record for _, record in sound], store.refs()),
        CacheUsage(RECORDS, len(sound), 0, sum(size_of(path) for path, _ in sound)),
        CacheUsage(LITTER, 0, 0, sum(size_of(path) for path in litter_of(store, 0.0))),
    ]


def usages_of(store: Store, records: Iterable[Record], refs: Iterable[Ref[object]]) -> list[CacheUsage]:
    """Some records and some artifacts by stage."""
    by_stage: dict[str, list[Record]] = defaultdict(list)
    for record in records:
        by_stage[str(record.deciders.get("stage"))].append(record)
    left = set(refs)
    rows = []
    for stage, made in sorted(by_stage.items()):
        own = left & {record.ref for record in made}
        left -= own
        rows.append(CacheUsage(stage, len(made), len(own), sizes(store, own), sum(record.seconds for record in made)))
    sources = {ref for ref in left if ref.kind == Source.__name__}
    others = left - sources
    return [
        *rows,
        CacheUsage(SOURCES, 0, len(sources), sizes(store, sources)),
        CacheUsage(UNRECORDED, 0, len(others), sizes(store, others)),
    ]


def litter_of(store: Store, older_than_s: float) -> list[Path]:
    """What is half-made, is no record, was moved away by a repair, or tells of files that have gone, of at least an age
    [s]."""
    folders = (store.root / DRAFTS, cache_root() / DAMAGED_FOLDER)
    left = [path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())]
    left += sorted(cache_root().glob(f"{DRAFTS_OF_FILES}*"))
    no_records = [one.path for one in record_files() if one.record is None]
    return [path for path in (*left, *no_records, *lost_notes()) if age(path) >= older_than_s]


def sizes(store: Store, refs: Iterable[Ref[object]]) -> int:
    """Bytes of some artifacts."""
    return sum(size_of(store.folder(ref)) for ref in refs)


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files below a folder; links are not followed, and what vanishes has none."""
    try:
        if path.is_symlink() or not path.is_dir():
            return path.lstat().st_size
        return sum(size_of(inner) for inner in path.iterdir())
    except OSError:
        return 0


def age(path: Path) -> float:
    """Time since something was written [s]; of what is gone none."""
    try:
        return max(time.time() - path.lstat().st_mtime, 0.0)
    except OSError:
        return 0.0
