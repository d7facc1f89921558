"""What of the cache is damaged: all that stages pass over when they meet it, found at once and moved out of the way."""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import count
from pathlib import Path

from dcap.scene.errors import StoreError
from dcap.scene.settings import cache_root
from dcap.scene.store.artifacts import DRAFTS, OBJECTS, Store, json_file
from dcap.scene.store.building import remove
from dcap.scene.store.codec import VALUE_FILE
from dcap.scene.store.digest import digest_of_folder
from dcap.scene.store.pictures import unfit_picture
from dcap.scene.store.ref import Ref
from dcap.scene.types.mesh import Mesh
from tasks.runner.cache_policy import LOCKS_FOLDER
from tasks.runner.cache_usage import DAMAGED_FOLDER, LITTER_HOURS, age, record_files
from tasks.runner.locks import FileLocks
from tasks.runner.records import NAME, SHA256, close_ranks


class DamagedThing(StrEnum):
    """What can be damaged; litter is no damage, a killed program left it."""

    ARTIFACT = "artifact"
    RECORD = "record"
    LITTER = "litter"


@dataclass(frozen=True, slots=True)
class Damage:
    """Something in the cache that is of no use."""

    what: DamagedThing
    path: Path
    why: str


def damages(store: Store) -> list[Damage]:
    """Everything that is damaged, and litter; reads every byte."""
    why = ((store.folder(ref), what_is_wrong(store, ref)) for ref in store.refs())
    artifacts = [Damage(DamagedThing.ARTIFACT, path, told) for path, told in why if told]
    return [*misplaced(store), *artifacts, *damaged_records(store), *litter(store)]


def what_is_wrong(store: Store, ref: Ref[object]) -> str:
    """What is wrong with an artifact; empty if nothing is."""
    if not NAME.fullmatch(ref.kind) or not SHA256.fullmatch(ref.sha256):
        return "no artifact has such a name"
    folder = store.folder(ref)
    if not store.is_here(ref):
        matches = digest_of_folder(folder) == ref.sha256
        return (unfit_picture(folder) if matches else "") or "it does not match its digest"
    kind = kind_in(folder)
    return "" if kind == ref.kind else f"it is a {kind or 'folder of another kind'}"


def kind_in(folder: Path) -> str:
    """The kind of a sound artifact, which its digest does not tell; empty if it is none of ours."""
    try:
        tree = json_file(folder / VALUE_FILE)
    except (OSError, ValueError, StoreError):
        return ""
    return Mesh.__name__ if "$mesh" in tree else str(tree.get("$type", ""))


def misplaced(store: Store) -> Iterator[Damage]:
    """What lies between the artifacts and is no folder of them."""
    kinds = inside([store.root / OBJECTS])
    pairs = inside(kinds)
    stray = [path for path in (*kinds, *pairs) if path.is_symlink() or not path.is_dir()]
    stray += [path for path in pairs if len(path.name) != 2]
    stray += [path for path in inside(pairs) if path.name[:2] != path.parent.name]
    for path in dict.fromkeys(stray):
        yield Damage(DamagedThing.ARTIFACT, path, "it lies between the artifacts")


def inside(folders: Iterable[Path]) -> list[Path]:
    """What lies in some folders; not through links."""
    return [path for one in folders if one.is_dir() and not one.is_symlink() for path in sorted(one.iterdir())]


def damaged_records(store: Store) -> Iterator[Damage]:
    """Records that do not count; not those that are being written. An artifact that is shared may be elsewhere."""
    locks = FileLocks(cache_root() / LOCKS_FOLDER)
    for one in record_files():
        usable = one.record is not None and (store.remote is not None or store.is_here(one.record.ref))
        if not usable and not locks.is_locked(one.path.name):
            yield Damage(DamagedThing.RECORD, one.path, one.problem or "its artifact is missing or damaged")


def litter(store: Store) -> Iterator[Damage]:
    """What was half-made when a program was killed."""
    drafts = store.root / DRAFTS
    for path in sorted(drafts.iterdir()) if drafts.is_dir() else ():
        if age(path) >= LITTER_HOURS * 3600:
            yield Damage(DamagedThing.LITTER, path, f"half-made for {age(path) / 3600:.0f} h")


def repair(found: Iterable[Damage]) -> Path:
    """Move damaged artifacts and records into a folder where they can be looked at, and remove litter; that folder.
    Sound data is not touched."""
    folder = new_folder(cache_root() / DAMAGED_FOLDER)
    for one in found:
        if one.what is DamagedThing.LITTER:
            remove(one.path)
            continue
        if os.path.lexists(one.path):  # else it was mended meanwhile, or has gone with the folder that it lay in
            target = folder / one.path.relative_to(cache_root())
            target.parent.mkdir(parents=True, exist_ok=True)
            os.rename(one.path, target)
    with suppress(OSError):
        folder.rmdir()  # where nothing was moved
    close_ranks()
    return folder


def new_folder(parent: Path) -> Path:
    """A folder that is called by the time and was not there: two repairs may come in a second."""
    name = time.strftime("%Y%m%d-%H%M%S")
    for number in count(1):
        folder = parent / (name if number == 1 else f"{name}-{number}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        return folder
    raise AssertionError
