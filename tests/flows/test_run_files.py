"""What a run keeps of what was asked: a damaged file is one line, whoever reads it."""

from pathlib import Path

import pytest

from flows.cli.app import main
from flows.find_run import ASKED_VERSION

VERSION = f'{{"version": {ASKED_VERSION}, '
TREES = {
    "cut short": '{"a": ', "a list": "[]", "nested": "[" * 100_000, "bytes": "\0\1",
    "no number": VERSION + '"samples": NaN, "language": {}}',
    "without keys": VERSION + '"language": {}, "samples": []}',
    "other keys": VERSION + '"language": {"x": 1}, "samples": [{"id": 1}]}',
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


@pytest.mark.slow
def test_a_run_of_another_version_is_told(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Exit code 2 and one line that says to run it again, whether its file has no version or a later one; the same for
    the folder of a placement."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    run, placement = tmp_path / "runs" / "bad", tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    placement.mkdir()
    (placement / "placement.json").write_text("{}")
    of_one = (("diff", "one", "one"), ("maps", "one"), ("dataset", "pack", str(placement)))
    for text in (
        '{"dataset": "rooms.yaml", "config": {}, "language": {}, "samples": []}',
        f'{{"version": {ASKED_VERSION + 1}}}',
    ):
        (run / "run.json").write_text(text)
        (placement / "sample.json").write_text(text)
        for command in (*COMMANDS, ("diff", "bad", "bad"), ("judge", "bad"), ("study", "report", "bad"), *of_one):
            assert main(list(command)) == 2, command
            said = capsys.readouterr().err
            assert said.count("\n") == 1, command
            assert "another version of dcap" in said, command
