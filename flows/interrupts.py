"""Ctrl-C and SIGTERM end the program whatever it does just then.

Where Python is in the middle of an import, an exception is not safe: several libraries import what is optional within
an `except` for everything, and go on as if nothing had been asked of them; others pass it on as an ImportError. So it
is raised when the import is over; one that takes longer is not waited for.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit code."""
AGAIN_SECONDS = 0.02
LONGEST_SECONDS = 0.3
"""How long an import is waited for: nobody feels it."""
IMPORT = "<frozen importlib._bootstrap>"
"""File of the frames of an import that is under way."""
SHOW_CURSOR = "\x1b[?25h"
"""Ends what a bar of progress does to a terminal."""

Handler = Callable[[int, FrameType | None], object]


class PutOff:
    """The handler of a signal that waits for imports: while one is under way, an alarm asks again."""

    def __init__(self, number: signal.Signals, handler: Handler) -> None:
        self.number = number
        self.handler = handler
        self._asked_at: float | None = None
        self._alarm: Any = None

    def __call__(self, _: int, frame: FrameType | None) -> None:
        """The signal has come, once or again, or its alarm."""
        now = time.monotonic()
        if importing(frame):
            if self._asked_at is None:
                self._asked_at = now
                self._alarm = signal.signal(signal.SIGALRM, self)
            if now - self._asked_at > LONGEST_SECONDS:
                leave()
            signal.setitimer(signal.ITIMER_REAL, AGAIN_SECONDS)
            return
        if self._asked_at is not None:
            self._asked_at = None
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._alarm or signal.SIG_DFL)
        self.handler(self.number, frame)


def importing(frame: FrameType | None) -> bool:
    """Whether a frame is within an import."""
    while frame is not None:
        if frame.f_code.co_filename == IMPORT:
            return True
        frame = frame.f_back
    return False


def leave() -> NoReturn:
    """End the process where nothing can be raised. Nothing is unwound: what would stay behind after `kill -9` does."""
    with suppress(OSError, AttributeError, ValueError):
        if sys.stderr.isatty():
            sys.stderr.write(SHOW_CURSOR)
    say_interrupted()
    with suppress(Exception):
        end_processes()
    flush_output()
    os._exit(INTERRUPTED)


def say_interrupted() -> None:
    """That somebody has interrupted the program."""
    say("dcap: interrupted")


def say(line: str) -> None:
    """A line on standard error, whatever that is."""
    with suppress(OSError, AttributeError, ValueError):  # a pipe that nobody reads, closed, or none at all
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()


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


@contextmanager
def interruptible(*, own: bool) -> Iterator[None]:
    """Ctrl-C is a KeyboardInterrupt here and SIGTERM an exit, neither of which an import can lose. What whoever started
    the program wants ignored, as a shell does for Ctrl-C of what runs in the background, stays so. A process of our
    `own` ends at once where one comes afterwards; others have the handlers that they had."""
    wanted = {
        number: PutOff(number, handler)
        for number, handler in ((signal.SIGINT, interrupt), (signal.SIGTERM, end))
        if signal.getsignal(number) is not signal.SIG_IGN
    }
    try:
        with handled_by(wanted):
            yield
    finally:
        for number in wanted if own else ():
            signal.signal(number, lambda *_: leave())


@contextmanager
def put_off(number: signal.Signals) -> Iterator[None]:
    """The handler that a signal has waits for imports here, too; only the main thread has any."""
    handler = signal.getsignal(number)
    wanted = {number: PutOff(number, handler)} if callable(handler) else {}
    with handled_by(wanted if threading.current_thread() is threading.main_thread() else {}):
        yield


@contextmanager
def handled_by(handlers: Mapping[signal.Signals, Handler]) -> Iterator[None]:
    """Signals have these handlers, and afterwards those that they had."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)


def interrupt(*_: object) -> NoReturn:
    """Leave what runs, as Python itself does."""
    raise KeyboardInterrupt


def end(*_: object) -> NoReturn:
    """Leave what runs."""
    raise SystemExit(INTERRUPTED)
