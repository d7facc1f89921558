"""Fake stages for processes, and what is asked of them."""

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path

import patience

from tasks.runner.process import run_in_process
from tasks.runner.process_server import ProcessServer, process_server

ROOT = Path(__file__).parents[2]
JOBS = """
import json, logging, os, re, signal, subprocess, sys, threading, time
from pathlib import Path
import numpy as np
from dcap.scene.types.outcome import Infeasible, Reason
from tasks.runner.stage import stage

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

def loaded(path: str) -> Infeasible:
    Path(path).write_text(json.dumps("wave" in sys.modules))
    return DONE

loaded_task = stage(loaded, loads=("wave",))

def crash(path: str) -> Infeasible:
    print("last words", file=sys.stderr, flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)

def tear(path: str) -> Infeasible:
    report = next(one.report for one in logging.getLogger("tasks").handlers if hasattr(one, "report"))
    report.write('{"done": {"ref": "of a kin')
    report.flush()
    os.kill(os.getpid(), signal.SIGKILL)

def own_pid(path: str) -> Infeasible:
    Path(path).write_text(str(os.getpid()))
    return DONE

def complain(path: str) -> Infeasible:
    print("a complaint", file=sys.stderr, flush=True)
    return DONE

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
    """Whether a process runs (a dead one that nobody has waited for does not).

    Any of its threads counts: the last that ends closes what it had open.
    """
    with suppress(FileNotFoundError, ProcessLookupError):
        stats = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/stat")]
        return any(one.rpartition(")")[2].split()[0] not in "ZX" for one in stats)
    return False


wait_until = partial(patience.wait_until, seconds=20.0, every=0.02)
