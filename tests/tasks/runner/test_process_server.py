"""A forked process of a stage is like one with an interpreter of its own, but starts at once."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace

import pytest

from dcap.scene.errors import InputError
from flows.place import STAGES
from tasks.runner import process
from tasks.runner import process_server as process_server_module
from tasks.runner.process import StageProcessError, run_in_process
from tasks.runner.process_server import (
    START_METHOD,
    ForkedProcess,
    InterruptedRunError,
    NotForkedError,
    ProcessServer,
    process_server,
    start_method,
    surroundings,
)

MIB = 2**20
ROOT = Path(__file__).parents[3]
JOBS = """
import json, os, re, signal, subprocess, sys, threading, time
from pathlib import Path
import numpy as np
from dcap.scene.types.outcome import Infeasible, Reason

DONE = Infeasible(Reason.NO_SUPPORT_HIT, "done", None)

def describe(path: str) -> Infeasible:
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    links = {one: f"/proc/self/fd/{one}" for one in os.listdir("/proc/self/fd")}  # and that of the listing, gone by now
    files = {one: re.sub("[0-9]+", "", os.readlink(link)) for one, link in links.items() if os.path.lexists(link)}
    told = {
        "environment": dict(os.environ), "native": Path("/proc/self/environ").read_text(), "folder": os.getcwd(),
        "path": sys.path, "arguments": [Path(sys.argv[0]).name, sys.argv[1] == str(os.getppid())],
        "leads": [os.getsid(0) == os.getpid(), os.getpgid(0) == os.getpid()], "files": files,
        "signals": [status[name] for name in ("SigBlk", "SigIgn", "SigCgt")], "umask": status["Umask"],
        "python": [repr(signal.getsignal(one)) for one in (signal.SIGINT, signal.SIGTERM, signal.SIGCHLD)],
        "threads": threading.active_count(), "cores": sorted(os.sched_getaffinity(0)),
        "streams": [[one.encoding, one.errors] for one in (sys.stdin, sys.stdout, sys.stderr)],
    }
    Path(path).write_text(json.dumps(told))
    return DONE

def multiply(path: str) -> Infeasible:
    import hashlib, scipy.linalg
    a = np.random.default_rng(0).random((600, 600))
    digests = [hashlib.sha256(one.tobytes()).hexdigest() for one in (a @ a, scipy.linalg.lu(a)[2])]
    names = [one.read_text().strip() for one in Path("/proc/self/task").glob("*/comm")]
    Path(path).write_text(json.dumps([digests, len(names) - names.count("jemalloc_bg_thd")]))  # comes and goes
    return DONE

def crash(path: str) -> Infeasible:
    print("last words", file=sys.stderr, flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)

def family(path: str) -> Infeasible:
    grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    draft = Path(path + ".draft")
    draft.write_text(json.dumps([os.getpid(), grandchild.pid]))
    draft.rename(path)
    time.sleep(60)

def orphan(path: str) -> Infeasible:
    grandchild = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"])
    Path(path).write_text(json.dumps(grandchild.pid))
    return DONE

def write_name(path: str) -> Infeasible:
    time.sleep(0.2)
    Path(path).write_text(json.dumps([path, os.getppid()]))
    return DONE

def fill(path: str, mib: int) -> Infeasible:
    np.ones(mib * 2**20, np.uint8)
    return DONE
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder, with the fake stages on the path of processes."""
    (tmp_path / "fake_jobs.py").write_text(JOBS)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(tmp_path)]))
    monkeypatch.delenv(START_METHOD, raising=False)
    return tmp_path


@contextmanager
def serving() -> Iterator[ProcessServer]:
    """A server; in the body of a test, because pytest changes the environment between a fixture and the test."""
    with process_server(["fake_jobs"]) as server:
        assert server is not None
        yield server


def job(function: str, path: Path, module: str = "fake_jobs", **inputs: object) -> dict[str, object]:
    """A job for a process."""
    values = {"path": str(path)} | inputs
    return {
        "module": module,
        "function": function,
        "inputs": {name: {"value": value} for name, value in values.items()},
        "config": None,
        "session": {},
    }


def quiet(part: float, text: str) -> None:
    """Hears nothing."""


def told(function: str, path: Path, server: ProcessServer | None) -> object:
    """What a job writes."""
    run_in_process(job(function, path), quiet, server)
    return json.loads(path.read_text())


def alive(pid: int) -> bool:
    """Whether a process runs (a dead one that nobody has waited for does not)."""
    with suppress(FileNotFoundError):
        return Path(f"/proc/{pid}/stat").read_text().split(")")[1].split()[0] != "Z"
    return False


def wait_until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait for a condition; fail if it never comes."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)


def test_a_forked_process_is_like_a_spawned_one(folder: Path) -> None:
    """Environment, folders, arguments, descriptors, signals, session and streams are those of a process started anew,
    also while another job is at work."""
    with serving() as server:
        with ThreadPoolExecutor(1) as pool:
            beside = pool.submit(run_in_process, job("write_name", folder / "beside"), quiet, server)
            forked = told("describe", folder / "forked", server)
            beside.result()
        assert forked == told("describe", folder / "spawned", None)


@pytest.mark.slow
def test_native_libraries_compute_alike(folder: Path) -> None:
    """Linear algebra of numpy and scipy in a forked process returns the bytes that it returns in a spawned one, with as
    many threads."""
    with serving() as server:
        assert told("multiply", folder / "forked", server) == told("multiply", folder / "spawned", None)


@pytest.mark.slow
def test_a_stage_starts_no_threads_that_a_fork_would_lose() -> None:
    """Loading a stage that runs in a process of its own does not start Taichi, nor threads other than those of OpenBLAS
    and of Arrow's allocator, which prepare for forks."""
    modules = sorted({one.function.__module__ for one in STAGES if one.process is not False})
    assert "tasks.drop.stage" in modules
    program = f"""
        import importlib, json, os, sys
        for module in {modules}: importlib.import_module(module)
        from pathlib import Path
        from threadpoolctl import threadpool_info
        from taichi.lang import impl
        names = [one.read_text().strip() for one in Path("/proc/self/task").glob("*/comm")]
        pools = threadpool_info()
        print(json.dumps([names, [one["internal_api"] for one in pools], [one["num_threads"] for one in pools],
                          impl.pytaichi.prog is None]))
    """
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", textwrap.dedent(program)]
    output = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    names, kinds, sizes, taichi_is_off = json.loads(output.splitlines()[-1])
    assert taichi_is_off
    assert set(kinds) == {"openblas"}
    others = [name for name in names if name != "jemalloc_bg_thd"]
    assert len(others) <= 1 + sum(size - 1 for size in sizes)  # the program's own, and the pools' beside those who ask


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_a_segmentation_fault_is_told(folder: Path, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that crashes is an error here that names the signal and its last words, however it was started."""
    monkeypatch.setenv(START_METHOD, method)
    with (
        process_server(["fake_jobs"]) as server,
        pytest.raises(StageProcessError, match=r"^the stage's process ended with signal SIGSEGV\n(.|\n)*last words\n$"),
    ):
        run_in_process(job("crash", folder / "path"), quiet, server)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_time_up_kills_the_group(folder: Path, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage that runs too long is killed with everything that it started, however it was started."""
    monkeypatch.setenv(START_METHOD, method)
    path, asked = folder / "pids", []

    def timer(seconds: float, function: Callable[[], None]) -> threading.Timer:
        asked.append(seconds)
        return threading.Timer(0.0, lambda: (wait_until(path.exists), function()))  # time is up once the group is there

    monkeypatch.setattr(process, "threading", SimpleNamespace(Timer=timer))
    with process_server(["fake_jobs"]) as server, pytest.raises(StageProcessError, match="signal SIGKILL"):
        run_in_process(job("family", path), quiet, server)
    assert asked == [process.MOST_SECONDS]
    pids = json.loads(path.read_text())
    wait_until(lambda: not any(alive(pid) for pid in pids))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_nothing_outlives_a_stage(folder: Path, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a stage started and did not wait for is killed when it has ended."""
    monkeypatch.setenv(START_METHOD, method)
    with process_server([]) as server:
        pid = told("orphan", folder / "pid", server)
        assert isinstance(pid, int)
        wait_until(lambda: not alive(pid))


def test_a_killed_parent_takes_all_along(folder: Path) -> None:
    """Killing the parent with SIGKILL ends the server, its children, and what those started."""
    path, mark = folder / "pids", folder / "server"
    program = textwrap.dedent(f"""
        from pathlib import Path
        from tasks.runner.process import run_in_process
        from tasks.runner.process_server import process_server
        with process_server([]) as server:
            Path({str(mark)!r}).write_text(str(server.pid))
            run_in_process({job("family", path)!r}, print, server)
    """)
    parent = subprocess.Popen([sys.executable, "-c", program])
    wait_until(path.exists)
    pids = [int(mark.read_text()), *json.loads(path.read_text())]
    assert all(alive(pid) for pid in pids)
    parent.kill()
    parent.wait()
    wait_until(lambda: not any(alive(pid) for pid in pids))


@pytest.mark.slow
def test_jobs_run_at_the_same_time(folder: Path) -> None:
    """Jobs of several threads run side by side, each hears of its own, and killing one leaves the others."""
    with serving() as server, ThreadPoolExecutor(5) as pool:
        doomed = pool.submit(run_in_process, job("family", folder / "pids"), quiet, server)
        wait_until((folder / "pids").exists)
        names = [str(folder / f"{number}") for number in range(4)]
        found = list(pool.map(lambda name: told("write_name", Path(name), server), names))
        assert found == [[name, server.pid] for name in names]
        for one in list(process.running):
            one.kill()
        with pytest.raises(StageProcessError, match="signal SIGKILL"):
            doomed.result()


def test_peak_memory_is_told(folder: Path) -> None:
    """A process that fills 300 MiB has had at least so much; one that fills nothing has not."""
    with serving() as server:
        small, large = (
            run_in_process(job("fill", folder / "path", mib=mib), quiet, server)["peak_memory"] for mib in (0, 300)
        )
        assert small < 300 * MIB <= large < 600 * MIB


def test_a_changed_environment_is_seen(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A variable that is set while a run goes on, and another working directory, reach the next process."""
    with serving() as server:
        monkeypatch.setenv("OMP_NUM_THREADS", "1")
        monkeypatch.chdir(folder)
        found = told("describe", folder / "path", server)
        assert isinstance(found, dict)
        assert found["environment"]["OMP_NUM_THREADS"] == "1"
        assert found["folder"] == str(folder)


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


def test_a_source_file_that_goes_is_a_change(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A source that is deleted while the sources are looked at makes them others, and no error; a link to nothing, as
    editors make, stays as it is."""
    monkeypatch.setattr(process_server_module, "SOURCES", (folder,))
    (folder / ".#edited.py").symlink_to("user@host.1")
    before = surroundings()
    assert surroundings() == before
    listed = list(folder.rglob("*.py"))
    (folder / "fake_jobs.py").unlink()
    monkeypatch.setattr(process_server_module, "SOURCES", (SimpleNamespace(rglob=lambda pattern: listed),))
    assert surroundings() != before


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


def test_a_server_ends_with_its_run(folder: Path) -> None:
    """A server is gone after the run that it was started for, also if it is still loading."""
    (folder / "fake_slow.py").write_text("import time; time.sleep(60)")
    with process_server(["fake_slow"]) as server:
        assert server is not None
        assert alive(server.pid)
    assert not alive(server.pid)


@pytest.mark.slow
def test_a_stage_runs_the_code_on_disk(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stage that is edited during a run goes on as it is on disk, as its record says; a new run forks again."""
    monkeypatch.setattr(process_server_module, "SOURCES", (folder,))
    with serving() as server:
        assert told("write_name", folder / "first", server) == [str(folder / "first"), server.pid]
        (folder / "fake_jobs.py").write_text(JOBS.replace("path, os.getppid()", "'edited', os.getppid()"))
        assert told("write_name", folder / "second", server) == ["edited", os.getpid()]
    with serving() as server:
        assert told("write_name", folder / "third", server) == ["edited", server.pid]


def test_the_start_method_is_chosen_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    """DCAP_START_METHOD=spawn leaves the server out; a word that is no method is refused by name."""
    monkeypatch.setenv(START_METHOD, "spawn")
    with process_server([]) as server:
        assert server is None
    monkeypatch.setenv(START_METHOD, "thread")
    with pytest.raises(InputError, match="DCAP_START_METHOD=thread is none of forkserver, spawn"):
        start_method()


def test_a_system_without_forks_spawns(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the server cannot run, processes are spawned, and asking for it says what it needs."""
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.delenv(START_METHOD, raising=False)
    assert start_method() == "spawn"
    monkeypatch.setenv(START_METHOD, "forkserver")
    with pytest.raises(InputError, match="needs Linux; use spawn"):
        start_method()
