"""Folders that take their place whole: written beside, then renamed; what stands in the way and is damaged goes."""

import os
import shutil
from pathlib import Path

from dcap.scene.errors import StoreError
from dcap.scene.store.digest import digest_of_folder, is_plain_file

HOLDERS = 3
"""Folders of the store around an artifact: objects/KIND/aa."""


class Building:
    """A folder that takes its place whole, or vanishes if its making failed."""

    def __init__(self, draft: Path, target: Path) -> None:
        self.draft = draft
        self.target = target
        self.wanted = True
        """Whether it takes its place in the end."""

    def __enter__(self) -> Path:
        check_folder(self.draft.parent.parent)
        make_folder(self.draft.parent, self.draft.parent.with_name(self._damaged.name))
        self.draft.mkdir()
        return self.draft

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        try:
            if error is None and self.wanted:
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
                if in_own_folders(self.target) and digest_of_folder(self.target) == self.target.name:
                    return
                discard(self.target, self._damaged)
        raise StoreError(f"other processes keep replacing {self.target}; try again")

    def _make_way(self) -> None:
        """Make the folders that hold the target; what stands in their place and is no folder goes."""
        for folder in reversed(self.target.parents[:HOLDERS]):
            if folder in self.target.parents[: HOLDERS - 1] and folder.is_symlink():  # perhaps into another artifact
                discard(folder, self._damaged)
            make_folder(folder, self._damaged)

    @property
    def _damaged(self) -> Path:
        return self.draft.with_name(f"{self.draft.name}-damaged")


def in_own_folders(artifact: Path) -> bool:
    """Whether an artifact and the folders around it, KIND/aa, are no links: it would lie inside another, or be one."""
    return not any(folder.is_symlink() for folder in (artifact, *artifact.parents[: HOLDERS - 1]))


def check_folder(folder: Path) -> None:
    """StoreError where something else stands in the place of a folder that people may have linked to a disk."""
    if os.path.lexists(folder) and not folder.is_dir():
        raise StoreError(f"{folder} is no folder; remove it, or mount what it leads to")


def free_place(path: Path) -> None:
    """Remove what stands in the place of a file and is none: a folder, a link, a pipe at which a writer would wait."""
    if os.path.lexists(path) and not is_plain_file(path):
        remove(path)


def make_folder(folder: Path, discarded: Path) -> None:
    """Make a folder; what stands in its place and is none is renamed to `discarded` and removed."""
    if os.path.lexists(folder) and not folder.is_dir():
        discard(folder, discarded)
    folder.mkdir(parents=True, exist_ok=True)


def discard(path: Path, through: Path) -> None:
    """Take away what lies at a path, of a link the link alone; it vanishes at once, by its renaming to `through`."""
    try:
        os.rename(path, through)
    except FileNotFoundError:
        return
    remove(through)


def remove(path: Path) -> None:
    """Remove a folder with all that is in it, a file, or a link and not what it leads to."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
