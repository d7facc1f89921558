"""What the process of a stage runs: reads a job, runs the stage, reports.

In: jobs on standard input, each a line of JSON (module, function, inputs, configuration). Out: JSON lines on standard
output, for each job `{"progress": ...}` while it works and `{"done": ...}` or `{"error": ...}` at its end. The process
ends after an error, and where standard input is closed.
"""

import ctypes
import gc
import importlib
import json
import logging
import os
import resource
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from dcap.language.protocol.session import Session
from dcap.scene import errors
from dcap.scene.machine_errors import machine_error
from tasks.runner.digests import PACKAGES
from tasks.runner.stage import stage

PR_SET_PDEATHSIG = 1
RESET_PEAK = "5"  # what the kernel takes for: forget the peak
KIB = 1024  # unit of the kernel's figures of memory [bytes]


def main() -> None:
    """The child: read jobs, run their stages, report, until nobody has another one."""
    die_with_parent(int(sys.argv[1]))
    report = private_stdout()
    forward_log(report)
    usage = JobUsage()
    for line in sys.stdin:
        job = json.loads(line)
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
        say(report, done=done | usage.told())
        del values, value  # it may wait for long, and hold two jobs at once when the next one's inputs are loaded
        give_memory_back()


def give_memory_back() -> None:
    """Free what only cycles of references hold, and return to the system what is free, where its allocator can."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
    if trim is not None:
        trim(0)


class JobUsage:
    """What each job takes, of a process that may do several: the first has its start as well."""

    def __init__(self) -> None:
        self._cpu_seconds = 0.0

    def told(self) -> dict[str, Any]:
        """Since it was told last: processor time of its threads and of the processes that it waited for [s], and the
        most memory that was resident at a time, pages that it shares included [bytes]."""
        times = os.times()
        now = times.user + times.system + times.children_user + times.children_system
        since, self._cpu_seconds = now - self._cpu_seconds, now
        return {"cpu_seconds": since, "peak_memory": peak_memory()}


def peak_memory() -> int:
    """Most memory that was resident at a time since this was asked last [bytes]; since the start of the process where
    the system cannot begin anew."""
    if sys.platform != "linux":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    peak = next((int(line.split()[1]) for line in lines if line.startswith("VmHWM:")), None)
    if peak is None:  # a sandbox that tells less
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * KIB
    with suppress(OSError):  # not allowed in a container that is closed
        Path("/proc/self/clear_refs").write_text(RESET_PEAK, encoding="utf-8")
    return peak * KIB


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
