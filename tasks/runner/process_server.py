"""How a run starts the processes of its stages: forked by a server that has their modules loaded, or spawned.

A run has one server of its own (fork_server.py beside this). A process that has done its job may be kept for the next
one that is started alike: what simulates has Taichi's kernels read by then. A process is spawned, with an interpreter
of its own, where a forked one would not be the same: the system cannot fork, the server has gone, or environment,
working directory or our source files have changed since it was started. Each wait for the server ends: a server that
does not answer a request in START_SECONDS is killed, and with it the children that it alone could tell about.
"""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Protocol, Self

from dcap.packages import module_command
from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT
from tasks.runner.digests import PACKAGES
from tasks.runner.process_group import exit_words, kill_group, reap

START_METHOD = "DCAP_START_METHOD"
"""Environment variable: `forkserver`, the default on Linux, or `spawn`."""
FORK_SERVER, SPAWN = "forkserver", "spawn"
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
SOURCES = tuple(PROJECT_ROOT / name for name in sorted(PACKAGES))
"""Folders of the code that a stage may load."""
START_SECONDS = 300.0
"""A start that takes longer hangs. It is about a hundred times what loading takes, for cold disks and busy machines: a
server that is given up takes the children at work with it."""
LOST_SECONDS = 5.0
"""For how long the exit status of a server is waited for that has closed its sockets [s]; the kernel does both."""
LAST_LINES = 10

servers: set["ProcessServer"] = set()


class StageProcess(Protocol):
    """A process that leads a session and waits on its standard input for jobs, until that is closed."""

    input: IO[str]
    output: IO[str]
    errors: IO[str]
    """What it writes to standard error; whoever opened the file for it closes it."""

    def wait(self) -> int:
        """Exit status once it has ended; nothing that it started is left."""

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""


class SpawnedProcess:
    """A process with an interpreter of its own; what it writes to standard error goes to the file `errors`."""

    def __init__(self, errors: IO[str]) -> None:
        self.errors = errors
        self._popen = subprocess.Popen(
            module_command("tasks.runner.child", str(os.getpid())),
            env=stage_environment(),
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
        self._ended: int | None = None
        self._lock = threading.Lock()

    def wait(self) -> int:
        """Exit status once it has ended; nothing that it started is left."""
        with self._lock:
            if self._ended is None:
                self._ended = self._popen.returncode = reap(self._popen.pid)
            return self._ended

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""
        if self._ended is None:
            kill_group(self._popen.pid)
        self.wait()


class NotForkedError(Exception):
    """The server has ended before it could fork."""


class ForkedProcess:
    """A child of the server; raises NotForkedError, TimeoutError if the server does not answer, or OSError if the
    system has no room for another process."""

    def __init__(self, server: "ProcessServer", module: str, errors: IO[str]) -> None:
        self._server = server
        self.errors = errors
        self.works = True
        """Whether it has a job, and so may have started others."""
        self._ended: int | None = None
        self._lock = threading.Lock()
        with ExitStack() as mine:
            with ExitStack() as theirs:
                self._link, link = socket.socketpair()
                mine.enter_context(self._link)
                theirs.enter_context(link)
                self._answers = mine.enter_context(self._link.makefile())
                their_input, self.input = pipe(theirs, mine)
                self.output, their_output = pipe(mine, theirs)
                sent = [one.fileno() for one in (link, their_input, their_output, errors)]
                with suppress(OSError):  # no answer below
                    socket.send_fds(server.requests, [request(module)], sent)
            self.pid = self._first_answer()
            mine.pop_all()

    def _first_answer(self) -> int:
        """Its process id."""
        self._link.settimeout(START_SECONDS)
        answer = self._answers.readline()
        self._link.settimeout(None)
        if not answer:
            raise NotForkedError
        forked = json.loads(answer)
        if "errno" in forked:
            raise OSError(forked["errno"], os.strerror(forked["errno"]))
        return int(forked["pid"])

    def wait(self) -> int:
        """Exit status once it has ended; nothing that it started is left."""
        with self._lock:
            if self._ended is None:
                answer = self._answers.readline()
                self._ended = int(json.loads(answer)["status"]) if answer else self._lost()
                self._answers.close()
                self._link.close()
            return self._ended

    def is_idle(self) -> bool:
        """Whether one that has no job is still there: nothing has been told of its end, nor has its server gone."""
        link = select.poll()
        link.register(self._link, select.POLLIN)
        return self._ended is None and not link.poll(0)

    def _lost(self) -> int:
        """Its end without the server, which the kernel makes: only its group is left to kill. Its standard error says
        why."""
        if self.works:
            kill_group(self.pid)  # its own number while one of the group lives; another's only if all ended just now
        os.write(self.errors.fileno(), self._server.last_words().encode())  # where the process itself stopped writing
        return -signal.SIGKILL

    def kill(self) -> None:
        """Kill it and everything that it started, and wait."""
        with suppress(OSError):  # it has ended
            self._link.shutdown(socket.SHUT_WR)
        self.wait()


class InterruptedRunError(RuntimeError):
    """The processes of a run that has been interrupted are killed, and no more are started."""

    def __init__(self) -> None:
        super().__init__("the run was interrupted")


class ProcessServer:
    """Starts processes for the stages of a run; safe for many threads at once. What the server itself writes to
    standard error goes to the file `errors`."""

    def __init__(self, modules: Iterable[str], errors: IO[str]) -> None:
        self._surroundings = surroundings()
        self._errors = errors
        self._given_up = ""
        self._closed = False
        self._lock = threading.Lock()
        self._kept: dict[str, list[ForkedProcess]] = {}
        """Processes that wait for another job, by what they are kept for."""
        self.requests, requests = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.requests.settimeout(START_SECONDS)
        with requests:
            self._popen = subprocess.Popen(
                module_command("tasks.runner.fork_server", str(requests.fileno()), str(os.getpid())),
                env=stage_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=self._errors,
                pass_fds=[requests.fileno()],
                start_new_session=True,
            )
        self.pid = self._popen.pid
        for module in modules:
            with suppress(OSError):  # it has ended; processes are spawned
                self.requests.sendall(request(module))
        servers.add(self)

    def start(self, module: str, errors: IO[str]) -> StageProcess:
        """A process, with `module` loaded if it is forked; what it writes to standard error goes to `errors`."""
        if not self._closed and surroundings() == self._surroundings:
            try:
                return ForkedProcess(self, module, errors)
            except TimeoutError:
                self._given_up = f", killed since it had not started a process for {module} in {START_SECONDS:g} s"
                self._popen.kill()
            except NotForkedError:
                pass
        if self._closed:
            raise InterruptedRunError
        return SpawnedProcess(errors)

    def keep(self, process: StageProcess, kind: str) -> bool:
        """Keep a process that has done its job for the next of this kind; False where it is not one to be kept."""
        with self._lock:
            if self._closed or not isinstance(process, ForkedProcess):
                return False
            process.works = False
            self._kept.setdefault(kind, []).append(process)
            return True

    def take(self, kind: str) -> StageProcess | None:
        """A process that was kept for this kind and is as a new one would be, if there is one."""
        while True:
            with self._lock:  # not for longer: whoever discards one asks for the server's last words
                kept = self._kept.get(kind)
                process = kept.pop() if kept else None
            if process is None:
                return None
            if process.is_idle() and surroundings() == self._surroundings:
                empty(process.errors)
                process.works = True
                return process
            discard(process)

    @property
    def closed(self) -> bool:
        """Whether it starts no more processes."""
        return self._closed

    def last_words(self) -> str:
        """How the server ended, and the last that it wrote to standard error."""
        with self._lock:
            try:
                how = exit_words(self._popen.wait(LOST_SECONDS))
            except subprocess.TimeoutExpired:
                how = "closed sockets"
            self._errors.seek(0)
            tail = "".join(self._errors.readlines()[-LAST_LINES:])
        return f"the server that had forked it ended with {how}{self._given_up}\n{tail}"

    def close(self) -> None:
        """Kill the server, its children with it, and start no more processes, forked or spawned."""
        self._closed = True
        self._popen.kill()  # it may be loading

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        servers.discard(self)
        self.close()
        self._popen.wait()
        self.requests.close()
        for process in (one for kept in self._kept.values() for one in kept):
            discard(process)


def discard(process: StageProcess) -> None:
    """Kill a process and close what leads to it."""
    process.kill()
    for file in (process.input, process.output, process.errors):
        with suppress(OSError):  # what was written to it and not read
            file.close()


def empty(errors: IO[str]) -> None:
    """Empty a file that a process writes to; both have the same place in it."""
    os.lseek(errors.fileno(), 0, os.SEEK_SET)
    os.ftruncate(errors.fileno(), 0)


def pipe(reader: ExitStack, writer: ExitStack) -> tuple[IO[str], IO[str]]:
    """Both ends of a pipe, each closed with its owner."""
    read_fd, write_fd = os.pipe()
    return reader.enter_context(os.fdopen(read_fd)), writer.enter_context(os.fdopen(write_fd, "w"))


def request(module: str) -> bytes:
    """What the server is asked for."""
    return json.dumps({"module": module}).encode()


def stage_environment() -> dict[str, str]:
    """The environment of stages' processes: this program's, with one thread for the products of small matrices that
    numpy hands to BLAS. More of them wait for one another without sleeping, at the cost of the process beside."""
    return {BLAS_THREADS: "1"} | os.environ


def surroundings() -> tuple[object, ...]:
    """What a process finds when it loads its modules: working directory, environment, and when each of our source
    files was changed; equal if a forked process would be as one that is spawned now."""
    changed: dict[str, int | None] = {}
    for folder in SOURCES:
        with suppress(FileNotFoundError):  # a folder that is deleted meanwhile: what is missing counts as changed
            for path in folder.rglob("*.py"):
                changed[str(path)] = change_time(path)
    return os.getcwd(), dict(os.environ), changed


def change_time(path: Path) -> int | None:
    """When a file was changed [ns]; None if it was deleted since it was listed, or links to nothing, as editors' locks
    do."""
    with suppress(FileNotFoundError):
        return path.stat().st_ctime_ns
    return None


@contextmanager
def process_server(modules: Iterable[str]) -> Iterator[ProcessServer | None]:
    """A server that loads `modules` at once, for the time of a run; None where processes are spawned."""
    if start_method() == SPAWN:
        yield None
        return
    with tempfile.TemporaryFile("w+", errors="replace") as errors, ProcessServer(modules, errors) as server:
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
