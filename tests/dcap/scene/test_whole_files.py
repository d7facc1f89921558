"""A file that is written appears whole or not at all."""

import errno
import os
import stat
from pathlib import Path

import pytest

from dcap.scene.written_files import whole_file, write_whole


def test_a_file_that_cannot_be_written_stays_as_it_was(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A full disk leaves the earlier file and no litter, and is told with its name."""
    (path := tmp_path / "sample.json").write_bytes(b"earlier")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OSError, match=f"No space left on device: '{path}'"):
            write_whole(path, b"new")
    assert path.read_bytes() == b"earlier"
    assert list(tmp_path.iterdir()) == [path]
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"


def test_a_file_is_not_seen_before_it_is_whole(tmp_path: Path) -> None:
    """Not even half of it, and not at all where the writing breaks; the suffix is that of the file."""
    path, seen = tmp_path / "rows.parquet", []

    def half() -> None:
        with whole_file(path) as draft:
            draft.write_bytes(b"half")
            seen.append((draft.suffix, path.exists()))
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        half()
    assert seen == [(".parquet", False)]
    assert list(tmp_path.iterdir()) == []


def test_errors_name_the_file_that_they_are_about(tmp_path: Path) -> None:
    """The file that is written where its folder is gone; another that the block reads by its own name."""
    with pytest.raises(FileNotFoundError, match=r"gone/run\.json"):
        write_whole(tmp_path / "gone" / "run.json", b"")
    with pytest.raises(FileNotFoundError, match="other"), whole_file(tmp_path / "copy") as draft:
        draft.write_bytes((tmp_path / "other").read_bytes())


def test_rights_are_those_of_any_new_file(tmp_path: Path) -> None:
    """What the mask leaves, or fewer where they are asked for."""
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "shared", b"")
        write_whole(tmp_path / "secret", b"", mode=0o600)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "shared").stat().st_mode) == 0o640
    assert stat.S_IMODE((tmp_path / "secret").stat().st_mode) == 0o600


def test_a_link_keeps_leading_where_it_led(tmp_path: Path) -> None:
    """What it leads to is written, and the link stays."""
    (tmp_path / "elsewhere").mkdir()
    (link := tmp_path / "table.csv").symlink_to(tmp_path / "elsewhere" / "table.csv")
    write_whole(link, b"rows")
    assert link.is_symlink()
    assert (tmp_path / "elsewhere" / "table.csv").read_bytes() == b"rows"
