"""Files that were made before are copied only where they are all there and whole."""

import json
import os
from pathlib import Path

import pytest

from dcap.scene.store.earlier_files import CHECK, check_of, copy_earlier, lost_notes, note_files, note_of

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


@pytest.mark.parametrize(
    "damage",
    ["edited", "deleted", "note", "key", "outside", "absolute", "swapped", "pipe", "renamed", "deep"],
)
def test_nothing_is_told_of_what_is_not_whole(made: Path, tmp_path: Path, damage: str) -> None:
    """Edited by a person, deleted, or noted wrongly: they are made anew, and nothing is written elsewhere."""
    note = note_of("key")
    told = json.loads(note.read_text())
    del told[CHECK]
    match damage:
        case "edited":
            (made / "scene.glb").write_bytes(b"mine")
        case "deleted":
            (made / "deep" / "one.js").unlink()
        case "note":
            note.write_bytes(note.read_bytes()[:-9])
        case "key":
            note.write_text("[1, 2]")
        case "swapped":
            other = made.parent / "other"
            (other / "deep").mkdir(parents=True)
            for name in FILES.values():
                (other / name).write_bytes(b"of another")
            note_files("another", other, FILES)
            note.write_bytes(note_of("another").read_bytes())
        case "pipe":
            note.unlink()
            os.mkfifo(note)
            assert lost_notes() == [note]
        case "outside":
            told["files"]["scene"] = "../scene.glb"
            note.write_text(json.dumps(told | {CHECK: check_of(told)}))
        case "absolute":
            told["files"]["scene"] = str(tmp_path / "scene.glb")
            note.write_text(json.dumps(told | {CHECK: check_of(told)}))
        case "renamed":
            note.write_text(note.read_text().replace('"scene":', '"scent":'))
        case "deep":
            note.write_text("[" * 100_000)
            assert lost_notes() == [note]
    assert copy_earlier("key", tmp_path / "new" / "folder") == {}
    assert not list(tmp_path.glob("**/new/*.glb"))
    assert not (tmp_path / "scene.glb").exists()


@pytest.mark.parametrize("kind", ["pipe", "loop", "folder", "file for folder"])
def test_a_note_takes_the_place_of_what_is_none(made: Path, tmp_path: Path, kind: str) -> None:
    """Nobody waits at a pipe, and what stands there is no error."""
    note = note_of("key")
    note.unlink()
    match kind:
        case "pipe":
            os.mkfifo(note)
        case "loop":
            note.symlink_to(note.name)
        case "folder":
            (note / "inner").mkdir(parents=True)
        case "file for folder":
            note.parent.rmdir()
            note.parent.write_text("no folder")
    note_files("key", made, FILES)
    assert copy_earlier("key", tmp_path / "new") == FILES


def test_notes_of_what_is_gone_are_lost(made: Path) -> None:
    """Their folder was deleted or they cannot be read."""
    assert lost_notes() == []
    (note_of("damaged")).write_text("{")
    assert lost_notes() == [note_of("damaged")]
    made.rename(made.with_name("moved"))
    assert set(lost_notes()) == {note_of("damaged"), note_of("key")}
