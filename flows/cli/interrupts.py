"""Ctrl-C and SIGTERM end the program whatever it does just then.

Where Python is in the middle of an import, an exception is not safe: several libraries import what is optional within
an `except` for everything, and go on as if nothing had been asked of them; others pass it on as an ImportError. So it
is raised when the import is over; one that takes longer is not waited for.
"""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Timer
from types import FrameType
from typing import NoReturn

INTERRUPTED = 130
"""Exit code."""
AGAIN_SECONDS = 0.02
LONGEST_SECONDS = 0.3
"""How long an import is waited for: nobody feels it."""
IMPORT = "<frozen importlib._bootstrap>"
"""File of the frames of an import that is under way."""


class Interrupt:
    """A handler of one signal, which raises `raised()` in what runs."""

    def __init__(self, number: signal.Signals, raised: Callable[[], BaseException]) -> None:
        self.number = number
        self.raised = raised
        self._asked_at: float | None = None

    def __call__(self, _: int, frame: FrameType | None) -> None:
        """The signal has come, or comes again because it was put off."""
        now = time.monotonic()
        if not importing(frame):
            self._asked_at = None
            raise self.raised()
        if self._asked_at is None:
            self._asked_at = now
        if now - self._asked_at > LONGEST_SECONDS:
            leave()
        again = Timer(AGAIN_SECONDS, os.kill, (os.getpid(), self.number))
        again.daemon = True
        again.start()


def leave() -> NoReturn:
    """End the process where nothing can be raised, as after a KeyboardInterrupt."""
    say_interrupted()
    with suppress(Exception):
        end_processes()
    flush_output()
    os._exit(INTERRUPTED)


def say_interrupted() -> None:
    """One line on standard error."""
    with suppress(OSError, AttributeError):
        sys.stderr.write("dcap: interrupted\n")


def flush_output() -> None:
    """Hand over what was printed, before a process ends that does not do it itself."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, AttributeError, ValueError):
            stream.flush()


def end_processes() -> None:
    """Kill what computes for this program; nothing does where nothing was loaded that could start it."""
    started = sys.modules.get("tasks.runner.process")
    if started is not None:
        started.kill_all()


def importing(frame: FrameType | None) -> bool:
    """Whether a frame is within an import."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORT:
            return True
        frame = frame.f_back
    return False


@contextmanager
def interruptible(*, own: bool) -> Iterator[None]:
    """Ctrl-C is a KeyboardInterrupt here and SIGTERM an exit, neither of which an import can lose. What whoever started
    the program wants ignored, as a shell does for Ctrl-C of what runs in the background, stays so. A process of our
    `own` ends at once where one comes afterwards; others have the handlers that they had."""
    handlers = {
        signal.SIGINT: Interrupt(signal.SIGINT, KeyboardInterrupt),
        signal.SIGTERM: Interrupt(signal.SIGTERM, lambda: SystemExit(INTERRUPTED)),
    }
    before = {number: former for number in handlers if (former := signal.getsignal(number)) is not signal.SIG_IGN}
    for number in before:
        signal.signal(number, handlers[number])
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, (lambda *_: leave()) if own else former)
