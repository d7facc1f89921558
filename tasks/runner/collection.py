"""What of the cache nothing needs any more, and its deletion.

Needed is what somebody names (`Needs`: records and artifacts), what these were made from, and what is young with all
that it was made from, because a program may be about to go on from there.
"""

import uuid
from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from pathlib import Path

from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import DRAFTS, Store
from dcap.scene.store.building import discard, remove
from dcap.scene.store.ref import Ref
from tasks.runner.cache_policy import LOCKS_FOLDER
from tasks.runner.cache_usage import (
    LITTER,
    LITTER_HOURS,
    RECORDS,
    CacheUsage,
    age,
    litter_of,
    record_files,
    size_of,
    usages_of,
)
from tasks.runner.locks import LOCK_SUFFIX, FileLocks
from tasks.runner.records import Record, close_ranks, key_in


@dataclass(frozen=True, slots=True)
class Needs:
    """What somebody still needs, beside what it was made from."""

    keys: frozenset[str]
    """Of records."""
    refs: frozenset[Ref[object]]
    """Of artifacts."""


@dataclass(frozen=True, slots=True)
class Unneeded:
    """What may be deleted."""

    records: tuple[Path, ...]
    artifacts: tuple[Ref[object], ...]
    litter: tuple[Path, ...]
    usage: tuple[CacheUsage, ...]
    """The same by stage."""

    @property
    def count(self) -> int:
        """Number of things."""
        return len(self.records) + len(self.artifacts) + len(self.litter)

    @property
    def size(self) -> int:
        """Bytes that are freed."""
        return sum(row.size for row in self.usage)


def unneeded(store: Store, needs: Needs, older_than_s: float) -> Unneeded:
    """Everything that is neither needed nor younger than an age [s]."""
    known = [(one.path, one.record) for one in record_files() if one.record is not None]
    roots = [record for path, record in known if record.key in needs.keys or age(path) < older_than_s]
    kept = with_makers(roots, needs.refs, [record for _, record in known])
    kept_keys = {record.key for record in kept}
    kept_refs = set(needs.refs).union(*({record.ref} | inputs_of(record) for record in kept))
    gone = [(path, record) for path, record in known if record.key not in kept_keys]
    loose = [ref for ref in store.refs() if ref not in kept_refs and age(store.folder(ref)) >= older_than_s]
    litter = [*litter_of(store, LITTER_HOURS * 3600), *idle_locks(kept_keys)]
    rows = [
        *usages_of(store, [record for _, record in gone], loose),
        CacheUsage(RECORDS, len(gone), 0, sum(size_of(path) for path, _ in gone)),
        CacheUsage(LITTER, 0, 0, sum(size_of(path) for path in litter)),
    ]
    told = tuple(row for row in rows if row.records or row.artifacts or row.size)
    return Unneeded(tuple(path for path, _ in gone), tuple(loose), tuple(litter), told)


def inputs_of(record: Record) -> set[Ref[object]]:
    """The artifacts that a stage was given."""
    inputs = record.deciders.get("inputs")
    trees = inputs.values() if isinstance(inputs, dict) else ()
    given = (tree["ref"] for tree in trees if isinstance(tree, dict) and isinstance(tree.get("ref"), dict))
    return {Ref.from_json(ref) for ref in given}


def with_makers(roots: Iterable[Record], refs: Iterable[Ref[object]], known: Iterable[Record]) -> list[Record]:
    """Records, and those of what they and some artifacts were made from where none of them says so: stages that
    samples share are told of for the first of them only."""
    makers: dict[Ref[object], list[Record]] = defaultdict(list)
    for record in known:
        makers[record.ref].append(record)
    found = list(roots)
    made = {record.ref for record in found}
    waiting = [ref for ref in set(refs).union(*map(inputs_of, found)) if ref not in made]
    while waiting:
        ref = waiting.pop()
        if ref not in made:
            made.add(ref)
            found += makers[ref]
            waiting += [one for record in makers[ref] for one in inputs_of(record)]
    return found


def idle_locks(kept: Collection[str]) -> list[Path]:
    """Old files of locks that nobody holds, of records that are not kept: empty, but they add up."""
    folder = cache_root() / LOCKS_FOLDER
    paths = sorted(folder.glob(f"*{LOCK_SUFFIX}")) if folder.is_dir() else []
    locks = FileLocks(folder)
    old = [(path, path.name.removesuffix(LOCK_SUFFIX)) for path in paths if age(path) >= LITTER_HOURS * 3600]
    return [path for path, name in old if key_in(name) not in kept and not locks.is_locked(name)]


def collect(store: Store, what: Unneeded) -> None:
    """Delete it; an artifact vanishes as a whole. Nobody else may use the cache meanwhile (`used_alone`)."""
    drafts = store.root / DRAFTS
    drafts.mkdir(parents=True, exist_ok=True)
    for path in (*what.records, *what.litter):
        remove(path)
    for ref in what.artifacts:
        discard(store.folder(ref), drafts / uuid.uuid4().hex)
    close_ranks()
