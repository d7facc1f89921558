"""`dcap view`: what it refuses, in one line and with exit code 2; and that it is not loaded before it is asked for."""

import subprocess
import sys
from pathlib import Path

import pytest

from flows.cli import main


@pytest.fixture(autouse=True)
def no_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty data folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    """What was said, which is one line on standard error alone."""
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert err.startswith("dcap: ")
    return err


def test_a_run_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    """It is named."""
    assert main(["view", "nowhere", "--no-open"]) == 2
    assert "'nowhere' is not a run" in one_line(capsys)


def test_an_empty_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run without samples has nothing to be shown."""
    run = tmp_path / "data" / "runs" / "empty"
    run.mkdir(parents=True)
    (run / "run.json").write_text('{"version": 2, "samples": [], "config": {}, "language": {}}')
    assert main(["view", "empty", "--no-open"]) == 2
    assert "empty has no samples" in one_line(capsys)


def test_a_sample_with_an_object_is_two_things_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """A sample belongs to a run, an object to a scene."""
    assert main(["view", "room.glb", "ball", "--object", "ball.glb", "--no-open"]) == 2
    assert "leave one of them out" in one_line(capsys)


def test_an_object_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It is named before the scene is read."""
    assert main(["view", str(tmp_path), "--object", "no.glb", "--no-open"]) == 2
    assert "--object no.glb: no such file" in one_line(capsys)


def test_a_frame_of_a_scene_without_a_drop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing has been dropped yet."""
    assert main(["view", str(tmp_path), "--frame", "3", "--no-open"]) == 2
    assert "--frame 3" in one_line(capsys)


def test_a_port_out_of_range(capsys: pytest.CaptureFixture[str]) -> None:
    """It is refused with the option's name."""
    assert main(["view", "last", "--port", "70000"]) == 2
    assert "--port" in one_line(capsys)


def test_help_does_without_the_viewer() -> None:
    """The command line is there before viser is: nothing imports it until a page is to be shown."""
    code = "import sys, flows.cli.app; sys.exit('viser' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
