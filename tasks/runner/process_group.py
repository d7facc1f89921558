"""The end of a process that leads a group: nothing it started stays."""

import os
import signal
from contextlib import suppress


def reap(pid: int) -> int:
    """Wait for a child process that leads a group, and kill what is left of the group; its exit status, negative: the
    number of the signal that ended it."""
    if hasattr(os, "waitid"):  # else its number could be another's by now, if unlikely
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT)
        kill_group(pid)
    _, status = os.waitpid(pid, 0)
    if not hasattr(os, "waitid"):
        kill_group(pid)
    return os.waitstatus_to_exitcode(status)


def exit_words(status: int) -> str:
    """An exit status in words."""
    return f"signal {signal.Signals(-status).name}" if status < 0 else f"status {status}"


def kill_group(pid: int) -> None:
    """Kill a process and everything that it started."""
    with suppress(ProcessLookupError):  # all gone already
        os.killpg(pid, signal.SIGKILL)
