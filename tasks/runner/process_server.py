"""How a run starts the processes of its stages: forked by a server that has their modules loaded, or spawned.

A run has one server of its own (fork_server.py beside this). A process is spawned, with an interpreter of its own,
where a forked one would not be the same: the system cannot fork, the server has gone, or environment, working directory
or our source files have changed since it was started.
"""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import IO, Protocol, Self

from dcap.packages import module_command
from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT
from tasks.runner.digests import PACKAGES
from tasks.runner.process_group import Ended, kill_group, reap

START_METHOD = "DCAP_START_METHOD"
"""Environment variable: `forkserver`, the default on Linux, or `spawn`."""
FORK_SERVER, SPAWN = "forkserver", "spawn"
SOURCES = tuple(PROJECT_ROOT / name for name in sorted(PACKAGES))
"""Folders of the code that a stage may load."""


class StageProcess(Protocol):
    """A process that leads a session and waits on its standard input for a job."""

    input: IO[str]
    output: IO[str]

    def wait(self) -> Ended:
        """How it ended; nothing that it started is left."""

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""


class SpawnedProcess:
    """A process with an interpreter of its own; what it writes to standard error goes to the file `errors`."""

    def __init__(self, errors: IO[str]) -> None:
        self._popen = subprocess.Popen(
            module_command("tasks.runner.child", str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            start_new_session=True,
        )
        assert self._popen.stdin is not None
        assert self._popen.stdout is not None
        self.input: IO[str] = self._popen.stdin
        self.output: IO[str] = self._popen.stdout
        self._ended: Ended | None = None
        self._lock = threading.Lock()

    def wait(self) -> Ended:
        """How it ended; nothing that it started is left."""
        with self._lock:
            if self._ended is None:
                self._ended = reap(self._popen.pid)
                self._popen.returncode = self._ended.status
            return self._ended

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""
        if self._ended is None:
            kill_group(self._popen.pid)
        self.wait()


class NotForkedError(Exception):
    """The server has ended before it could fork."""


class ForkedProcess:
    """A child of the server; raises NotForkedError, or OSError if the system has no room for another process."""

    def __init__(self, requests: socket.socket, module: str, errors: IO[str]) -> None:
        self._link, link = socket.socketpair()
        theirs_in, mine_in = os.pipe()
        mine_out, theirs_out = os.pipe()
        self.input: IO[str] = os.fdopen(mine_in, "w")
        self.output: IO[str] = os.fdopen(mine_out)
        self._answers = self._link.makefile()
        self._ended: Ended | None = None
        self._lock = threading.Lock()
        try:
            with suppress(OSError):  # no answer below
                sent = [link.fileno(), theirs_in, theirs_out, errors.fileno()]
                socket.send_fds(requests, [request(module)], sent)
        finally:
            link.close()
            os.close(theirs_in)
            os.close(theirs_out)
        answer = self._answers.readline()
        if not answer:
            raise NotForkedError
        forked = json.loads(answer)
        if "errno" in forked:
            raise OSError(forked["errno"], os.strerror(forked["errno"]))
        self.pid = int(forked["pid"])

    def wait(self) -> Ended:
        """How it ended; nothing that it started is left."""
        with self._lock:
            if self._ended is None:
                answer = self._answers.readline()
                # without the server it does not go on: the kernel has been asked to kill it then
                self._ended = Ended(**json.loads(answer)) if answer else Ended(-signal.SIGKILL, 0.0, 0)
                self._answers.close()
                self._link.close()
            return self._ended

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""
        with suppress(OSError):  # it has ended
            self._link.shutdown(socket.SHUT_WR)
        self.wait()


class ProcessServer:
    """Starts processes for the stages of a run; safe for many threads at once."""

    def __init__(self, modules: Iterable[str]) -> None:
        self._surroundings = surroundings()
        self._requests, requests = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with requests:
            self._popen = subprocess.Popen(
                module_command("tasks.runner.fork_server", str(requests.fileno()), str(os.getpid())),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=[requests.fileno()],
                start_new_session=True,
            )
        self.pid = self._popen.pid
        for module in modules:
            with suppress(OSError):  # it has ended; processes are spawned
                self._requests.sendall(request(module))

    def start(self, module: str, errors: IO[str]) -> StageProcess:
        """A process, with `module` loaded if it is forked; what it writes to standard error goes to `errors`."""
        if surroundings() == self._surroundings:
            with suppress(NotForkedError):
                return ForkedProcess(self._requests, module, errors)
        return SpawnedProcess(errors)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._requests.close()
        self._popen.kill()  # it may be loading
        self._popen.wait()


def request(module: str) -> bytes:
    """What the server is asked for."""
    return json.dumps({"module": module}).encode()


def surroundings() -> tuple[object, ...]:
    """What a process finds when it loads its modules: working directory, environment, and when each of our source
    files was changed; equal if a forked process would be as one that is spawned now."""
    files = sorted(path for folder in SOURCES for path in folder.rglob("*.py"))
    changed = tuple((str(path), path.stat().st_ctime_ns) for path in files)
    return os.getcwd(), dict(os.environ), changed


@contextmanager
def process_server(modules: Iterable[str]) -> Iterator[ProcessServer | None]:
    """A server that loads `modules` at once, for the time of a run; None where processes are spawned."""
    if start_method() == SPAWN:
        yield None
        return
    with ProcessServer(modules) as server:
        yield server


def start_method() -> str:
    """What $DCAP_START_METHOD says, by default what works here; InputError for anything else."""
    usual = FORK_SERVER if sys.platform == "linux" else SPAWN
    method = os.environ.get(START_METHOD, "") or usual
    if method not in (FORK_SERVER, SPAWN):
        raise InputError(f"{START_METHOD}={method} is none of {FORK_SERVER}, {SPAWN}")
    if method == FORK_SERVER != usual:
        raise InputError(f"{START_METHOD}={method} needs Linux; use {SPAWN}")
    return method
