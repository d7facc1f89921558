"""Runs one stage in a fresh process of its own, tasks/runner/child.py, and hands back what it reports.

The process leads its own session, dies with its parent, and is killed with all that it started when the parent is
interrupted or the time is up.
"""

import json
import os
import signal
import subprocess
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import IO, Any

from dcap.packages import module_command
from dcap.scene import errors

MOST_SECONDS = 3600.0
"""A stage that runs longer hangs: budgets count steps, so this never decides a result."""
LAST_LINES = 15

running: dict[int, "subprocess.Popen[str]"] = {}


class StageProcessError(RuntimeError):
    """The process of a stage ended without a result."""


def run_in_process(job: dict[str, object], on_progress: Callable[[float, str], None]) -> dict[str, Any]:
    """Run a job in a fresh process and return what it reports as done."""
    with tempfile.TemporaryFile("w+", errors="replace") as errors_file:
        child = subprocess.Popen(
            module_command("tasks.runner.child", str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors_file,
            text=True,
            start_new_session=True,
        )
        running[child.pid] = child
        alarm = threading.Timer(MOST_SECONDS, kill_group, [child])
        alarm.daemon = True
        alarm.start()
        try:
            return converse(child, json.dumps(job), errors_file, on_progress)
        finally:
            alarm.cancel()
            kill_group(child)
            running.pop(child.pid, None)


def converse(
    child: "subprocess.Popen[str]", job: str, errors_file: IO[str], on_progress: Callable[[float, str], None]
) -> dict[str, Any]:
    """Hand the job over and read lines until the result."""
    assert child.stdin is not None
    assert child.stdout is not None
    with suppress(BrokenPipeError):  # it died at once; the exit status below says how
        child.stdin.write(job)
        child.stdin.close()
    done: dict[str, Any] | None = None
    for line in child.stdout:
        message = json.loads(line)
        if "progress" in message:
            on_progress(float(message["progress"]), str(message.get("text", "")))
        elif "error" in message:
            raise_again(message["error"])
        else:
            done = message["done"]
    status = child.wait()
    if done is None or status != 0:
        errors_file.seek(0)
        tail = "".join(errors_file.readlines()[-LAST_LINES:])
        raise StageProcessError(f"the stage's process ended with {exit_words(status)}\n{tail}")
    return done


def exit_words(status: int) -> str:
    """An exit status in words."""
    return f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"


def raise_again(error: dict[str, str]) -> None:
    """Raise the child's error here under its own type."""
    kind = getattr(errors, error["type"], errors.DcapError)
    raise kind(error["message"])


def kill_group(child: "subprocess.Popen[str]") -> None:
    """Kill the process and everything that it started."""
    with suppress(ProcessLookupError):  # all gone already
        os.killpg(child.pid, signal.SIGKILL)
    child.wait()


def kill_all() -> None:
    """Kill the processes of all running stages, for an interrupted program."""
    for child in list(running.values()):
        kill_group(child)
