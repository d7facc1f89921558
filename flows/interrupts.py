"""Ctrl-C and SIGTERM end the program whatever it does just then.

Several libraries import what is optional within an `except` for everything and lose the exception, and threads that
compute cannot be interrupted; so a signal also sets an alarm after which the process ends.
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
"""How long the program may take to end in an orderly way: states of runs are told, drafts are removed."""
_once = threading.Event()


def end_on_signals() -> None:
    """Handle Ctrl-C and SIGTERM in this process; what whoever started it wants ignored stays ignored."""
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _interrupt)


def was_interrupted() -> bool:
    """Return whether somebody has interrupted the program; libraries may turn that into an error of their own."""
    return _once.is_set()


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    if _once.is_set():
        end_now()
    _once.set()
    threading.excepthook = lambda _: None  # what is cut off now is no error to tell
    sys.unraisablehook = lambda _: None
    alarm = threading.Timer(LONGEST_SECONDS, end_now)
    alarm.daemon = True
    alarm.start()
    kill_jobs = getattr(sys.modules.get("tasks.process"), "interrupt", None)  # that module may be half loaded
    if kill_jobs is not None:
        kill_jobs()
    raise KeyboardInterrupt


def say_interrupted() -> None:
    """Say that somebody has interrupted the program."""
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
