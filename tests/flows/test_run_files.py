"""What a run keeps of what was asked: a damaged file is one line, whoever reads it."""

from pathlib import Path

import pytest

from flows.cli.app import main

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
