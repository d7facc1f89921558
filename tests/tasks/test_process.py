"""A job has a process of its own, which nothing outlives."""

import json
import os
import subprocess
import sys
import traceback
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import patience
import pytest
from foreign_names import LIBRARIES, OURS, foreign_folder, marks
from process_jobs import alive, fail, family, orphan, surroundings

from dcap.scene.errors import InputError, MachineError
from dcap.scene.settings import PROJECT_ROOT
from tasks import process
from tasks.process import run_in_process

wait_until = partial(patience.wait_until, seconds=60.0, every=0.02)
PATHS = os.pathsep.join(map(str, (PROJECT_ROOT, PROJECT_ROOT / "tests" / "support")))


def quiet(part: float, text: str) -> None:
    """Hear nothing."""


def test_nothing_outlives_a_job() -> None:
    """What it has started and did not wait for is killed when it has ended."""
    pid = run_in_process(orphan, on_progress=quiet)
    wait_until(lambda: not alive(pid))


def test_a_job_that_hangs_is_killed_with_all_that_it_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others that run at the same time are not."""
    monkeypatch.setattr(process, "MOST_SECONDS", 3.0)
    with ThreadPoolExecutor(1) as pool:
        hangs = pool.submit(run_in_process, family, str(tmp_path / "pids"), on_progress=quiet)
        wait_until((tmp_path / "pids").exists)
        assert run_in_process(surroundings, on_progress=quiet)[2]
        with pytest.raises(MachineError, match="hangs"):
            hangs.result()
    job, _, grandchild = json.loads((tmp_path / "pids").read_text())
    wait_until(lambda: not alive(job) and not alive(grandchild))


def test_an_interrupted_program_kills_its_jobs_and_starts_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They do not count as jobs that have died."""
    monkeypatch.setattr(process, "_interrupted", type(process._interrupted)())
    with ThreadPoolExecutor(1) as pool:
        killed = pool.submit(run_in_process, family, str(tmp_path / "pids"), on_progress=quiet)
        wait_until((tmp_path / "pids").exists)
        process.interrupt()
        for work in (killed.result, lambda: run_in_process(surroundings, on_progress=quiet)):
            with pytest.raises(KeyboardInterrupt):
                work()
    job, _, grandchild = json.loads((tmp_path / "pids").read_text())
    wait_until(lambda: not alive(job) and not alive(grandchild))


@pytest.mark.parametrize(
    ("how", "kind", "words"),
    [
        ("known", InputError, "no such thing"),
        ("mistake", ValueError, "a mistake"),
        ("end of a file", EOFError, "no more"),
        ("cannot travel", RuntimeError, "CannotTravelError: 1 and 2"),
    ],
)
def test_an_error_is_raised_here_as_it_was_there(tmp_path: Path, how: str, kind: type[Exception], words: str) -> None:
    """Its type decides what is told of it and whether the stage runs again; a mistake of ours tells where it was."""
    with pytest.raises(kind, match=words) as caught:
        run_in_process(fail, how, str(tmp_path / "log"), on_progress=quiet)
    assert type(caught.value) is kind
    details = "".join(traceback.format_exception(caught.value))
    assert ("in fail" in details) is (how != "known")
    assert (tmp_path / "log").read_text() == "ran\n"


PROGRAM = """
import sys
from process_jobs import family
from tasks.process import run_in_process
run_in_process(family, sys.argv[1], on_progress=print)
"""


@pytest.mark.slow
def test_a_program_takes_nothing_from_its_folder_and_all_along(tmp_path: Path) -> None:
    """Its jobs run our tasks and the installed libraries in a folder full of their names; a program that is killed
    takes its job, what that has started and the fork server along."""
    folder, path = foreign_folder(tmp_path, OURS + LIBRARIES), tmp_path / "pids"
    (tmp_path / "program").mkdir()
    (tmp_path / "program" / "main.py").write_text(PROGRAM)
    command = [sys.executable, str(tmp_path / "program" / "main.py"), str(path)]  # its folder leads sys.path
    with subprocess.Popen(command, cwd=folder, env=os.environ | {"PYTHONPATH": PATHS}) as parent:
        wait_until(lambda: path.exists() or parent.poll() is not None)
        job, forks, grandchild = json.loads(path.read_text())
        assert alive(job)
        parent.kill()
    wait_until(lambda: not any(alive(one) for one in (job, forks, grandchild)))
    assert marks(tmp_path) == ""
