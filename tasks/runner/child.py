"""What the process of a stage runs: reads a job, runs the stage, reports.

In: a job as JSON on standard input (module, function, inputs, configuration). Out: JSON lines on standard output,
`{"progress": ...}` while it works and `{"done": ...}` or `{"error": ...}` at the end.
"""

import ctypes
import importlib
import json
import logging
import os
import signal
import sys
import time
from typing import IO

from dcap.language.protocol.session import Session
from dcap.scene import errors
from dcap.scene.machine_errors import machine_error
from tasks.runner.digests import PACKAGES
from tasks.runner.stage import stage

PR_SET_PDEATHSIG = 1


def main() -> None:
    """The child: read the job, run the stage, report."""
    die_with_parent(int(sys.argv[1]))
    report = private_stdout()
    job = json.loads(sys.stdin.read())
    forward_log(report)
    try:
        function = getattr(importlib.import_module(job["module"]), job["function"])
        own = stage(function)
        values = own.load(job["inputs"], job["config"], Session(**job["session"]))
        begin = time.perf_counter()
        value = function(**values)
        done = own.save(value, time.perf_counter() - begin)
    except Exception as error:
        known = error if isinstance(error, errors.DcapError) else machine_error(error)
        if known is None:
            raise
        say(report, error={"type": type(known).__name__, "message": str(known)})
        return
    say(report, done=done)


def die_with_parent(parent: int) -> None:
    """Ask the kernel, where it is Linux, to kill us when the parent dies, and check that it has not died before."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def private_stdout() -> IO[str]:
    """Keep standard output for our lines; what libraries print goes to standard error."""
    report = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return report


class ProgressHandler(logging.Handler):
    """Sends what our code logs to the parent; `extra={"progress": 0.4}` says how much of the work is done."""

    def __init__(self, report: IO[str]) -> None:
        super().__init__(logging.INFO)
        self.report = report

    def emit(self, record: logging.LogRecord) -> None:
        """One record as a progress line."""
        say(self.report, progress=getattr(record, "progress", 0.0), text=record.getMessage())


def forward_log(report: IO[str]) -> None:
    """Listen to the loggers of our packages."""
    for package in PACKAGES:
        logger = logging.getLogger(package)
        logger.setLevel(logging.INFO)
        logger.addHandler(ProgressHandler(report))


def say(report: IO[str], **message: object) -> None:
    """One JSON line, at once."""
    report.write(json.dumps(message) + "\n")
    report.flush()


if __name__ == "__main__":
    main()
