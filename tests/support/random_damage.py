"""Damage of every kind to a cache, by a seeded generator: what disks, people and killed programs do, and worse."""

import json
import os
import random
import shutil
import stat
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from dcap.scene.store.earlier_files import FOLDER
from tasks.runner.parsed_sources import KEPT

JSON_TEXTS = (
    "", "null", "[]", "{}", "0", '"text"', "[" * 100_000, '{"result": ' + "9" * 5000 + "}", '{"metadata": {}}',
    '{"metadata": {"serializer": {"type": "pickle"}}, "result": "gASVCAAAAAAAAACMBG1haW6ULg=="}',
)  # fmt: skip
"""Files that are no record and no value."""
ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    1e308,
    10**400,
    "",
    "../../x",
    "\ud800",
    "x" * 300,
    [],
    [[]],
    {},
    {"__class__": "os.path"},
)


class Vandal:
    """Damages the cache in a folder."""

    def __init__(self, cache: Path, seed: int) -> None:
        self.cache = cache
        self.notes = cache / FOLDER
        self.random = random.Random(seed)
        self.done: dict[str, int] = {}
        """How often each kind of damage was done."""
        self.acts: tuple[Callable[[], None], ...] = (
            self.flip, self.cut, self.lengthen, self.empty, self.remove, self.overwrite, self.swap, self.copy,
            self.link, self.loop, self.pipe, self.folder_for_file, self.file_for_folder, self.link_for_folder,
            self.remove_folder, self.swap_folders, self.add_to_folder, self.link_into_folder, self.odd_record,
            self.odd_note,             self.swap_references, self.swap_kinds, self.socket, self.replace_locks,
        )  # fmt: skip

    def strike(self) -> str:
        """One random damage; its name."""
        act = self.random.choice(self.acts)
        name = act.__name__
        try:
            act()
        except (IndexError, KeyError, OSError, RecursionError, TypeError, ValueError):  # nothing left for it
            name = self.remove.__name__
            self.remove()
        self.done[name] = self.done.get(name, 0) + 1
        return name

    def files(self) -> list[Path]:
        """All plain files of records, artifacts and notes, and of parsed sources, in a fixed order."""
        roots = (self.cache / "records", self.cache / "store" / "objects", self.notes)
        paths = [path for root in roots for path in root.rglob("*")] + [self.cache / KEPT]
        return sorted(path for path in paths if path.is_file() and not path.is_symlink())

    def folders(self) -> list[Path]:
        """Artifacts, the folders around them, and that of the notes."""
        paths = [*(self.cache / "store" / "objects").rglob("*"), self.notes]
        return sorted(path for path in paths if path.is_dir())

    def file(self) -> Path:
        """One of the files; records are as likely as all files of artifacts together."""
        files = self.files()
        records = [path for path in files if path.parent.name == "records"]
        return self.random.choice(self.random.choice([records or files, files]))

    def record(self) -> tuple[Path, dict[str, Any]]:
        """One of the records that can be read, and what it holds."""
        path = self.random.choice([path for path in self.files() if path.parent.name == "records"])
        tree = json.loads(path.read_text())
        return path, tree | {"result": json.loads(tree["result"])}

    def flip(self) -> None:
        path = self.file()
        data = bytearray(path.read_bytes())
        for _ in range(self.random.choice((1, 1, 1, 20))):
            data[self.random.randrange(len(data))] ^= 1 << self.random.randrange(8)
        path.write_bytes(data)

    def cut(self) -> None:
        path = self.file()
        os.truncate(path, self.random.randrange(path.stat().st_size))

    def lengthen(self) -> None:
        with self.file().open("ab") as file:
            file.write(self.random.randbytes(9))

    def empty(self) -> None:
        self.file().write_bytes(b"")

    def remove(self) -> None:
        files = self.files()
        if files:
            self.random.choice(files).unlink()

    def overwrite(self) -> None:
        self.file().write_text(self.random.choice(JSON_TEXTS))

    def swap(self) -> None:
        one, other = self.file(), self.file()
        data = one.read_bytes()
        one.write_bytes(other.read_bytes())
        other.write_bytes(data)

    def copy(self) -> None:
        self.file().write_bytes(self.file().read_bytes())

    def link(self) -> None:
        target = self.random.choice([self.file(), Path("nowhere"), Path("/dev/zero"), Path("..")])
        self.stand_in(self.file()).symlink_to(target)

    def loop(self) -> None:
        path = self.stand_in(self.file())
        path.symlink_to(path.name)

    def pipe(self) -> None:
        os.mkfifo(self.stand_in(self.file()))

    def folder_for_file(self) -> None:
        path = self.stand_in(self.file())
        path.mkdir()
        if self.random.random() < 0.5:
            (path / "inner").write_text("x")

    def file_for_folder(self) -> None:
        self.stand_in(self.random.choice(self.folders())).write_text("no folder")

    def link_for_folder(self) -> None:
        folders = [path for path in self.folders() if path != self.notes]  # people may link that one to a disk
        path, target = self.random.choice(folders), self.random.choice([*folders, Path("nowhere")])
        if target in path.parents:
            raise ValueError("a folder in itself")
        self.stand_in(path).symlink_to(target)

    def remove_folder(self) -> None:
        shutil.rmtree(self.random.choice(self.folders()))

    def swap_folders(self) -> None:
        one, other = self.random.sample(self.folders(), 2)
        draft = one.with_name(uuid.UUID(int=self.random.getrandbits(128)).hex)
        os.rename(one, draft)
        os.rename(other, one)
        os.rename(draft, other)

    def add_to_folder(self) -> None:
        path = self.random.choice(self.folders()) / self.random.choice(("more.txt", "value.json~", "\udcff"))
        path.unlink(missing_ok=True)  # an earlier one may be a pipe by now, which nobody reads
        path.write_text("x")

    def link_into_folder(self) -> None:
        (self.random.choice(self.folders()) / "linked").symlink_to(self.random.choice(self.folders()))

    def odd_record(self) -> None:
        path, tree = self.record()
        inner = tree["result"]
        name = self.random.choice(sorted(inner))
        value = self.random.choice(ODD_VALUES)
        if name == "ref" and self.random.random() < 0.5:
            inner["ref"][self.random.choice(("kind", "sha256"))] = value
        else:
            inner[name] = value
        path.write_text(json.dumps(tree | {"result": json.dumps(inner)}))

    def odd_note(self) -> None:
        path = self.random.choice(sorted(self.notes.glob("*.json")))
        tree = json.loads(path.read_text())
        tree[self.random.choice(sorted(tree))] = self.random.choice(ODD_VALUES)
        path.write_text(json.dumps(tree))

    def swap_references(self) -> None:
        (one, tree), (_, other) = self.record(), self.record()
        tree["result"]["ref"] = other["result"]["ref"]
        one.write_text(json.dumps(tree | {"result": json.dumps(tree["result"])}))

    def swap_kinds(self) -> None:
        one, other = self.random.sample(sorted((self.cache / "store" / "objects").iterdir()), 2)
        draft = one.with_name("Draft")
        os.rename(one, draft)
        os.rename(other, one)
        os.rename(draft, other)

    def socket(self) -> None:
        """What nobody can open, root neither."""
        os.mknod(self.stand_in(self.file()), stat.S_IFSOCK | 0o600)

    def replace_locks(self) -> None:
        locks = self.cache / "locks"
        paths = sorted(locks.iterdir())
        path = self.random.choice([locks, *paths])
        place = self.stand_in(path)
        kind = self.random.choice(("file", "loop", "folder"))
        if kind == "file":
            place.write_text("x")
        elif kind == "loop":
            place.symlink_to(place.name)
        else:
            place.mkdir()

    def stand_in(self, path: Path) -> Path:
        """A path at which nothing lies any more."""
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()
        return path
