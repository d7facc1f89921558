"""A server that is lost, stuck or short of descriptors costs no more than what it must."""

import json
import os
import signal
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from process_jobs import alive, job, quiet, serving, told, wait_until

from tasks.runner import process
from tasks.runner import process_server as process_server_module
from tasks.runner.process import StageProcessError, run_in_process
from tasks.runner.process_server import (
    ForkedProcess,
    InterruptedRunError,
    NotForkedError,
)


@pytest.mark.slow
def test_a_lost_server_is_survived(folder: Path) -> None:
    """A job whose server is killed fails as one whose process is killed, nothing that it started is left, and the error
    says how the server ended; the next gets a process of its own."""
    with serving() as server:
        path = folder / "pids"
        with ThreadPoolExecutor(1) as pool:
            doomed = pool.submit(run_in_process, job("family", path), quiet, server)
            wait_until(path.exists)
            os.kill(server.pid, signal.SIGKILL)
            said = r"^the stage's .* signal SIGKILL\nthe server that had forked it ended with signal SIGKILL\n$"
            with pytest.raises(StageProcessError, match=said):
                doomed.result()
        wait_until(lambda: not any(alive(pid) for pid in json.loads(path.read_text())))
        assert told("write_name", folder / "name", server) == [str(folder / "name"), os.getpid()]


def test_a_kept_process_whose_server_is_lost_is_no_longer_there(folder: Path) -> None:
    """The next job of its kind gets a process of its own, and the run ends: nobody waits for the lost one."""
    with serving() as server:
        run_in_process(job("write_name", folder / "first"), quiet, server, "a")
        os.kill(server.pid, signal.SIGKILL)
        wait_until(lambda: not alive(server.pid))
        with ThreadPoolExecutor(1) as pool:
            pool.submit(run_in_process, job("write_name", folder / "name"), quiet, server, "a").result(timeout=60.0)
        assert json.loads((folder / "name").read_text()) == [str(folder / "name"), os.getpid()]


@pytest.mark.slow
def test_the_last_words_of_a_server_are_told(folder: Path) -> None:
    """A job whose server crashes while it loads another's module quotes what the server said; the other is spawned."""
    (folder / "fake_last.py").write_text(
        "import sys\nfrom fake_jobs import *\nif 'fork_server' in ' '.join(sys.orig_argv): sys.exit('no way out')"
    )
    with serving() as server, ThreadPoolExecutor(1) as pool:
        doomed = pool.submit(run_in_process, job("family", folder / "pids"), quiet, server)
        wait_until((folder / "pids").exists)
        run_in_process(job("write_name", folder / "name", "fake_last"), quiet, server)
        said = r"the server that had forked it ended with status 1\n(.|\n)*no way out"
        with pytest.raises(StageProcessError, match=said):
            doomed.result()


HANGS_IN_SERVER = """
import sys, time
from pathlib import Path
from fake_jobs import *
if "fork_server" in " ".join(sys.orig_argv):
    Path(__file__).with_name("loading").touch()
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_server_that_hangs_is_given_up(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A job whose module hangs in the server is spawned once time is up; one at work ends, and its error says why."""
    (folder / "fake_hang.py").write_text(HANGS_IN_SERVER)
    with serving() as server, ThreadPoolExecutor(1) as pool:
        doomed = pool.submit(run_in_process, job("family", folder / "pids"), quiet, server)
        wait_until((folder / "pids").exists)
        monkeypatch.setattr(process_server_module, "START_SECONDS", 0.5)
        run_in_process(job("write_name", folder / "name", "fake_hang"), quiet, server)
        assert json.loads((folder / "name").read_text()) == [str(folder / "name"), os.getpid()]
        with pytest.raises(StageProcessError, match=r"not started a process for fake_hang in 0\.5 s"):
            doomed.result()
        wait_until(lambda: not any(alive(pid) for pid in json.loads((folder / "pids").read_text())))


@pytest.mark.slow
@pytest.mark.parametrize("forked", [True, False], ids=["forked", "spawned"])
def test_what_an_interrupt_kills_has_not_failed(folder: Path, forked: bool) -> None:
    """The thread that waits for it is told that the run was interrupted, not that its process was killed."""
    with serving() as server, ThreadPoolExecutor(1) as pool:
        doomed = pool.submit(run_in_process, job("family", folder / "pids"), quiet, server if forked else None)
        wait_until((folder / "pids").exists)
        process.kill_all()
        with pytest.raises(InterruptedRunError, match="the run was interrupted"):
            doomed.result(timeout=20.0)


@pytest.mark.slow
def test_an_interrupt_ends_starts_that_wait(folder: Path) -> None:
    """An interrupted program kills also what waits for the server, and starts nothing more for that run."""
    (folder / "fake_hang.py").write_text(HANGS_IN_SERVER)
    with serving() as server, ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(run_in_process, job("write_name", folder / "name", "fake_hang"), quiet, server)
        wait_until((folder / "loading").exists)
        process.kill_all()
        with pytest.raises(InterruptedRunError):
            waiting.result(timeout=20.0)
        with pytest.raises(InterruptedRunError):
            run_in_process(job("write_name", folder / "name"), quiet, server)
    assert not (folder / "name").exists()


@pytest.mark.slow
def test_a_server_without_descriptors_keeps_its_children(folder: Path) -> None:
    """Where the server has no descriptor left for a new child, that one is refused and gone; those at work go on."""
    (folder / "fake_full.py").write_text(
        "import os, resource\nfrom contextlib import suppress\nfrom fake_jobs import *\n"
        "most = max(map(int, os.listdir('/proc/self/fd'))) + 2\n"
        "resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))\n"
        "with suppress(OSError):\n    while True: os.dup(0)\n"
    )
    with serving() as server, ThreadPoolExecutor(1) as pool:
        beside = pool.submit(run_in_process, job("family", folder / "pids"), quiet, server)
        wait_until((folder / "pids").exists)
        with pytest.raises(OSError, match="Too many open files"):
            run_in_process(job("write_name", folder / "name", "fake_full"), quiet, server)
        child = json.loads((folder / "pids").read_text())[0]
        assert Path(f"/proc/{server.pid}/task/{server.pid}/children").read_text().split() == [str(child)]
        assert alive(child)
        for one in list(process.running):
            one.kill()
        with pytest.raises(StageProcessError, match=r"signal SIGKILL\n$"):
            beside.result()


def test_a_start_that_fails_leaves_nothing_open(folder: Path) -> None:
    """A process that the server does not start leaves no descriptor open, nor to the garbage collector."""
    with serving() as server, tempfile.TemporaryFile("w+") as errors:
        os.kill(server.pid, signal.SIGKILL)
        wait_until(lambda: not alive(server.pid))
        before = os.listdir("/proc/self/fd")
        with pytest.raises(NotForkedError) as caught:  # its frames keep what was opened from the garbage collector
            ForkedProcess(server, "fake_jobs", errors)
        assert os.listdir("/proc/self/fd") == before
        del caught


@pytest.mark.slow
def test_a_module_that_cannot_be_loaded_is_told(folder: Path) -> None:
    """A stage whose module fails or crashes while it is loaded is reported as by a process started anew."""
    with serving() as server:
        (folder / "fake_broken.py").write_text("raise ValueError('broken on purpose')")
        (folder / "fake_crash.py").write_text("import os; os.abort()")
        with pytest.raises(StageProcessError, match=r"status 1\n(.|\n)*ValueError: broken on purpose"):
            run_in_process(job("stage", folder / "path", "fake_broken"), quiet, server)
        assert told("write_name", folder / "name", server) == [str(folder / "name"), server.pid]
        with pytest.raises(StageProcessError, match="signal SIGABRT"):
            run_in_process(job("stage", folder / "path", "fake_crash"), quiet, server)
