"""Runs one stage in a process of its own, tasks/runner/child.py, and hands back what it reports.

The process leads its own session, dies with its parent, and is killed with all that it started when the parent is
interrupted or the time is up. It does one job; where it is kept, one after the other.
"""

import json
import tempfile
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from typing import Any
from weakref import WeakSet

from dcap.scene import errors
from tasks.runner.process_group import exit_words
from tasks.runner.process_server import (
    InterruptedRunError,
    ProcessServer,
    SpawnedProcess,
    StageProcess,
    discard,
    servers,
)

MOST_SECONDS = 3600.0
"""A stage that runs longer hangs: budgets count steps, so this never decides a result."""
LAST_LINES = 15

running: set[StageProcess] = set()
interrupted: WeakSet[StageProcess] = WeakSet()
"""Those that were killed with an interrupted program."""


class StageProcessError(RuntimeError):
    """The process of a stage ended without a result."""


def run_in_process(
    job: dict[str, object],
    on_progress: Callable[[float, str], None],
    server: ProcessServer | None = None,
    kind: str = "",
) -> dict[str, Any]:
    """Run a job in a process of its own, forked by the run's server if it has one, and return what it reports as done.

    A job of a `kind` gets the process of one of the same kind that is done, if there is one, and leaves it its own.
    `cpu_seconds` and `peak_memory` [bytes] that the job took are added to what is returned. StageProcessError where the
    process ends without a result, InterruptedRunError where that is because the program was interrupted.
    """
    process = server.take(kind) if server and kind else None
    process = process or new_process(str(job["module"]), server)
    running.add(process)
    alarm = threading.Timer(MOST_SECONDS, process.kill)
    alarm.daemon = True
    alarm.start()
    kept = False
    try:
        done = converse(process, json.dumps(job), on_progress)
        if server and kind:
            alarm.cancel()  # of one that is to end, the end is waited for no longer than for its job
            kept = server.keep(process, kind)
        if not kept:
            dismiss(process)
        return done
    except StageProcessError as error:
        if process in interrupted or (server is not None and server.closed):
            raise InterruptedRunError from error
        raise
    finally:
        alarm.cancel()
        running.discard(process)
        if not kept:
            discard(process)


def new_process(module: str, server: ProcessServer | None) -> StageProcess:
    """A process for a job of this module."""
    with ExitStack() as opened:
        errors = opened.enter_context(tempfile.TemporaryFile("w+", errors="replace"))
        process = server.start(module, errors) if server else SpawnedProcess(errors)
        opened.pop_all()
    return process


def converse(process: StageProcess, job: str, on_progress: Callable[[float, str], None]) -> dict[str, Any]:
    """Hand the job over and read lines until the result."""
    with suppress(BrokenPipeError):  # it died at once; the exit status below says how
        process.input.write(job + "\n")
        process.input.flush()
    for line in process.output:
        if not line.endswith("\n"):  # killed in the middle of it
            break
        message = json.loads(line)
        if "progress" in message:
            on_progress(float(message["progress"]), str(message.get("text", "")))
        elif "error" in message:
            raise_again(message["error"])
        else:
            return dict(message["done"])
    raise end_error(process)


def dismiss(process: StageProcess) -> None:
    """Let a process end that has done its job; StageProcessError where it does not end well."""
    with suppress(BrokenPipeError):
        process.input.close()
    if process.wait() != 0:
        raise end_error(process)


def end_error(process: StageProcess) -> StageProcessError:
    """The error that says how a process ended, with its last words."""
    status = process.wait()
    process.errors.seek(0)
    tail = "".join(process.errors.readlines()[-LAST_LINES:])
    return StageProcessError(f"the stage's process ended with {exit_words(status)}\n{tail}")


def raise_again(error: dict[str, str]) -> None:
    """Raise the child's error here under its own type."""
    kind = getattr(errors, error["type"], errors.DcapError)
    raise kind(error["message"])


def kill_all() -> None:
    """Kill the processes of all running stages, and those that are about to start, for an interrupted program."""
    for server in list(servers):
        server.close()
    for process in list(running):
        interrupted.add(process)
        process.kill()
