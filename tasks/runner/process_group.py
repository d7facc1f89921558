"""The end of a process that leads a group: nothing it started stays, and what it took is known."""

import os
import signal
from contextlib import suppress
from dataclasses import dataclass

KIB = 1024  # unit of the kernel's ru_maxrss [bytes]


@dataclass(frozen=True, slots=True)
class Ended:
    """How a process ended and what it took."""

    status: int
    """Exit status; negative: the number of the signal that ended it."""
    cpu_seconds: float
    """Processor time of its threads and of the processes that it waited for, user and system [s]."""
    peak_memory: int
    """Most memory that was resident at a time [bytes], pages that it shares included; the kernel counts what a spawned
    process had before it ran its own program, so that one shows at least what its parent had."""


def reap(pid: int) -> Ended:
    """Wait for a child process that leads a group, and kill what is left of the group."""
    if hasattr(os, "waitid"):  # else its number could be another's by now, if unlikely
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        kill_group(pid)
    _, status, usage = os.wait4(pid, 0)
    if not hasattr(os, "waitid"):
        kill_group(pid)
    return Ended(os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, usage.ru_maxrss * KIB)


def exit_words(status: int) -> str:
    """An exit status in words."""
    return f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"


def kill_group(pid: int) -> None:
    """Kill a process and everything that it started."""
    with suppress(ProcessLookupError):  # all gone already
        os.killpg(pid, signal.SIGKILL)
