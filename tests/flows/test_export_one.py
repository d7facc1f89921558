"""An export is written whole or not at all, and leaves what else is in its folder."""

from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from flows.cli.app import main
from flows.extra_output import LIST, WRITERS, clear_exports, write_files

FILES = {"scene.xml": b"<mujoco/>", "meshes/ball.obj": b"v 0 0 0\n"}


def names(folder: Path) -> set[str]:
    """Files in a folder and below."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_an_earlier_export_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    write_files(tmp_path, {**FILES, "meshes/old.obj": b""}, "mjcf")
    (tmp_path / "meshes" / "mine.obj").write_text("mine")
    write_files(tmp_path, FILES, "mjcf")
    assert names(tmp_path) == {*FILES, LIST, "meshes/mine.obj"}
    (tmp_path / "meshes" / "mine.obj").unlink()
    write_files(tmp_path, {"scene.usda": b""}, "usd")
    assert names(tmp_path) == {"scene.usda", LIST}
    assert not (tmp_path / "meshes").exists()


def test_exports_of_an_earlier_placement_are_cleared(tmp_path: Path) -> None:
    write_files(tmp_path / "export" / "mjcf", FILES, "mjcf")
    (tmp_path / "export" / "splats").mkdir()
    (tmp_path / "export" / "splats" / "scene_settled.ply").write_bytes(b"ply")
    (tmp_path / "export" / "mjcf" / "mine.txt").write_text("mine")
    clear_exports(tmp_path)
    assert names(tmp_path) == {"export/mjcf/mine.txt"}
    assert not (tmp_path / "export" / "splats").exists()
    (tmp_path / "export" / "mjcf" / "mine.txt").unlink()
    clear_exports(tmp_path)
    assert not (tmp_path / "export").exists()
    clear_exports(tmp_path)  # nothing there


def test_a_list_that_leads_elsewhere_removes_nothing_there(tmp_path: Path) -> None:
    """A list is a file that anyone may have changed."""
    folder, other = tmp_path / "out", tmp_path / "other.txt"
    folder.mkdir()
    other.write_text("mine")
    for text in (f'{{"files": ["../other.txt", "{other}", 7]}}', '{"files": 3}', "[]", "not json"):
        (folder / LIST).write_text(text)
        write_files(folder, FILES, "mjcf")
        assert other.read_text() == "mine"


@pytest.mark.parametrize("blocked", ["meshes", "scene.xml/", f"{LIST}/"])
def test_what_stands_in_the_way_is_named_and_nothing_written(tmp_path: Path, blocked: str) -> None:
    """A file where a folder goes, or a folder where a file goes."""
    path = tmp_path / blocked
    path.mkdir() if blocked.endswith("/") else path.write_text("mine")
    before = names(tmp_path)
    with pytest.raises(InputError, match=path.name):
        write_files(tmp_path, FILES, "mjcf")
    assert names(tmp_path) == before
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_write_that_fails_leaves_no_half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk while the draft is written: the earlier export is still there."""
    write_files(tmp_path, FILES, "mjcf")

    def full(self: Path, data: bytes) -> int:
        raise OSError(28, "No space left on device", str(self))

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(InputError, match="No space left"):
        write_files(tmp_path, {"scene.usda": b""}, "usd")
    assert names(tmp_path) == {*FILES, LIST}


@pytest.mark.parametrize(("arguments", "words"), [
    (["--format", "blend"], f"--format 'blend' is not one of {', '.join(WRITERS)}"),
    ([], "--format"),
    (["--format", "mjcf"], "'nothing' is not a run"),
])  # fmt: skip
def test_bad_usage(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    """What cannot be exported ends with 2 and one line; known formats are named."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    assert main(["export", "nothing", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert words in captured.err


def test_a_file_in_the_place_of_the_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    assert main(["export", "nothing", "--format", "usd", "--out", str(tmp_path / "file")]) == 2
    assert "is a file" in capsys.readouterr().err
