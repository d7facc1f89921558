"""A run that is killed in the middle of a stage, or whose disk is full: the next goes on, and ends as any other."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from desk_room import desk_dataset
from kept_records import Stamp, kept_records
from process_trees import descendants

from dcap.scene.settings import PROJECT_ROOT
from flows.sample_records import RECORDS
from flows.server import prefect_server

PATIENCE = 600.0
"""For machines that are busy [s]."""
STAGES = ["particles", "drop", "render", "measure", "judged_views", "drift"]
"""Functions of the stages that have a process of their own, in their order; `mesh` has one for splats only."""
WATCHED = """
import sys
from pathlib import Path
from threading import Thread
from time import sleep
from tasks.runner import process, stage

folder, wanted, run = Path(sys.argv.pop(1)), sys.argv.pop(1), stage.run_in_process

def tell():
    while not process.running:
        sleep(0.001)
    (folder / "begun").touch()

def told(job, *rest):
    with (folder / "stages").open("a") as file:
        print(job["function"], file=file)
    if job["function"] == wanted:
        WANTED
    return run(job, *rest)

stage.run_in_process = told
from flows.cli import main
sys.exit(main())
"""
TELL = "Thread(target=tell, daemon=True).start()"
FILL = """
        import os
        with (Path(os.environ["DCAP_DATA"]) / "ballast").open("wb", 0) as file:
            for size in (1 << 20, 1 << 12):
                try:
                    while file.write(bytes(size)) == size:
                        pass
                except OSError:
                    pass
"""
KILL_SERVER = """
        import json, os, signal
        known = Path(os.environ["DCAP_DATA"], "cache", "prefect", "server.json")
        if not (folder / "killed").exists():
            (folder / "killed").touch()
            os.kill(json.loads(known.read_text())["pid"], signal.SIGKILL)
"""
DISK_BYTES = 48 << 20
"""What a run of one sample writes is 5 MB; the ballast takes the rest."""


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A server for all programs of a test, whose database is not on their disk."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "server"))
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "server"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with prefect_server() as one:
        yield one


def started(folder: Path, data: Path, url: str, wanted: str, act: str, *words: str) -> "subprocess.Popen[str]":
    """`dcap` in a process of its own, which notes the stages with processes and does something as one begins; with a
    server of its own where `url` names none."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    server = {"PREFECT_API_URL": url} if url else {}
    return subprocess.Popen(
        [sys.executable, "-c", WATCHED.replace("WANTED", act), str(folder), wanted, *words],
        env=environment | {"DCAP_DATA": str(data), "PYTHONPATH": str(PROJECT_ROOT)} | server,
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_until(true: Callable[[], object], seconds: float = PATIENCE) -> None:
    """Wait for something that comes true."""
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def results(data: Path) -> dict[str, object]:
    """What the last run gave for each sample: its verdict, and the digest of what each stage returned."""
    samples = (data / "runs" / "last" / "samples").resolve()
    return {
        str(path.parent.relative_to(samples)): (
            json.loads((path.parent / "placement.json").read_text())["verdict"],
            json.loads(path.read_text()),
        )
        for path in samples.rglob(RECORDS)
    }


def finished(process: "subprocess.Popen[str]") -> str:
    """What a program said on standard error that came to its end."""
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    return err


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_run_that_is_killed_in_any_stage_goes_on(tmp_path: Path, url: str) -> None:
    """Killed in each stage that has a process, one after another, no process stays, and what was done before is not
    done again; the last run's results are those of one that nobody has disturbed, digest by digest."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1", "--methods", "dcap,no_drop")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    finished(started(tmp_path, whole, url, "", TELL, *words))
    assert list(dict.fromkeys((tmp_path / "stages").read_text().split())) == STAGES

    done: dict[str, Stamp] = {}
    for stage in STAGES:
        (tmp_path / "begun").unlink(missing_ok=True)
        (tmp_path / "stages").unlink()
        run = started(tmp_path, broken, url, stage, TELL, *words)
        try:
            wait_until(lambda run=run: (tmp_path / "begun").exists() or run.poll() is not None)  # type: ignore[misc]
            family = descendants(run.pid)
        finally:
            run.send_signal(signal.SIGKILL)
            run.communicate()
        assert run.returncode == -signal.SIGKILL
        wait_until(lambda family=family: not any(map(lives, family)), 30.0)  # type: ignore[misc]
        assert len(family) > 1
        assert (tmp_path / "stages").read_text().split()[-1] == stage
        now = kept_records(broken)
        assert now.items() >= done.items()
        assert kept_records(whole).keys() > now.keys()  # the stage itself is not done
        done = now
    finished(started(tmp_path, broken, url, "", TELL, *words))
    assert kept_records(broken).items() >= done.items()
    assert kept_records(broken).keys() == kept_records(whole).keys()
    assert results(broken) == results(whole)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_slot_of_a_killed_run_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the only simulation that may run: its server is gone with the run, and the next one does not wait for ever."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    monkeypatch.setenv("DCAP_RUN__SIMULATIONS", "1")
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1")
    run = started(tmp_path, tmp_path / "data", "", "drop", TELL, *words)
    wait_until(lambda: (tmp_path / "begun").exists() or run.poll() is not None)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    assert run.returncode == -signal.SIGKILL
    finished(started(tmp_path, tmp_path / "data", "", "", TELL, *words))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("stage", ["particles", "drop"])
def test_a_run_whose_server_is_killed_in_a_stage_ends_as_any_other(tmp_path: Path, url: str, stage: str) -> None:
    """The server is started again and the sample begins again; the results are those of a run that nobody has
    disturbed, digest by digest."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1")
    finished(started(tmp_path, tmp_path / "whole", url, "", TELL, *words))
    (tmp_path / "stages").unlink()
    finished(started(tmp_path, tmp_path / "broken", "", stage, KILL_SERVER, *words))
    assert (tmp_path / "stages").read_text().split().count(stage) <= 2
    log = (tmp_path / "broken" / "cache" / "prefect" / "server.log").read_text()
    assert log.count("Configure Prefect") == 2  # that one's, and that of the next
    assert results(tmp_path / "broken") == results(tmp_path / "whole")


def lives(pid: int) -> bool:
    """Whether a process is there that is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk that is soon full."""
    (place := tmp_path / "disk").mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(place)]
    try:
        refused = subprocess.run(mount, capture_output=True, text=True, check=False).stderr
    except OSError as error:
        refused = str(error)
    if refused:
        pytest.skip(f"no disk can be mounted here: {refused.strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], check=True)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("command", ["place", "benchmark"])
def test_a_disk_that_is_full_in_the_middle_is_told(small_disk: Path, tmp_path: Path, url: str, command: str) -> None:
    """The program ends with a line that names the disk, and leaves nothing half-written; once there is room, the next
    one finishes, and what was done before is not done again."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    words = {
        "place": ("place", "room.glb", "mug.glb", "put the mug on the desk", "--out", str(small_disk / "out")),
        "benchmark": ("benchmark", "--dataset", str(dataset), "--workers", "1"),
    }[command]
    run = started(tmp_path, small_disk, url, "drop", FILL.strip(), *words)
    _, err = run.communicate(timeout=PATIENCE)
    assert run.returncode == 2, err
    assert "Traceback" not in err
    (line,) = (one.partition("dcap: ")[2] for one in err.splitlines() if "dcap: " in one)
    assert "No space left on device; free are 0 MiB in DCAP_DATA" in line
    assert str(small_disk) in line
    assert not (small_disk / "out").exists()
    assert all(path.stat().st_size for path in (small_disk / "runs").rglob("*.json"))

    (small_disk / "ballast").unlink()
    before = kept_records(small_disk)
    (tmp_path / "stages").unlink()
    finished(started(tmp_path, small_disk, url, "", TELL, *words))
    assert kept_records(small_disk).items() > before.items()
    assert "particles" not in (tmp_path / "stages").read_text().split()
