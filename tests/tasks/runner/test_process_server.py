"""A forked process of a stage is like one with an interpreter of its own, but starts at once."""

import json
import os
import signal
import subprocess
import sys
import textwrap
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
from process_jobs import JOBS, ROOT, alive, job, quiet, serving, told, wait_until

from dcap.scene.errors import InputError
from flows.place import STAGES
from tasks.measure.drift import drift_task
from tasks.runner import process
from tasks.runner import process_server as process_server_module
from tasks.runner.process import StageProcessError, run_in_process
from tasks.runner.process_server import (
    START_METHOD,
    process_server,
    start_method,
    surroundings,
)

MIB = 2**20


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


def test_what_a_stage_loads_when_it_runs_is_there_beforehand(folder: Path) -> None:
    """Not once in each of its processes."""
    with serving() as server:
        assert told("loaded", folder / "told", server) is True


@pytest.mark.slow
def test_a_stage_starts_no_threads_that_a_fork_would_lose() -> None:
    """Loading a stage that runs in a process of its own does not start Taichi, nor threads other than those of OpenBLAS
    and of Arrow's allocator, which prepare for forks."""
    apart = [one for one in (*STAGES, drift_task) if one.process is not False]
    modules = sorted({name for one in apart for name in (one.function.__module__, *one.loads)})
    assert {"solver.settle", "solver.onward"} < set(modules)
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


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_a_process_that_is_killed_in_the_middle_of_a_line_is_told(
    folder: Path, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As one that is killed at any other time, by a system that is out of memory say; half a report is none."""
    monkeypatch.setenv(START_METHOD, method)
    with process_server(["fake_jobs"]) as server, pytest.raises(StageProcessError, match="ended with signal SIGKILL"):
        run_in_process(job("tear", folder / "path"), quiet, server)


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


def test_jobs_of_a_kind_share_a_process(folder: Path) -> None:
    """A process that has done a job does the next of its kind, and tells what each took alone; another kind, a job that
    failed, a process that has died since and a changed environment get a new one."""
    with serving() as server:

        def pid_of(kind: str) -> int:
            run_in_process(job("own_pid", folder / "pid"), quiet, server, kind)
            return int((folder / "pid").read_text())

        first = pid_of("a")
        assert alive(first)
        assert pid_of("a") == first
        assert first not in (pid_of("b"), pid_of(""))
        peaks = [run_in_process(job("fill", folder / "p", mib=n), quiet, server, "a")["peak_memory"] for n in (300, 0)]
        assert peaks[1] < 300 * MIB <= peaks[0]
        with pytest.raises(StageProcessError, match="last words"):
            run_in_process(job("crash", folder / "path"), quiet, server, "a")
        second = pid_of("a")
        assert second != first
        os.kill(second, signal.SIGKILL)
        wait_until(lambda: not alive(second))
        third = pid_of("a")
        assert third not in (first, second)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("DCAP_SOMETHING", "new")
            assert pid_of("a") != third
        wait_until(lambda: not alive(third))
        last = pid_of("a")
    wait_until(lambda: not alive(last))


def test_what_is_said_of_a_kept_process_is_of_its_last_job(folder: Path) -> None:
    """The last words of a process that was kept are those of the job that ended it."""
    with serving() as server:
        run_in_process(job("complain", folder / "path"), quiet, server, "a")
        with pytest.raises(StageProcessError) as caught:
            run_in_process(job("crash", folder / "path"), quiet, server, "a")
        assert str(caught.value) == "the stage's process ended with signal SIGSEGV\nlast words\n"


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
