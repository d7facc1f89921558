"""Runs a function in its own process: a crash, a memory leak or a second `ti.init` stays inside that process.

The processes are forked by the fork server of `multiprocessing`, which has loaded the modules of heavy stages
(preload.py). Each process leads its own session, and ends with the program even if the program is killed.
"""

import ctypes
import logging
import multiprocessing
import os
import resource
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from multiprocessing.reduction import ForkingPickler
from types import ModuleType
from typing import Any, TypeVar

from threadpoolctl import threadpool_limits

from dcap.scene.errors import DcapError, MachineError
from tasks.code import PACKAGES
from tasks.machine_errors import machine_error

ResultT = TypeVar("ResultT")
OnProgress = Callable[[float, str], None]
"""Called with the completed share of the work, 0 if unknown, and a text."""
MOST_SECONDS = 3600.0
"""Time after which a stage counts as hanging [s]; budgets count steps, so this never decides a result."""
LAST_LINES = 15
PR_SET_PDEATHSIG = 1
SAFE_PATH = "PYTHONSAFEPATH"
CONTEXT: Any = multiprocessing.get_context("forkserver" if sys.platform == "linux" else "spawn")
_starting = threading.Lock()
_running: set[BaseProcess] = set()
_interrupted, _preloaded = threading.Event(), threading.Event()


class _EndedError(Exception):
    """A process has closed its pipe."""


class StageProcessError(RuntimeError):
    """The process of a stage ended without a result."""


def preload() -> None:
    """Start the fork server if needed: it takes three seconds to load, in parallel to the program."""
    from multiprocessing import forkserver

    with _starting:
        if _preloaded.is_set() or sys.platform != "linux":
            return
        _preloaded.set()
        CONTEXT.set_forkserver_preload(["dcap", "tasks.preload"])  # it finds our packages before any others
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # a Ctrl-C is meant for this program
        safe = os.environ.get(SAFE_PATH)
        os.environ[SAFE_PATH] = "1"  # prevents imports from the working directory
        try:
            forkserver.ensure_running()
        finally:
            os.environ.pop(SAFE_PATH)
            if safe is not None:
                os.environ[SAFE_PATH] = safe
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_in_process(function: Callable[..., ResultT], *arguments: object, on_progress: OnProgress) -> ResultT:
    """Run a module-level function in a process of its own and return its result.

    Errors of the function are raised here; StageProcessError if the process ends without a result, KeyboardInterrupt if
    it ends because the program was interrupted.
    """
    preload()
    receiver, sender = CONTEXT.Pipe(duplex=False)
    # an unnamed file, so that nothing remains if this program is killed
    with tempfile.TemporaryFile("w+", errors="replace") as output, receiver:
        printed = Connection(os.dup(output.fileno()), readable=False)  # a descriptor that can be sent
        process = _start((sender, printed, dict(os.environ), function, arguments))
        sender.close()
        printed.close()
        try:
            result: ResultT = _listen(process, receiver, on_progress)
            return result
        except _EndedError:
            process.join()
            if _interrupted.is_set():
                raise KeyboardInterrupt from None
            output.seek(0)
            tail, code = "".join(output.readlines()[-LAST_LINES:]), process.exitcode or 0
            end = f"signal {signal.Signals(-code).name}" if code < 0 else f"status {code}"
            raise StageProcessError(f"the stage's process ended with {end}\n{tail}") from None
        finally:
            _running.discard(process)
            _kill(process)
            process.join()


def interrupt() -> None:
    """Kill the processes of all running stages, and prevent new ones."""
    _interrupted.set()
    for process in list(_running):
        _kill(process)


def _start(job: tuple[object, ...]) -> BaseProcess:
    """Start a process; `multiprocessing` would run the user's script again in it, so the script is hidden."""
    with _starting:
        if _interrupted.is_set():
            raise KeyboardInterrupt
        process: BaseProcess = CONTEXT.Process(target=_work, args=job)
        main, sys.modules["__main__"] = sys.modules["__main__"], ModuleType("__main__")
        try:
            process.start()
        finally:
            sys.modules["__main__"] = main
        _running.add(process)
        return process


def _listen(process: BaseProcess, receiver: Connection, on_progress: OnProgress) -> Any:
    """Return the result that a process sends; raises _EndedError if it ends without a result, MachineError if it
    hangs."""
    deadline = time.monotonic() + MOST_SECONDS
    while True:
        if not receiver.poll(max(deadline - time.monotonic(), 0.0)):
            raise MachineError(
                f"the stage has run for {MOST_SECONDS / 3600:g} h and hangs, or this machine is too slow"
            )
        try:
            kind, *content = receiver.recv()
        except EOFError:
            raise _EndedError from None
        if kind == "progress":
            on_progress(*content)
        elif kind == "error":
            raise content[0]
        else:
            return content[0]


def _kill(process: BaseProcess) -> None:
    """Kill a process and its children."""
    if process.pid is not None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        if process.is_alive():  # it does not lead a process group yet
            process.kill()


def _work(
    sender: Connection,
    output: Connection,
    environment: Mapping[str, str],
    function: Callable[..., object],
    arguments: tuple[object, ...],
) -> None:
    """Do the job in the process started for it."""
    os.setsid()
    die_with_parent()
    threading.Thread(target=_end_with_program, daemon=True).start()
    os.dup2(output.fileno(), 1)
    os.dup2(output.fileno(), 2)
    output.close()
    os.environ.clear()
    os.environ.update(environment)  # the fork server still has the environment from when it started
    for package in PACKAGES:
        logging.getLogger(package).setLevel(logging.INFO)
        logging.getLogger(package).addHandler(_ProgressHandler(sender))
    # additional threads for small matrices would spin while waiting, at the cost of other processes
    threadpool_limits(1, user_api="blas")
    try:
        result = function(*arguments)
    except Exception as error:
        sender.send(("error", _portable(error)))
        return
    usage = resource.getrusage(resource.RUSAGE_SELF)
    used = f"{usage.ru_utime + usage.ru_stime:.2f} s of processor time, {usage.ru_maxrss / 1024:.0f} MiB"
    sender.send(("progress", 1.0, used))
    sender.send(("done", result))


def _portable(error: Exception) -> Exception:
    """Return an error that another process can read; a bug of ours carries its traceback as a note."""
    known = error if isinstance(error, DcapError) else machine_error(error)
    if known is not None:
        return known
    where = "".join(traceback.format_exception(error))
    try:
        ForkingPickler.loads(ForkingPickler.dumps(error))  # as the pipe does
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(where)
    return error


def die_with_parent() -> None:
    """Let the kernel kill this process when its parent dies."""
    if sys.platform == "linux":
        parent = os.getppid()
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)


def _end_with_program() -> None:
    """Wait for the end of the requesting program, and kill this process with all its children.

    The parent is the fork server, which lives as long as any of its processes.
    """
    program = multiprocessing.parent_process()
    assert program is not None
    program.join()
    os.killpg(0, signal.SIGKILL)


class _ProgressHandler(logging.Handler):
    """Sends our code's log records to the parent; `extra={"progress": 0.4}` is the completed share of the work."""

    def __init__(self, sender: Connection) -> None:
        super().__init__(logging.INFO)
        self.sender = sender

    def emit(self, record: logging.LogRecord) -> None:
        """Send one record."""
        self.sender.send(("progress", getattr(record, "progress", 0.0), record.getMessage()))
