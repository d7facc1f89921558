"""Runs one stage in a process of its own, tasks/runner/child.py, and hands back what it reports.

The process leads its own session, dies with its parent, and is killed with all that it started when the parent is
interrupted or the time is up.
"""

import json
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

from dcap.scene import errors
from tasks.runner.process_group import exit_words
from tasks.runner.process_server import ProcessServer, SpawnedProcess, StageProcess, servers

MOST_SECONDS = 3600.0
"""A stage that runs longer hangs: budgets count steps, so this never decides a result."""
LAST_LINES = 15

running: set[StageProcess] = set()


class StageProcessError(RuntimeError):
    """The process of a stage ended without a result."""


def run_in_process(
    job: dict[str, object], on_progress: Callable[[float, str], None], server: ProcessServer | None = None
) -> dict[str, Any]:
    """Run a job in a process of its own, forked by the run's server if it has one, and return what it reports as done.

    `cpu_seconds` and `peak_memory` [bytes] of the process are added to that.
    """
    with tempfile.TemporaryFile("w+", errors="replace") as errors_file:
        process = server.start(str(job["module"]), errors_file) if server else SpawnedProcess(errors_file)
        running.add(process)
        alarm = threading.Timer(MOST_SECONDS, process.kill)
        alarm.daemon = True
        alarm.start()
        try:
            return converse(process, json.dumps(job), errors_file, on_progress)
        finally:
            alarm.cancel()
            process.kill()
            running.discard(process)


def converse(
    process: StageProcess, job: str, errors_file: IO[str], on_progress: Callable[[float, str], None]
) -> dict[str, Any]:
    """Hand the job over and read lines until the result."""
    with suppress(BrokenPipeError), process.input:  # it died at once; the exit status below says how
        process.input.write(job)
    done: dict[str, Any] | None = None
    with process.output:
        for line in process.output:
            message = json.loads(line)
            if "progress" in message:
                on_progress(float(message["progress"]), str(message.get("text", "")))
            elif "error" in message:
                raise_again(message["error"])
            else:
                done = message["done"]
    ended = process.wait()
    if done is None or ended.status != 0:
        errors_file.seek(0)
        tail = "".join(errors_file.readlines()[-LAST_LINES:])
        raise StageProcessError(f"the stage's process ended with {exit_words(ended.status)}\n{tail}")
    return done | {"cpu_seconds": ended.cpu_seconds, "peak_memory": ended.peak_memory}


def raise_again(error: dict[str, str]) -> None:
    """Raise the child's error here under its own type."""
    kind = getattr(errors, error["type"], errors.DcapError)
    raise kind(error["message"])


def kill_all() -> None:
    """Kill the processes of all running stages, and those that are about to start, for an interrupted program."""
    for server in list(servers):
        server.close()
    for process in list(running):
        process.kill()
