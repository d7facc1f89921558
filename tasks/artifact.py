"""Artifacts: values and foreign files, named by the digest of their content.

An artifact is a folder `objects/KIND/aa/SHA256` of plain files (codec.py); its digest covers the names and bytes of all
of them. Guaranteed: an artifact appears whole or not at all (written as a draft, then renamed), equal values get the
same digest and the same bytes, and `load` returns only what was read from bytes that match the digest.

With `$DCAP_STORE` the local folder is a cache in front of a store that machines share (shared_store.py): artifacts
saved here are written there as well; artifacts missing or damaged here are searched there.
"""

import errno
import fcntl
import hashlib
import json
import os
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Generic, TypeVar, cast

from dcap.scene.errors import InputError, MissingArtifactError, StoreError
from dcap.scene.readers.source_files import source_files, telling_folder
from dcap.scene.settings import cache_root, shared_store_url
from dcap.scene.types.outcome import Infeasible
from dcap.scene.written_files import canonical_json, digest_of_file
from tasks.codec import VALUE_FILE, decode, encode
from tasks.shared_store import SharedStore

ValueT = TypeVar("ValueT")
ValueT_co = TypeVar("ValueT_co", covariant=True)
OBJECTS, DRAFTS, FILES = "objects", "building", "files"
"""Folders of the artifacts, of drafts being written, and of the foreign files inside of a `Source`."""
OCCUPIED = (errno.ENOTEMPTY, errno.EEXIST, errno.ENOTDIR)
"""Error codes of renaming a folder onto an existing one."""
USED = "in-use.lock"
"""File that each program holds a shared lock on while it uses the cache; deleting needs the exclusive one."""


class Ref(Generic[ValueT_co]):
    """Name of an artifact, passed between stages instead of the value.

    `Ref[Intent]` names an Intent, or the Infeasible that says why there is none, or nothing yet: a walk that only looks
    results up returns a `pending` reference for a missing result. A plain class, because Prefect looks for the task run
    that returned each field of a dataclass, and equal strings are one object.
    """

    __slots__ = ("__weakref__", "kind", "record", "sha256")

    def __init__(self, kind: str, sha256: str, record: "Record | None" = None) -> None:
        self.kind = kind
        """Type of the value: Scan, Segmentation, ..., Infeasible, Source; for a pending reference the name of the
        stage."""
        self.sha256 = sha256
        """Digest over the names and contents of its files, 64 hex digits; empty while the reference is pending."""
        self.record = record
        """Record of the computation; None if no stage returned the artifact. Ignored in comparisons."""

    @property
    def infeasible(self) -> bool:
        """Whether the artifact is the reason why there is no value."""
        return self.kind == Infeasible.__name__

    @property
    def pending(self) -> bool:
        """Whether the stage of the artifact has not run yet."""
        return not self.sha256

    def to_json(self) -> dict[str, str]:
        """Return the plain form for records and keys."""
        return {"kind": self.kind, "sha256": self.sha256}

    @classmethod
    def from_json(cls, tree: Mapping[str, object]) -> "Ref[Any]":
        """Return the reference that `to_json` wrote."""
        return Ref(str(tree["kind"]), str(tree["sha256"]))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Ref) and (self.kind, self.sha256) == (other.kind, other.sha256)

    def __hash__(self) -> int:
        return hash((self.kind, self.sha256))

    def __lt__(self, other: "Ref[Any]") -> bool:
        return (self.kind, self.sha256) < (other.kind, other.sha256)

    def __repr__(self) -> str:
        return f"Ref({self.kind!r}, {self.sha256[:12]!r})"


@dataclass(frozen=True, slots=True)
class Record:
    """Record of an artifact's computation by a stage."""

    key: str
    """Name of the record: the stage and the digest of the recipe."""
    seconds: float
    """Wall time of the stage's function, without loading and saving [s]."""
    size: int
    """Size of the artifact [bytes]."""
    recipe: Mapping[str, Any]
    """Everything that decides the result (cache.py)."""


@dataclass(frozen=True, slots=True)
class Source:
    """A foreign file or folder, unchanged inside the store: read it, never write it."""

    path: Path
    """The folder, or the single file under its original name next to its companions."""
    folder: str = ""
    """Name of the given folder, or of the given file's folder, if it names the mesh; else empty, so that a name that
    decides nothing does not distinguish equal sources."""


class Store:
    """Artifacts in one folder; safe for many threads and processes at once."""

    def __init__(self, root: Path, shared: SharedStore | None = None) -> None:
        self.root = root
        self.shared = shared
        self._verified: dict[Ref[Any], tuple[tuple[str, int, int], ...]] = {}
        self._sources: dict[str, Path] = {}

    @classmethod
    def default(cls) -> "Store":
        """Return the store of this machine, one per process, folder and shared store."""
        return _default_store(cache_root(), shared_store_url())

    def folder(self, ref: Ref[Any]) -> Path:
        """Return the folder with the files of an artifact."""
        return self.root / OBJECTS / ref.kind / ref.sha256[:2] / ref.sha256

    def save(self, value: ValueT) -> Ref[ValueT]:
        """Write a value; an existing sound artifact is left alone."""
        files = encode(value)
        digests = {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}
        ref: Ref[ValueT] = Ref(type(value).__name__, digest_of(digests))
        if not self.is_here(ref):
            with self._draft(ref) as folder:
                for name, data in files.items():
                    (folder / name).write_bytes(data)
        self.share(ref)
        return ref

    def share(self, ref: Ref[Any]) -> None:
        """Write a local artifact into the shared store, if there is one."""
        if self.shared is not None:
            self.shared.push(self._shared_name(ref), self.folder(ref))

    def load(self, ref: Ref[ValueT]) -> ValueT | Infeasible:
        """Return the value of an artifact; raises MissingArtifactError if it is missing or does not match its
        digest."""
        folder, missing = self.folder(ref), f"{ref.kind} {ref.sha256[:12]} in {self.folder(ref)} is missing or damaged"
        if ref.kind == Source.__name__:
            if not self.has(ref):
                raise MissingArtifactError(missing)
            tree = json.loads((folder / VALUE_FILE).read_bytes())
            return cast("ValueT", Source(folder / FILES / tree["main"], tree["folder"]))
        files = sound_files(folder, ref)
        if files is None and self._fetch(ref):
            files = sound_files(folder, ref)
        if files is None:
            raise MissingArtifactError(missing)
        return cast("ValueT | Infeasible", decode(files))

    def has(self, ref: Ref[Any], *, bring: bool = True) -> bool:
        """Return whether the artifact is here and sound; a copy in the shared store is fetched first.

        Without `bring`, files in the shared store are enough, sound or not.
        """
        if self.is_here(ref):
            return True
        if bring:
            return self._fetch(ref)
        return self.shared is not None and bool(self.shared.names(self._shared_name(ref)))

    def is_here(self, ref: Ref[Any]) -> bool:
        """Return whether the artifact is in this folder and every byte matches its digest.

        Bytes are read once per process; after that, unchanged sizes and modification times count as proof.
        """
        folder = self.folder(ref)
        try:
            stamps = tuple((str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in files_in(folder))
        except OSError:
            return False
        if not stamps:
            return False
        if self._verified.get(ref) != stamps:
            if digest_of_folder(folder) != ref.sha256:
                return False
            self._verified[ref] = stamps
        return True

    def size(self, ref: Ref[Any]) -> int:
        """Return the bytes that the artifact takes on disk."""
        return sum(path.stat().st_size for path in files_in(self.folder(ref)))

    def refs(self) -> Iterator[Ref[Any]]:
        """Yield all artifacts, sound or not."""
        for folder in sorted((self.root / OBJECTS).glob("*/??/*")):
            yield Ref(folder.parent.parent.name, folder.name)

    def add_source(self, given: str | Path) -> Ref[Source]:
        """Copy a foreign file or folder into the store, with the files that it names (MTL, textures, buffers)."""
        path = Path(given)
        try:
            main, files = source_files(path)
            about = canonical_json({"main": main, "folder": telling_folder(path, files)}, indent=1)
            digests = {f"{FILES}/{name}": digest_of_file(file) for name, file in files.items()}
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror} ({error.filename})") from None
        ref: Ref[Source] = Ref(Source.__name__, digest_of(digests | {VALUE_FILE: hashlib.sha256(about).hexdigest()}))
        if not self.is_here(ref):
            with self._draft(ref) as folder:
                (folder / VALUE_FILE).write_bytes(about)
                for name, file in files.items():
                    target = folder / FILES / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, target)
            if not self.is_here(ref):
                raise InputError(f"{path}: changed while it was read; try again when nothing writes to it")
        self._sources[str(given)] = self.folder(ref) / FILES / main
        return ref

    def source_path(self, given: str | Path) -> Path | None:
        """Return the path of the copy that `add_source` made in this process, to translate it back in messages."""
        return self._sources.get(str(given))

    def discard(self, ref: Ref[Any]) -> None:
        """Delete an artifact; it vanishes as a whole."""
        self._move_away(self.folder(ref))

    def _fetch(self, ref: Ref[Any]) -> bool:
        """Copy an artifact here; foreign scenes and meshes stay on the machine of their user."""
        if self.shared is None or ref.pending or ref.kind == Source.__name__:
            return False
        with self._draft(ref) as folder:
            self.shared.fetch(self._shared_name(ref), folder)
        return self.is_here(ref)

    def _shared_name(self, ref: Ref[Any]) -> str:
        return f"{OBJECTS}/{ref.kind}/{ref.sha256[:2]}/{ref.sha256}"

    @contextmanager
    def _draft(self, ref: Ref[Any]) -> Iterator[Path]:
        """Yield a new folder that becomes the artifact if its content has the artifact's digest, and is deleted
        otherwise."""
        draft = self.root / DRAFTS / uuid.uuid4().hex
        draft.mkdir(parents=True)
        try:
            yield draft
            if digest_of_folder(draft) == ref.sha256:
                self._put(draft, self.folder(ref))
        finally:
            shutil.rmtree(draft, ignore_errors=True)

    def _put(self, draft: Path, target: Path) -> None:
        """Rename a draft into its place; a damaged artifact there is moved away first, a sound one stays."""
        target.parent.mkdir(parents=True, exist_ok=True)
        while True:
            try:
                os.rename(draft, target)
            except OSError as error:
                if error.errno not in OCCUPIED:
                    raise
                if digest_of_folder(target) == target.name:
                    return
                self._move_away(target)
            else:
                return

    def _move_away(self, folder: Path) -> None:
        """Delete a folder by renaming it first, so that nobody ever sees half of it."""
        gone = self.root / DRAFTS / uuid.uuid4().hex
        gone.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.rename(folder, gone)
        except FileNotFoundError:  # another process was faster
            return
        remove(gone)


@cache
def _default_store(folder: Path, url: str) -> Store:
    """Open a store once per process."""
    _use_lock(folder)
    return Store(folder / "store", SharedStore(url) if url else None)


@cache
def _use_lock(folder: Path) -> int | None:
    """Take the shared lock of a cache until this process ends; None if the disk is read-only or full."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = os.open(folder / USED, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError:  # writing raises the error
        return None
    fcntl.flock(lock, fcntl.LOCK_SH)
    return lock


@contextmanager
def exclusive_use(folder: Path) -> Iterator[None]:
    """Keep all other programs from using a cache inside the block; raises StoreError if one is using it."""
    lock = _use_lock(folder)
    if lock is None:
        raise StoreError(f"{folder} cannot be written, so nothing can be deleted from it")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise StoreError(f"{folder} is in use by another program; wait until that has ended") from None
    finally:
        fcntl.flock(lock, fcntl.LOCK_SH)


def digest_of(digests: Mapping[str, str]) -> str:
    """Return the SHA-256 over lines `DIGEST  NAME` in the order of the names, as `sha256sum` prints them."""
    lines = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.sha256(lines.encode(errors="surrogateescape")).hexdigest()


def digest_of_folder(folder: Path) -> str:
    """Return the digest of an artifact's folder; empty if it cannot be read."""
    try:
        return digest_of({path.relative_to(folder).as_posix(): digest_of_file(path) for path in files_in(folder)})
    except OSError:
        return ""


def sound_files(folder: Path, ref: Ref[Any]) -> dict[str, bytes] | None:
    """Return the files of an artifact; None if they are missing, or do not match its digest."""
    try:
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
    except OSError:
        return None
    sound = digest_of({name: hashlib.sha256(data).hexdigest() for name, data in files.items()}) == ref.sha256
    return files if sound else None


def remove(path: Path) -> None:
    """Delete a file, a link, or a folder with all its contents."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def files_in(folder: Path) -> list[Path]:
    """Return all files below a folder, sorted."""
    return sorted(path for path in folder.rglob("*") if not path.is_dir())
