"""Ends the program on Ctrl-C and SIGTERM, whatever it is doing.

Several libraries wrap optional imports in an `except` for everything and so swallow the exception, and threads that
compute cannot be interrupted. A signal therefore also sets an alarm after which the process ends.
"""

import os
import signal
import sys
import threading
from contextlib import suppress
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
"""Exit code."""
LONGEST_SECONDS = 3.0
"""Time for an orderly end, in which states of runs are reported and drafts removed [s]."""
_once = threading.Event()


def end_on_signals() -> None:
    """Handle Ctrl-C and SIGTERM in this process, except for signals that the parent process has set to be ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def was_interrupted() -> bool:
    """Return whether the program was interrupted; libraries may turn the interruption into an error of their own."""
    return _once.is_set()


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    if _once.is_set():
        end_now()
    _once.set()
    threading.excepthook = lambda _: None  # errors caused by the interruption are not reported
    sys.unraisablehook = lambda _: None
    alarm = threading.Timer(LONGEST_SECONDS, end_now)
    alarm.daemon = True
    alarm.start()
    kill_jobs = getattr(sys.modules.get("tasks.process"), "interrupt", None)  # that module may be half loaded
    if kill_jobs is not None:
        kill_jobs()
    raise KeyboardInterrupt


def say_interrupted() -> None:
    """Print that the program was interrupted."""
    with suppress(OSError, AttributeError, ValueError):  # a pipe that nobody reads, closed, or none at all
        sys.stderr.write("dcap: interrupted\n")


def end_now() -> NoReturn:
    """End an interrupted process at once, with a line."""
    say_interrupted()
    leave(INTERRUPTED)


def leave(code: int) -> NoReturn:
    """End the process without waiting for threads."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, AttributeError, ValueError):
            stream.flush()
    os._exit(code)
