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


def _interrupt(number: int, frame: FrameType | None) -> NoReturn:
    if _once.is_set():
        leave()
    _once.set()
    started = sys.modules.get("tasks.process")
    if started is not None:
        started.interrupt()
    alarm = threading.Timer(LONGEST_SECONDS, leave)
    alarm.daemon = True
    alarm.start()
    raise KeyboardInterrupt


def leave(code: int = INTERRUPTED, words: str = "dcap: interrupted\n") -> NoReturn:
    """End the process at once: threads that compute are not waited for."""
    for stream, text in ((sys.stdout, ""), (sys.stderr, words)):
        with suppress(OSError, AttributeError, ValueError):  # a pipe that nobody reads, closed, or none at all
            stream.write(text)
            stream.flush()
    os._exit(code)
