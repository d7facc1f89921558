"""Earlier results of stages: recipes, records of their results, and the locks that stages hold while they compute.

A recipe holds everything that decides a result; its digest is the key. A record lies at `records/KEY` as Prefect's
result file, written by Prefect or by a run without a server. A record counts only if it is complete, has the right key,
and its artifact is sound. If not, the next name is used (KEY, KEY-r1, ...), so nothing is ever deleted, only repaired
from a shared store; and Prefect never reads a file that names another serializer, such as `pickle`.
"""

import fcntl
import hashlib
import json
import os
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from dcap.scene.errors import StoreError
from dcap.scene.settings import cache_root
from dcap.scene.written_files import canonical_json
from tasks.artifact import DRAFTS, Record, Ref, Store
from tasks.code import installed_version

FOLDER = "records"
MOST_REPEATS = 1000
ENCODER, DECODER = "tasks.records.encode_ref", "tasks.records.decode_ref"
SERIALIZER = {
    "type": "json",
    "jsonlib": "json",
    "object_encoder": ENCODER,
    "object_decoder": DECODER,
    "dumps_kwargs": {},
    "loads_kwargs": {},
}
"""Prefect's serializer of our records, named in each file."""
DAMAGED = (OSError, ValueError, KeyError, TypeError, RecursionError)
"""Errors of reading a damaged record."""


def key_of(recipe: Mapping[str, Any]) -> str:
    """Return the name of the record of a recipe, which begins with readable text."""
    return f"{recipe['stage']}-{hashlib.sha256(canonical_json(recipe)).hexdigest()[:40]}"


def records_root() -> Path:
    """Return the folder of all records."""
    return cache_root() / FOLDER


def find_record(
    key: str, *, bring: bool = True, wait: Callable[[str], object] | None = None
) -> tuple[str, Ref[Any] | None]:
    """Return the first name that is free or has a usable record, and the result of that record.

    A record that is missing or damaged here is looked up in the shared store; with `bring` it and its artifact are
    copied here. `wait` waits while another program holds the lock of a name, since Prefect writes records in place.
    """
    for repeat in range(MOST_REPEATS):
        name = key if repeat == 0 else f"{key}-r{repeat}"
        path = records_root() / name
        ref = usable_result(path, key, bring=bring)
        if ref is None and wait is not None and os.path.lexists(path):
            wait(name)
            ref = usable_result(path, key, bring=bring)
        taken = os.path.lexists(path)
        if ref is None:
            found, ref = _shared_result(name, key, bring=bring)
            taken |= found
        if ref is not None or not taken:
            return name, ref
    raise StoreError(f"{key}: {MOST_REPEATS} records are damaged; `dcap cache verify --repair` removes them")


def usable_result(path: Path, key: str, *, bring: bool = True) -> Ref[Any] | None:
    """Return the result that a record names; None if there is no record, or if the record or its artifact is
    damaged."""
    try:
        return _usable(path.read_bytes(), key, bring=bring)
    except OSError:
        return None


def _usable(data: bytes, key: str, *, bring: bool) -> Ref[Any] | None:
    try:
        ref = parsed_record(data)
        assert ref.record is not None
        sound = ref.record.key == key == key_of(ref.record.recipe)
    except DAMAGED:
        return None
    return ref if sound and Store.default().has(ref, bring=bring) else None


def parsed_record(data: bytes) -> Ref[Any]:
    """Return the result that a record's bytes name; raises one of DAMAGED if they are not a complete record of ours."""
    tree = json.loads(data)
    if tree["metadata"]["serializer"] != SERIALIZER or tree["metadata"]["expiration"] is not None:
        raise ValueError("not written by us")
    ref = json.loads(tree["result"], object_hook=decode_ref)
    if not isinstance(ref, Ref):
        raise TypeError("no reference")
    return ref


def write_record(name: str, ref: Ref[Any]) -> None:
    """Write the record of a result like Prefect, atomically."""
    metadata = {
        "storage_key": str(records_root() / name),
        "expiration": None,
        "serializer": SERIALIZER,
        "prefect_version": installed_version("prefect"),
        "storage_block_id": None,
    }
    draft = Store.default().root / DRAFTS / f"record-{uuid.uuid4().hex}"
    for folder in (draft.parent, records_root()):
        folder.mkdir(parents=True, exist_ok=True)
    draft.write_bytes(json.dumps({"metadata": metadata, "result": json.dumps(ref, default=encode_ref)}).encode())
    os.replace(draft, records_root() / name)


def share_record(name: str, ref: Ref[Any], *, new: bool) -> None:
    """Write a record that lies here into the shared store, if there is one; a record of an earlier run only if the
    shared store has none of that name, and together with its artifact."""
    shared, path = Store.default().shared, records_root() / name
    if shared is None or not path.is_file():
        return
    if not new:
        if name in shared.names(FOLDER):
            return
        Store.default().share(ref)
    shared.push(f"{FOLDER}/{name}", path)


def _shared_result(name: str, key: str, *, bring: bool) -> tuple[bool, Ref[Any] | None]:
    """Return whether the shared store has a record, and the result that it names; with `bring` the result is copied
    here."""
    shared = Store.default().shared
    data = None if shared is None else shared.read(f"{FOLDER}/{name}")
    if data is None:
        return False, None
    ref = _usable(data, key, bring=bring)
    if ref is not None and bring:
        records_root().mkdir(parents=True, exist_ok=True)
        draft = records_root() / f".{name}-{uuid.uuid4().hex}"
        draft.write_bytes(data)
        os.replace(draft, records_root() / name)
    return True, ref


def encode_ref(ref: object) -> dict[str, Any]:
    """Return a result as JSON with a digest over everything: only the digest ties the artifact to the key."""
    if not isinstance(ref, Ref) or ref.record is None:
        raise TypeError(f"a {type(ref).__name__} is not a result of a stage")
    record = ref.record
    tree = {"ref": ref.to_json(), "key": record.key, "seconds": record.seconds, "size": record.size}
    tree["recipe"] = dict(record.recipe)
    return {"artifact": tree, "check": hashlib.sha256(canonical_json(tree)).hexdigest()}


def decode_ref(tree: dict[str, Any]) -> object:
    """Return the result that `encode_ref` wrote; raises ValueError if its digest is wrong. Other objects stay
    unchanged."""
    if tree.keys() != {"artifact", "check"}:
        return tree
    inner = tree["artifact"]
    if hashlib.sha256(canonical_json(inner)).hexdigest() != tree["check"]:
        raise ValueError("the record does not match its digest")
    record = Record(inner["key"], inner["seconds"], inner["size"], inner["recipe"])
    return Ref(inner["ref"]["kind"], inner["ref"]["sha256"], record)


def every_record() -> Iterator[tuple[Path, Ref[Any] | None]]:
    """Yield the file of every record, sorted, with its result, or None for a damaged record."""
    root = records_root()
    for path in sorted(root.iterdir()) if root.is_dir() else ():
        written = modified_ns(path)
        if written is not None:
            yield path, _read_once(path, written)


def refs_in(recipe: Mapping[str, Any]) -> list[Ref[Any]]:
    """Return the artifacts among a stage's inputs."""
    return [Ref.from_json(one["ref"]) for one in recipe["inputs"].values() if "ref" in one]


def records_behind(refs: Iterable[Ref[Any]]) -> Iterator[tuple[Path, Ref[Any]]]:
    """Yield every known record of these artifacts, and of the artifacts from which they were made."""
    makers: dict[Ref[Any], list[tuple[Path, Ref[Any]]]] = {}
    for path, ref in every_record():
        if ref is not None:
            makers.setdefault(ref, []).append((path, ref))
    seen, waiting = set[Ref[Any]](), list(refs)
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen.add(one)
            for path, ref in makers.get(one, []):
                assert ref.record is not None
                yield path, ref
                waiting += refs_in(ref.record.recipe)


def modified_ns(path: Path) -> int | None:
    """Return the modification time of a file or folder; None if it is missing, as it may just have been deleted."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return None


@cache
def _read_once(path: Path, modified_ns: int) -> Ref[Any] | None:
    try:
        return parsed_record(path.read_bytes())
    except DAMAGED:
        return None


class FileLocks:
    """Exclusive locks by `flock(2)` for threads and processes of one machine: the kernel releases the locks of a killed
    process. The methods are those of Prefect's LockManager, which sets no timeouts here."""

    _held: ClassVar[dict[str, tuple[str, int]]] = {}

    def acquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """Wait for a lock."""
        if not self.is_lock_holder(key, holder):
            lock = self._open(key)
            fcntl.flock(lock, fcntl.LOCK_EX)
            self._held[key] = (holder, lock)
        return True

    async def aacquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """Wait for a lock."""
        return self.acquire_lock(key, holder)

    def release_lock(self, key: str, holder: str) -> None:
        """Release a lock that the holder holds."""
        if self.is_lock_holder(key, holder):
            os.close(self._held.pop(key)[1])

    def is_locked(self, key: str) -> bool:
        """Return whether anybody holds a lock."""
        lock = self._open(key)
        try:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(lock)
        return False

    def is_lock_holder(self, key: str, holder: str) -> bool:
        """Return whether this holder in this process holds a lock."""
        return self._held.get(key, ("", -1))[0] == holder

    def wait_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until nobody holds a lock."""
        lock = self._open(key)
        fcntl.flock(lock, fcntl.LOCK_SH)
        os.close(lock)
        return True

    async def await_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until nobody holds a lock."""
        return self.wait_for_lock(key)

    @contextmanager
    def held(self, key: str) -> Iterator[None]:
        """Hold a lock inside the block."""
        holder = str(threading.get_ident())
        self.acquire_lock(key, holder)
        try:
            yield
        finally:
            self.release_lock(key, holder)

    def _open(self, key: str) -> int:
        path = cache_root() / "locks" / f"{Path(key).name}.lock"
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
