"""Lists contents, damage and unneeded artifacts of the cache, and explains why a stage would run."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from dcap.scene.settings import cache_root
from dcap.scene.text import first_of
from dcap.scene.writers.placed_scene import lost_notes
from tasks.artifact import DRAFTS, Record, Ref, Source, Store, files_in, remove
from tasks.code import files_behind
from tasks.records import every_record, key_of, modified_ns, records_behind, records_root, refs_in

SOURCES, UNRECORDED, RECORDS, LITTER = "source files", "without a record", "records", "litter"
"""Rows in addition to those of stages."""
LITTER_HOURS = 6.0
"""Age at which drafts count as left behind by a killed program: no stage takes that long [h]."""
ABSENT = "absent"
DAMAGED = "its result is missing or damaged"
SHOWN = 3
"""Maximum number of settings, files or libraries named in a line."""
LONGEST = 60
"""Maximum length of a value in a line [characters]."""
KeyOf = Callable[[str, str], str]
"""Maps a stage and its own name for a setting to the name that people know."""


@dataclass(frozen=True, slots=True)
class CacheUsage:
    """Usage of the cache by a stage."""

    stage: str
    records: int = 0
    artifacts: int = 0
    """Number of artifacts, excluding those also made by an earlier stage in the list."""
    size: int = 0
    """Bytes of these artifacts."""
    seconds: float = 0.0
    """Time of computing them [s]."""


@dataclass(frozen=True, slots=True)
class Unneeded:
    """Records and artifacts that may be deleted."""

    records: tuple[Path, ...]
    artifacts: tuple[Ref[Any], ...]
    litter: tuple[Path, ...]
    usage: tuple[CacheUsage, ...]
    """Usage by stage."""

    @property
    def count(self) -> int:
        """Number of artifacts and records."""
        return len(self.records) + len(self.artifacts) + len(self.litter)

    @property
    def size(self) -> int:
        """Freed space [bytes]."""
        return sum(row.size for row in self.usage)


@dataclass(frozen=True, slots=True)
class Damage:
    """A damaged record or artifact."""

    path: Path
    why: str
    ref: Ref[Any] | None = None
    """The damaged artifact; None for a record."""


def usages() -> list[CacheUsage]:
    """Return the usage by each stage, then by artifacts without a stage, by records and by litter."""
    store, found = Store.default(), [(path, ref) for path, ref in every_record() if ref is not None]
    records = CacheUsage(RECORDS, len(found), 0, sum(size_of(path) for path, _ in found))
    litter = CacheUsage(LITTER, 0, 0, sum(size_of(path) for path in litter_in(store, 0.0)))
    return [*usage_by_stage([ref for _, ref in found], store.refs()), records, litter]


def usage_by_stage(made: Iterable[Ref[Any]], refs: Iterable[Ref[Any]]) -> list[CacheUsage]:
    """Return a row for each stage that made some of the artifacts `refs`; each artifact counts once."""
    store, left, stages = Store.default(), set(refs), dict[str, list[Ref[Any]]]()
    for ref in made:
        assert ref.record is not None
        stages.setdefault(ref.record.recipe["stage"], []).append(ref)
    rows = []
    for stage, results in sorted(stages.items()):
        own = left & set(results)
        left -= own
        seconds = sum(one.record.seconds for one in results if one.record)
        size = sum(size_of(store.folder(ref)) for ref in own)
        rows.append(CacheUsage(stage, len(results), len(own), size, seconds))
    for name, some in (
        (SOURCES, [ref for ref in left if ref.kind == Source.__name__]),
        (UNRECORDED, [ref for ref in left if ref.kind != Source.__name__]),
    ):
        rows.append(CacheUsage(name, 0, len(some), sum(size_of(store.folder(ref)) for ref in some)))
    return rows


def unneeded(needed: Iterable[Ref[Any]], older_than_s: float) -> Unneeded:
    """Return everything but needed results, results younger than `older_than_s`, and the inputs of both."""
    store, known = Store.default(), list(every_record())
    young = [ref for path, ref in known if ref is not None and age(path) < older_than_s]
    kept_paths, kept_refs = set[Path](), {*needed, *young}
    for path, ref in records_behind(list(kept_refs)):
        assert ref.record is not None
        kept_paths.add(path)
        kept_refs |= {ref, *refs_in(ref.record.recipe)}
    gone = [(path, ref) for path, ref in known if path not in kept_paths and age(path) >= older_than_s]
    loose = [ref for ref in store.refs() if ref not in kept_refs and age(store.folder(ref)) >= older_than_s]
    locks = [path for path in (cache_root() / "locks").glob("*.lock") if age(path) >= LITTER_HOURS * 3600.0]
    litter = [*litter_in(store, LITTER_HOURS * 3600.0), *locks]  # locks are empty, but accumulate
    rows = [
        *usage_by_stage([ref for _, ref in gone if ref is not None], loose),
        CacheUsage(RECORDS, len(gone), 0, sum(size_of(path) for path, _ in gone)),
        CacheUsage(LITTER, 0, 0, sum(map(size_of, litter))),
    ]
    shown = tuple(row for row in rows if row.records or row.artifacts or row.size)
    return Unneeded(tuple(path for path, _ in gone), tuple(loose), tuple(litter), shown)


def delete(what: Unneeded) -> None:
    """Delete records and artifacts. No other program may use the cache meanwhile (`exclusive_use`)."""
    for path in (*what.records, *what.litter):
        remove(path)
    for ref in what.artifacts:
        Store.default().discard(ref)


def damages() -> list[Damage]:
    """Read every record and artifact, and return the damaged ones."""
    store = Store.default()
    found = [
        Damage(store.folder(ref), "it does not match its digest", ref) for ref in store.refs() if not store.is_here(ref)
    ]
    for path, ref in every_record():
        if ref is None or ref.record is None:
            found.append(Damage(path, "it is incomplete, or of an earlier version"))
        elif key_of(ref.record.recipe) != ref.record.key or not path.name.startswith(ref.record.key):
            found.append(Damage(path, f"it is the record of {ref.record.key}"))
        elif not store.has(ref):
            found.append(Damage(path, "its artifact is missing or damaged"))
    return found


def repair(found: Sequence[Damage]) -> None:
    """Delete damaged records and artifacts; they are computed again when needed.

    A later record (KEY-r1) takes the name of a deleted first record, because a lookup stops at a missing name.
    """
    for one in found:
        if one.ref is None:
            remove(one.path)
        else:
            Store.default().discard(one.ref)
    for path, ref in list(every_record()):
        if ref is not None and ref.record is not None and not (first := path.with_name(ref.record.key)).exists():
            path.rename(first)


def litter_in(store: Store, older_than_s: float) -> list[Path]:
    """Return drafts, and notes on deleted files, at least `older_than_s` old."""
    drafts = store.root / DRAFTS
    left = [*drafts.glob("*"), *cache_root().glob(".writing-*"), *lost_notes()]
    return sorted(path for path in left if age(path) >= older_than_s)


def size_of(path: Path) -> int:
    """Return the bytes of a file, or of all files below a folder; files deleted meanwhile count 0."""
    try:
        return sum(one.stat().st_size for one in files_in(path)) if path.is_dir() else path.stat().st_size
    except OSError:
        return 0


def age(path: Path) -> float:
    """Return the time since a file was written [s]; 0 if it no longer exists."""
    try:
        return max(time.time() - path.lstat().st_mtime, 0.0)
    except OSError:
        return 0.0


def why_not_cached(recipe: Mapping[str, Any], key_of_setting: KeyOf) -> str:
    """Return the differences between a recipe and the closest earlier one: input, setting, code, data file, library."""
    if (records_root() / key_of(recipe)).exists():
        return DAMAGED
    record = closest_record(recipe)
    if record is None:
        return "no earlier result"
    old = record.recipe
    parts = [
        *changed_inputs(old, recipe),
        *named("", changed_values(old["config"], recipe["config"]), lambda key: key_of_setting(recipe["stage"], key)),
        *changed_code(old, recipe),
        *named("library ", changed_values(old["libraries"], recipe["libraries"])),
    ]
    return "; ".join(parts) or DAMAGED


def closest_record(recipe: Mapping[str, Any]) -> Record | None:
    """Return the record of the same stage that has most in common with a recipe; the newest wins a tie.

    Plain inputs (the sentence, a seed, a mass) identify the sample, so they count first.
    """

    def likeness(record: Record) -> tuple[int, int, int]:
        old = record.recipe
        same = [name for name, value in recipe["inputs"].items() if old["inputs"].get(name) == value]
        plain = sum("ref" not in recipe["inputs"][name] for name in same)
        return plain, len(same), sum(old[part] == recipe[part] for part in ("config", "code", "libraries"))

    records = _records_by_stage(records_root(), modified_ns(records_root())).get(recipe["stage"], [])
    return max(records, key=likeness, default=None)


def changed_inputs(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Yield the inputs that differ: an artifact by its name, a value with its old value."""
    for name in sorted(new["inputs"].keys() | old["inputs"].keys()):
        before, now = old["inputs"].get(name, {}), new["inputs"].get(name, {})
        if before == now:
            continue
        if "ref" in before or "ref" in now:
            yield f"input {name} differs"
        else:
            yield from named("input ", changed_values({name: before.get("value")}, {name: now.get("value")}))


def changed_code(old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[str]:
    """Yield the source and data files that differ."""
    if old["code"] == new["code"]:
        return
    before, now = files_behind(old["code"]), files_behind(new["code"])
    if before is None or now is None:
        yield "code has changed"
        return
    files = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    if some := [name for name in files if name.endswith(".py")]:
        yield f"code {first_of(some, SHOWN)}"
    if some := [name for name in files if not name.endswith(".py")]:
        yield f"data file {first_of(some, SHOWN)}"


def changed_values(old: Any, new: Any) -> dict[str, tuple[object, object]]:
    """Return the values that differ between two trees, by dotted key."""
    before, now = dict(flattened(old)), dict(flattened(new))
    keys = dict.fromkeys((*now, *before))
    pairs = {key: (before.get(key, ABSENT), now.get(key, ABSENT)) for key in keys}
    return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


def named(
    kind: str, changes: Mapping[str, tuple[object, object]], name_of: Callable[[str], str] = lambda key: key
) -> Iterator[str]:
    """Yield the first changes in words, and the number of remaining changes."""

    def short(value: object) -> str:
        text = str(value)
        return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"

    words = [f"{name_of(key)} {short(old)} -> {short(new)}" for key, (old, new) in changes.items()]
    if words:
        yield kind + first_of(words, SHOWN)


def flattened(tree: Any, prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield the leaves of a tree by dotted key."""
    if isinstance(tree, Mapping) and tree:
        for key, value in tree.items():
            yield from flattened(value, f"{prefix}.{key}" if prefix else str(key))
    elif prefix:
        yield prefix, tree


@lru_cache(maxsize=1)
def _records_by_stage(root: Path, changed_ns: int | None) -> dict[str, list[Record]]:
    """Return all records by stage, newest first; read again after a record was added or removed."""
    found: dict[str, list[tuple[int, Record]]] = {}
    for path, ref in every_record():
        if ref is not None and ref.record is not None:
            found.setdefault(ref.record.recipe["stage"], []).append((modified_ns(path) or 0, ref.record))
    return {stage: [record for _, record in sorted(some, key=lambda one: -one[0])] for stage, some in found.items()}
