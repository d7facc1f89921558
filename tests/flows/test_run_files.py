"""What a run keeps of what was asked: a damaged file is one line, whoever reads it."""

import errno
import os
from pathlib import Path

import pytest

from flows.cli.app import main
from flows.whole_files import write_whole

TREES = {
    "cut short": '{"a": ', "a list": "[]", "nested": "[" * 100_000, "no number": '{"samples": NaN, "language": {}}',
    "without keys": '{"language": {}, "samples": []}', "other keys": '{"language": {"x": 1}, "samples": [{"id": 1}]}',
    "bytes": "\0\1",
}  # fmt: skip
COMMANDS = (
    ("report", "bad"), ("maps", "bad", "x"), ("export", "bad", "x", "--format", "mjcf"), ("dataset", "pack", "bad"),
    ("rerun", "bad", "x", "--stage", "drop"), ("view", "bad", "x", "--no-open"),
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", TREES)
def test_a_damaged_run_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    """Exit code 2 and one line, by every command that reads a run."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    (tmp_path / "runs" / "bad").mkdir(parents=True)
    (tmp_path / "runs" / "bad" / "run.json").write_text(TREES[name])
    for command in COMMANDS:
        assert main(list(command)) == 2
        assert capsys.readouterr().err.count("\n") == 1


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
