"""The artifact store: values and foreign files by the digest of their content.

An artifact is a folder `objects/KIND/aa/SHA256` of plain files (see `codec.py`); its digest covers the names
and bytes of all of them. Guaranteed: an artifact appears whole or not at all (written beside, then renamed), equal
values get the same digest and the same bytes, and what `load` returns was read from bytes that match the digest. A
picture that the store would not have written is damage, whatever its digest (`pictures.py`).

With `$DCAP_STORE` (see `remote.py`) the folder is a verified cache in front of a store that machines share: what is
saved here is written there as well, what is not here or damaged is looked for there.
"""

import hashlib
import json
import shutil
import threading
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar, cast

from dcap.scene.errors import InputError, MissingArtifactError, StoreError
from dcap.scene.settings import cache_root, shared_store_url
from dcap.scene.store.building import Building, in_own_folders
from dcap.scene.store.codec import VALUE_FILE, canonical_json, decode, encode
from dcap.scene.store.digest import (
    digest_of,
    digest_of_bytes,
    digest_of_file,
    digest_of_folder,
    is_plain_file,
    stamps,
    walk,
)
from dcap.scene.store.in_use import note_use
from dcap.scene.store.pictures import unfit_picture
from dcap.scene.store.ref import Ref
from dcap.scene.store.remote import RemoteStore
from dcap.scene.store.source_files import source_files, telling_folder
from dcap.scene.types.outcome import Infeasible

FILES_FOLDER = "files"
OBJECTS, DRAFTS = "objects", "building"
"""Folders of the store: where artifacts lie, and where they are made before they take their place."""
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

    def __init__(self, root: Path, remote: RemoteStore | None = None) -> None:
        self.root = root
        self.remote = remote
        self._verified: dict[Ref[object], tuple[tuple[str, int, int], ...]] = {}
        self._pushed: set[Ref[object]] = set()
        """What this process knows to be in the shared store."""
        self._sources: dict[str, Path] = {}
        self._lock = threading.Lock()

    @classmethod
    def default(cls) -> "Store":
        """The store of this machine, one per process, folder and shared store."""
        cache, url = cache_root(), shared_store_url()
        with opening:
            if (cache, url) not in opened:
                note_use(cache)
                opened[cache, url] = cls(cache / "store", RemoteStore(url) if url else None)
            return opened[cache, url]

    def folder(self, ref: Ref[object]) -> Path:
        """Where the files of an artifact lie."""
        return self.root / OBJECTS / ref.kind / ref.sha256[:2] / ref.sha256

    def save(self, value: ValueT) -> Ref[ValueT]:
        """Write a value; an artifact that is there and sound is left alone."""
        files = encode(value)
        ref: Ref[ValueT] = Ref(type(value).__name__, digest_of_bytes(files))
        if not self.is_here(ref):
            with self._building(ref) as folder:
                for name, data in files.items():
                    (folder / name).write_bytes(data)
        if self.remote is not None and ref not in self._pushed:
            self.remote.push(ref, self.folder(ref), self._draft().with_suffix(".tar"))
            self._pushed.add(ref)
        return ref

    def load(self, ref: Ref[ValueT]) -> ValueT | Infeasible:
        """The value of an artifact, from bytes that match its digest."""
        try:
            return cast("ValueT | Infeasible", self._load(ref))
        except MissingArtifactError:
            with self._lock:
                self._verified.pop(ref, None)
            if not self.has(ref):
                raise
        return cast("ValueT | Infeasible", self._load(ref))

    def _load(self, ref: Ref[object]) -> object:
        if ref.kind == Source.__name__:
            return self._load_source(ref)
        folder = self.folder(ref)
        try:
            if not all(is_plain_file(path) for path in folder.iterdir()):
                raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} in {folder} holds what is no file")
            files = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
        except OSError as error:
            raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} cannot be read: {error}") from error
        if digest_of_bytes(files) != ref.sha256:
            raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} in {folder} does not match its digest")
        try:
            return decode(files)
        except StoreError as error:
            raise MissingArtifactError(f"{ref.kind} {ref.sha256[:12]} in {folder}: {error}") from None

    def has(self, ref: Ref[object]) -> bool:
        """Whether the artifact is there and sound, as `is_here` says; it is brought here from the shared store."""
        return self.is_here(ref) or self._fetch(ref)

    def is_here(self, ref: Ref[object]) -> bool:
        """Whether the artifact is in this folder, every byte matches its digest, and its pictures can be decoded.

        Bytes are read once per process; after that unchanged sizes and modification times are taken as proof.
        """
        folder = self.folder(ref)
        stamp = stamps(folder)
        if not stamp or not in_own_folders(folder):
            return False
        with self._lock:
            if self._verified.get(ref) == stamp:
                return True
        if digest_of_folder(folder) != ref.sha256 or (ref.kind != Source.__name__ and unfit_picture(folder)):
            return False
        with self._lock:
            self._verified[ref] = stamp
        return True

    def _fetch(self, ref: Ref[object]) -> bool:
        """Bring an artifact here; false if nobody shares a sound one (a damaged one is written over by `save`)."""
        if self.remote is None or ref.kind == Source.__name__:
            return False
        building = self._building(ref)
        with building as folder:
            building.wanted = self.remote.fetch(ref, folder) and not unfit_picture(folder)
        if building.wanted:
            self._pushed.add(ref)
        return building.wanted and self.is_here(ref)

    def size(self, ref: Ref[object]) -> int:
        """Bytes that the artifact takes on disk."""
        return sum(path.lstat().st_size for path in walk(self.folder(ref)))

    def refs(self) -> Iterator[Ref[object]]:
        """All artifacts in their places, sound or not."""
        for folder in sorted((self.root / OBJECTS).glob("*/??/*")):
            if folder.name[:2] == folder.parent.name:
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
        if not self.is_here(ref):
            with self._building(ref) as folder:
                (folder / VALUE_FILE).write_bytes(about)
                for name, file in files.items():
                    target = folder / FILES_FOLDER / name
                    target.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(file, target)
            if not self.is_here(ref):
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
        main = str(tree["main"])
        if main != "." and ("/" in main or not (folder / FILES_FOLDER / main).is_file()):
            raise MissingArtifactError(f"Source {ref.sha256[:12]} in {folder} has its main file elsewhere")
        return Source(folder / FILES_FOLDER / main, str(tree.get("folder", "")))

    def _building(self, ref: Ref[object]) -> Building:
        return Building(self._draft(), self.folder(ref))

    def _draft(self) -> Path:
        """A name for what is being made, beside all others."""
        return self.root / DRAFTS / uuid.uuid4().hex


opened: dict[tuple[Path, str], Store] = {}
opening = threading.Lock()


def json_file(path: Path) -> dict[str, object]:
    """A JSON object from a file."""
    tree = json.loads(path.read_bytes())
    if not isinstance(tree, dict):
        raise StoreError(f"{path} does not hold a JSON object")
    return tree
