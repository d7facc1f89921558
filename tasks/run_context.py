"""Decides how stages called inside a block run, and reports events to a listener; has no effect on results."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from dcap.language.protocol.session import Session
from tasks.artifact import Ref


class Mode(StrEnum):
    """Modes of running stages."""

    WATCHED = "watched"
    DIRECT = "direct"
    LOOKUP = "lookup"


class Event(StrEnum):
    """Events of a stage during the placement of a sample."""

    STARTED = "started"
    PROGRESS = "progress"
    FINISHED = "finished"
    CACHED = "cached"
    MISSING = "missing"
    """Only in a lookup: the stage would run, or depends on a stage that would."""


@dataclass(frozen=True, slots=True)
class StageEvent:
    """One event of a stage."""

    stage: str
    event: Event
    part: float = 0.0
    """Completed share of the work, 0..1, if the stage knows it."""
    text: str = ""
    ref: Ref[Any] | None = None
    """The result, if it is available."""
    recipe: Mapping[str, Any] = field(default_factory=dict)
    """Recipe of a missing result; empty if it depends on another stage."""


OnEvent = Callable[[StageEvent], None]


@dataclass(frozen=True, slots=True)
class RunContext:
    """Settings for running the stages called inside `use_context`; they have no effect on results."""

    mode: Mode = Mode.DIRECT
    on_event: OnEvent = lambda event: None
    session: Session = field(default_factory=Session)
    """Session of the language client."""
    refresh: frozenset[str] = frozenset()
    """Stages to compute again even if they have a record."""
    bring: bool = True
    """Whether a lookup copies results from the shared store."""
    slots: threading.Semaphore | None = None
    """Limits the number of stages that compute at a time; a stage that waits for a reply lends its slot to another."""
    limits: frozenset[str] = frozenset()
    """Prefect's global concurrency limits in force."""
    tags: tuple[str, ...] = ()
    """Tags of the task runs."""


_context: ContextVar[RunContext] = ContextVar("run context")


def current_context() -> RunContext:
    """Return the context of this thread's run; a default context outside any run."""
    return _context.get(None) or RunContext()


@contextmanager
def use_context(context: RunContext) -> Iterator[RunContext]:
    """Run stages called in this block and thread by `context`."""
    token = _context.set(context)
    try:
        yield context
    finally:
        _context.reset(token)
