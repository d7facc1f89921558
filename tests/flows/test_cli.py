"""The command line keeps the contract's exit codes and complains in one line."""

from pathlib import Path

import pytest

from flows.cli import run_command


def failed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a refused command line says."""
    assert run_command(list(arguments)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("dcap: ")
    return captured.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["place", "a", "b", "c", "--bogus"], "--bogus"),
        (["--bogus"], "--bogus"),
        (["fly"], "fly"),
        (["place", "a"], "object"),
        (["place", "a", "b", "  "], "PROMPT is empty"),
        (["place", "a", "b", "c", "--mass", "-1"], "--mass"),
        (["place", "a", "b", "c", "--mass", "nan"], "--mass"),
        (["place", "a", "b", "c", "--up", "x"], "--up 'x' is not one of"),
        (["place", "a", "b", "c", "--unit", "ft"], "--unit 'ft'"),
        (["place", "a", "b", "c", "--seed", "one"], "--seed"),
        (["drop", "nothing.yaml", "--out", "out"], "nothing.yaml: no such file"),
        (["benchmark", "--methods", "magic"], "--methods 'magic'"),
        (["benchmark", "--workers", "0"], "--workers"),
    ],
)
def test_bad_usage(capsys: pytest.CaptureFixture[str], arguments: list[str], words: str) -> None:
    """A command line that cannot be right exits with 2 and one line that names what is wrong."""
    assert words in failed(capsys, *arguments)


def test_out_must_be_a_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """A result folder that is a file is refused before anything runs."""
    (tmp_path / "file").write_text("")
    assert "is a file" in failed(capsys, "place", "a", "b", "put it", "--out", str(tmp_path / "file"))


def test_help_is_not_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    """--help exits with 0 and prints on standard output."""
    assert run_command(["place", "--help"]) == 0
    assert "--object-up" in capsys.readouterr().out


def test_an_empty_cache(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`cache ls` and `cache verify` work where nothing has been computed."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    assert run_command(["cache", "ls"]) == 0
    assert run_command(["cache", "verify"]) == 0
    assert "0 artifacts, 0 damaged" in capsys.readouterr().out
