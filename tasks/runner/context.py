"""How the stages of one run behave, and what they tell of themselves.

The context of a run is the one ambient value of the pipeline: Prefect calls a task with its inputs and nothing else, so
what is no input (whether to look only, who listens, how questions are asked) is set around the calls.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import StrEnum
from threading import Semaphore

from dcap.language.protocol.session import Session
from tasks.runner.process_server import ProcessServer
from tasks.runner.records import Deciders, Record

OnProgress = Callable[[float, str], None]


class Event(StrEnum):
    """What can be told about a stage while a sample is placed."""

    STARTED = "started"
    PROGRESS = "progress"
    FINISHED = "finished"
    CACHED = "cached"


@dataclass(frozen=True, slots=True)
class StageEvent:
    """One thing that happened to a stage."""

    stage: str
    event: Event
    part: float = 0.0
    """Share of the work that is done, 0..1, where the stage knows it."""
    text: str = ""
    record: Record | None = None
    """The record, once there is one."""


OnEvent = Callable[[StageEvent], None]


@dataclass(frozen=True, slots=True)
class RunContext:
    """How the stages that are called inside `use_context` behave."""

    lookup_only: bool = False
    """Only look records up; a stage without one raises NotCachedError."""
    refresh: frozenset[str] = frozenset()
    """Stages to compute again although they have a record."""
    on_event: OnEvent = lambda event: None
    session: Session = field(default_factory=Session)
    """How questions are asked."""
    slots: Semaphore | None = None
    """How many stages may compute at a time; a stage that waits for a reply lends its slot to another."""
    server: ProcessServer | None = None
    """Starts the processes of heavy stages; without it each is spawned."""


class NotCachedError(LookupError):
    """A stage has no usable record; carries what it would be computed from."""

    def __init__(self, deciders: Deciders) -> None:
        super().__init__(deciders.stage)
        self.deciders = deciders


_current: ContextVar[RunContext] = ContextVar("run context")


def current_context() -> RunContext:
    """The context of this thread's run; a plain one outside of any."""
    return _current.get(None) or RunContext()


@contextmanager
def use_context(context: RunContext) -> Iterator[RunContext]:
    """Let stages called in this block and thread behave as `context` says."""
    token = _current.set(context)
    try:
        yield context
    finally:
        _current.reset(token)


@contextmanager
def lent(slots: Semaphore | None) -> Iterator[None]:
    """Without the slot that this thread holds; waits for one at the end."""
    if slots is None:
        yield
        return
    slots.release()
    try:
        yield
    finally:
        slots.acquire()
