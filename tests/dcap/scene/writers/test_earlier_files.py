"""Files that were made before are copied only where they are all there and whole."""

from collections.abc import Callable
from pathlib import Path

import pytest

from dcap.scene.writers.placed_scene import copy_earlier, note_files, note_path

FILES = {"scene": "scene.glb", "script": "deep/one.js"}


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with files that were noted."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    folder = tmp_path / "made"
    (folder / "deep").mkdir(parents=True)
    for name in FILES.values():
        (folder / name).write_bytes(name.encode())
    note_files("key", folder, FILES)
    return folder


def test_whole_files_are_copied(made: Path, tmp_path: Path) -> None:
    """With their names by what they are; of another key nothing is known."""
    assert copy_earlier("key", tmp_path / "new") == FILES
    for name in FILES.values():
        assert (tmp_path / "new" / name).read_bytes() == name.encode()
    assert copy_earlier("other", tmp_path / "newer") == {}


DAMAGES: dict[str, Callable[[Path, Path], object]] = {
    "edited": lambda made, note: (made / "scene.glb").write_bytes(b"mine"),
    "deleted": lambda made, note: (made / "deep" / "one.js").unlink(),
}


def test_nothing_is_told_of_what_is_not_whole(made: Path, tmp_path: Path) -> None:
    """Edited by a person, deleted, or noted wrongly: they are made anew."""
    note = note_path("key")
    for name, damage in DAMAGES.items():
        damage(made, note)
        assert copy_earlier("key", tmp_path / name) == {}, name
        for one in FILES.values():
            (made / one).write_bytes(one.encode())
        note_files("key", made, FILES)
        assert copy_earlier("key", tmp_path / f"{name}, mended") == FILES, name
