"""A worker of the pool: takes samples, benchmarks and reruns from a Prefect server, and runs each in its own process.

Prefect's own worker does the work; here it is given a server, the deployments and a place where nothing foreign is
imported from.
"""

import os
import platform
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from secrets import token_hex

import psutil

from dcap.cores import SHARE, available_cores
from dcap.packages import module_command
from dcap.scene.errors import DcapError
from dcap.scene.settings import data_root, server_folder, shared_store_url
from flows.interrupts import say
from flows.server import listened_to, pages_of, prefect_server
from flows.settings.given import FILE_VARIABLE, settings_file
from flows.worker_program import kill, started_by

WORKER_MODULE = "flows.worker_program"
HEARTBEAT_SECONDS = 10
"""Three that are missed make a worker lost."""
LOOK_SECONDS = 1.0
"""How often it is noted what a worker has started: one that was killed tells no more."""
LONGEST_LOG = 1 << 20
"""Bytes that are kept of what is said of a server that is away."""
STOP_SECONDS = 15.0


def serve_pool(at_a_time: int, announce: Callable[[str], None]) -> None:
    """Serve the pool until interrupted; `announce` is given a line when the worker starts."""
    with prefect_server(tells=False) as url, tempfile.TemporaryDirectory(prefix="dcap-worker-") as folder:
        from flows.work_pool import POOL, WORKER, register

        register()
        name = f"{platform.node()}-{os.getpid()}-{token_hex(3)}"  # a container that starts again has both again
        environment = (
            os.environ
            | whole_places()
            | {
                WORKER: name,
                SHARE: str(max(1, available_cores() // at_a_time)),
                "PYTHONSAFEPATH": "1",  # its processes take nothing from the working directory
                "PYTHONUNBUFFERED": "1",
                "PREFECT_WORKER_HEARTBEAT_SECONDS": str(HEARTBEAT_SECONDS),
            }
        )
        words = ("worker", "start", "--pool", POOL, "--type", "process", "--name", name, "--limit", str(at_a_time))
        process = subprocess.Popen(
            module_command(WORKER_MODULE, str(os.getpid()), *words),
            env=environment,
            cwd=folder,
            start_new_session=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        said = WorkerWords(process, server_folder() / f"{name}.log")
        started = list[psutil.Process]()
        try:
            announce(f"worker {name} of the pool {POOL!r}, server {pages_of(url)}, {at_a_time} at a time")
            with listened_to(url, said.server_is):
                while process.poll() is None:
                    started = started_by(process.pid) or started
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(LOOK_SECONDS)
        finally:
            stop(process, started)
            where = said.end()
    if process.returncode:
        raise DcapError(f"the worker ended with status {process.returncode}; what it said {where}")


class WorkerWords:
    """What Prefect's worker says, handed on line by line. While its server is away these are tracebacks of each attempt
    to reach it: they go into a log, and a line says why."""

    def __init__(self, process: "subprocess.Popen[bytes]", log: Path) -> None:
        assert process.stdout is not None
        self._said = process.stdout
        self._log = log
        self._is_away = threading.Event()
        self._is_last_kept = False
        """Whether the last line went into the log."""
        self._thread = threading.Thread(target=self._hand_on, name="words of the worker", daemon=True)
        self._thread.start()

    def server_is(self, there: bool) -> None:
        """Whether the server answers, as it is told where that changes."""
        if there:
            self._is_away.clear()
            say("the Prefect server answers again")
        else:
            self._is_away.set()
            say(f"the Prefect server does not answer; it is waited for, what Prefect says of it is in {self._log}")

    def end(self) -> str:
        """The worker has ended; where its last words are."""
        self._thread.join(STOP_SECONDS)
        return f"is in {self._log}" if self._is_last_kept else "stands above"

    def _hand_on(self) -> None:
        for line in self._said:
            self._is_last_kept = self._is_away.is_set() and self._keep(line)
            if not self._is_last_kept:
                say(line.decode(errors="replace").rstrip())

    def _keep(self, line: bytes) -> bool:
        """In the log, which begins anew where it is long: one attempt says what the others say. Whether it is there."""
        try:
            self._log.parent.mkdir(parents=True, exist_ok=True)
            with self._log.open("ab") as log:
                if log.tell() > LONGEST_LOG:
                    log.truncate(0)
                log.write(line)
        except OSError:
            return False
        return True


def whole_places() -> dict[str, str]:
    """What says where data, store and settings are, with whole paths: flow runs have other working directories."""
    found = {"DCAP_DATA": str(data_root())}
    if (store := shared_store_url()) and "://" not in store:
        found["DCAP_STORE"] = str(Path(store).resolve())
    if (settings := settings_file()) is not None:
        found[FILE_VARIABLE] = str(settings.absolute())  # what its paths are relative to is the folder of a link
    return found


def stop(process: "subprocess.Popen[bytes]", started: list[psutil.Process]) -> None:
    """End a worker with the processes of its flow runs, which Prefect would leave: those that it has `started`, each in
    a session of its own."""
    try:
        for kind in (signal.SIGTERM, signal.SIGKILL):
            if process.poll() is None:
                started = started_by(process.pid) or started
                os.killpg(process.pid, kind)
                with suppress(subprocess.TimeoutExpired):
                    process.wait(STOP_SECONDS)
    finally:
        kill(started)
