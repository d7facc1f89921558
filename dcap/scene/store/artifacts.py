"""The artifact store: values and foreign files by the digest of their content.

An artifact is a folder `objects/KIND/aa/SHA256` of plain files (see `codec.py`); its digest covers the names
and bytes of all of them. Guaranteed: an artifact appears whole or not at all (written beside, then renamed), equal
values get the same digest and the same bytes, and what `load` returns was read from bytes that match the digest.
"""

import hashlib
import json
import os
import shutil
import threading
import uuid
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

from dcap.scene.errors import InputError, MissingArtifactError, StoreError
from dcap.scene.settings import cache_root
from dcap.scene.store.codec import VALUE_FILE, canonical_json, decode, encode
from dcap.scene.store.ref import Ref
from dcap.scene.store.source_files import source_files, telling_folder
from dcap.scene.types.outcome import Infeasible

FILES_FOLDER = "files"
HOLDERS = 3
"""Folders of the store around an artifact: objects/KIND/aa."""

ValueT = TypeVar("ValueT")


@dataclass(frozen=True, slots=True)
class Source:
    """A foreign file or folder as it was given, inside the store: read it, never write it."""

    path: Path
    """The folder, or the single file under its original name with its companions beside it."""
    folder: str = ""
    """Name of the given folder, or of the one that the given file lay in, where it tells what the mesh is; else empty:
    the same bytes under a name that decides nothing are the same source."""


class Store:
    """Artifacts in one folder; safe for many threads and processes at once."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self._verified: dict[Ref[object], tuple[tuple[str, int, int], ...]] = {}
        self._sources: dict[str, Path] = {}
        self._lock = threading.Lock()

    @classmethod
    def default(cls) -> "Store":
        """The store of this machine, one per process and folder."""
        root = cache_root() / "store"
        with opening:
            return opened.setdefault(root, cls(root))

    def folder(self, ref: Ref[object]) -> Path:
        """Where the files of an artifact lie."""
        return self.root / "objects" / ref.kind / ref.sha256[:2] / ref.sha256

    def save(self, value: ValueT) -> Ref[ValueT]:
        """Write a value; an artifact that is there and sound is left alone."""
        files = encode(value)
        ref: Ref[ValueT] = Ref(type(value).__name__, digest_of_bytes(files))
        if not self.has(ref):
            with self._building(ref) as folder:
                for name, data in files.items():
                    (folder / name).write_bytes(data)
        return ref

    def load(self, ref: Ref[ValueT]) -> ValueT | Infeasible:
        """The value of an artifact, from bytes that match its digest."""
        return cast("ValueT | Infeasible", self._load(ref))

    def _load(self, ref: Ref[object]) -> object:
        if ref.kind == Source.__name__:
            return self._load_source(ref)
        folder = self.folder(ref)
        try:
            if not all(path.is_file() for path in folder.iterdir()):
                raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} in {folder} holds what is no file")
            files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        except OSError as error:
            raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} cannot be read: {error}") from error
        if digest_of_bytes(files) != ref.sha256:
            raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} in {folder} does not match its digest")
        return decode(files)

    def has(self, ref: Ref[object]) -> bool:
        """Whether the artifact is there and every byte matches its digest.

        Bytes are read once per process; after that unchanged sizes and modification times are taken as proof.
        """
        folder = self.folder(ref)
        stamp = stamps(folder)
        if not stamp:
            return False
        with self._lock:
            if self._verified.get(ref) == stamp:
                return True
        if digest_of_folder(folder) != ref.sha256:
            return False
        with self._lock:
            self._verified[ref] = stamp
        return True

    def size(self, ref: Ref[object]) -> int:
        """Bytes that the artifact takes on disk."""
        return sum(path.stat().st_size for path in walk(self.folder(ref)))

    def refs(self) -> Iterator[Ref[object]]:
        """All artifacts, sound or not."""
        for folder in sorted((self.root / "objects").glob("*/??/*")):
            yield Ref(folder.parent.parent.name, folder.name)

    def add_source(self, given: str | Path) -> Ref[Source]:
        """Take a foreign file or folder in, with the files that it names (MTL, textures, buffers)."""
        path = Path(given)
        try:
            main, files = source_files(path)
            tree = {"$type": Source.__name__, "main": main, "folder": telling_folder(path, files)}
            about = canonical_json(tree, indent=1)
            digests = {VALUE_FILE: hashlib.sha256(about).hexdigest()}
            digests |= {f"{FILES_FOLDER}/{name}": digest_of_file(file) for name, file in files.items()}
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror} ({error.filename})") from None
        ref: Ref[Source] = Ref(Source.__name__, digest_of(digests))
        if not self.has(ref):
            with self._building(ref) as folder:
                (folder / VALUE_FILE).write_bytes(about)
                for name, file in files.items():
                    target = folder / FILES_FOLDER / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, target)
            if not self.has(ref):
                raise InputError(f"{path}: changed while it was read; try again when nothing writes to it")
        with self._lock:
            self._sources[str(given)] = self.folder(ref) / FILES_FOLDER / main
        return ref

    def source_path(self, given: str | Path) -> Path | None:
        """Where `add_source` of this process put a path, to turn messages about it back."""
        with self._lock:
            return self._sources.get(str(given))

    def _load_source(self, ref: Ref[object]) -> Source:
        folder = self.folder(ref)
        if digest_of_folder(folder) != ref.sha256:
            raise MissingArtifactError(f"Source {ref.sha256[:12]} in {folder} is missing or does not match its digest")
        tree = json_file(folder / VALUE_FILE)
        return Source(folder / FILES_FOLDER / str(tree["main"]), str(tree.get("folder", "")))

    def _building(self, ref: Ref[object]) -> "Building":
        return Building(self.root / "building" / uuid.uuid4().hex, self.folder(ref))


class Building:
    """A folder that takes its place whole, or vanishes if its making failed."""

    def __init__(self, draft: Path, target: Path) -> None:
        self.draft = draft
        self.target = target

    def __enter__(self) -> Path:
        self.draft.mkdir(parents=True)
        return self.draft

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        try:
            if error is None:
                self._take_place()
        finally:
            shutil.rmtree(self.draft, ignore_errors=True)

    def _take_place(self) -> None:
        """Rename into place; a damaged artifact there is moved away first, a sound one by another writer stays."""
        for _ in range(100):
            try:
                self._make_way()
                os.rename(self.draft, self.target)
                return
            except OSError as error:
                if not os.path.lexists(self.target):
                    raise StoreError(f"{self.target} cannot be written: {error}") from error
                if digest_of_folder(self.target) == self.target.name:
                    return
                self._discard(self.target)
        raise StoreError(f"other processes keep replacing {self.target}; try again")

    def _make_way(self) -> None:
        """Make the folders that hold the target; what stands in their place and is no folder goes."""
        for folder in reversed(self.target.parents[:HOLDERS]):
            if os.path.lexists(folder) and not folder.is_dir():
                self._discard(folder)
            folder.mkdir(parents=True, exist_ok=True)

    def _discard(self, path: Path) -> None:
        """Take away what lies at a path, of a link the link alone."""
        damaged = self.draft.with_name(f"{self.draft.name}-damaged")
        try:
            os.rename(path, damaged)
        except FileNotFoundError:
            return
        if damaged.is_dir() and not damaged.is_symlink():
            shutil.rmtree(damaged)
        else:
            damaged.unlink()


opened: dict[Path, Store] = {}
opening = threading.Lock()


def digest_of(digests: Mapping[str, str]) -> str:
    """SHA-256 over sorted lines `DIGEST  NAME`, as `sha256sum` prints them."""
    lines = "".join(f"{digests[name]}  {name}\n" for name in sorted(digests))
    return hashlib.sha256(lines.encode()).hexdigest()


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
        if folder.is_symlink() or not all(path.is_file() for path in files):  # to open a pipe would wait for ever
            return ""
        return digest_of({str(path.relative_to(folder)): digest_of_file(path) for path in files})
    except OSError:
        return ""


def stamps(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """Name, size and modification time of every file; empty if there is none."""
    try:
        status = [(str(path), path.stat()) for path in walk(folder)]
    except OSError:
        return ()
    return tuple((name, one.st_size, one.st_mtime_ns) for name, one in status)


def walk(folder: Path) -> list[Path]:
    """All files below a folder, sorted; and empty folders, which no artifact has and which no digest survives."""
    return sorted(path for path in folder.rglob("*") if not path.is_dir() or not any(path.iterdir()))


def json_file(path: Path) -> dict[str, object]:
    """A JSON object from a file."""
    tree = json.loads(path.read_bytes())
    if not isinstance(tree, dict):
        raise StoreError(f"{path} does not hold a JSON object")
    return tree
