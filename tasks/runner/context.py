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
from typing import Any
from uuid import UUID

from dcap.language.protocol.session import Session
from dcap.scene.store.ref import Ref
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


class Producers:
    """The task runs of one flow run that returned its references, told by the objects themselves: two stages may return
    references that are equal."""

    def __init__(self) -> None:
        self._runs: dict[int, tuple[object, UUID]] = {}
        """With the object, so that its address is not given again."""

    def note(self, ref: object, task_run_id: UUID) -> None:
        """A task run has returned this reference."""
        self._runs[id(ref)] = (ref, task_run_id)

    def of(self, value: object) -> UUID | None:
        """The task run that returned this very object; None if none of them did."""
        return self._runs.get(id(value), (None, None))[1]


@dataclass(frozen=True, slots=True)
class StageCall:
    """What a stage is computed from, one time."""

    key: str
    """Of its record."""
    deciders: dict[str, Any]
    """In plain form."""
    settings: object
    """Its configuration as JSON; None if it has none."""


OnMissing = Callable[[Deciders], Ref[Any]]


def stop_looking(deciders: Deciders) -> Ref[Any]:
    """A stage without a record ends the search."""
    raise NotCachedError(deciders)


@dataclass(frozen=True, slots=True)
class RunContext:
    """How the stages that are called inside `use_context` behave."""

    lookup_only: bool = False
    """Only look records up; what happens where there is none says `on_missing`."""
    on_missing: OnMissing = stop_looking
    """Raises NotCachedError, or gives what stands for the result that is not there yet."""
    refresh: frozenset[str] = frozenset()
    """Stages to compute again although they have a record."""
    on_event: OnEvent = lambda event: None
    session: Session = field(default_factory=Session)
    """How questions are asked."""
    slots: Semaphore | None = None
    """How many stages may compute at a time; a stage that waits for a reply lends its slot to another."""
    server: ProcessServer | None = None
    """Starts the processes of heavy stages; without it each is spawned."""
    producers: Producers = field(default_factory=Producers)
    """Which task run returned which reference, in the flow run of one sample."""
    tags: tuple[str, ...] = ()
    """Of the task runs."""
    call: StageCall | None = None
    """Of the stage that runs now: Prefect is told the names of its inputs only."""


class NotCachedError(LookupError):
    """A stage has no usable record; carries what it would be computed from."""

    def __init__(self, deciders: Deciders) -> None:
        super().__init__(deciders.stage)
        self.deciders = deciders


_current: ContextVar[RunContext] = ContextVar("run context")


def current_context() -> RunContext:
    """The context of this thread's run; a plain one outside of any."""
    return _current.get(None) or RunContext()


def current_call() -> StageCall:
    """What the stage that runs now is computed from."""
    call = current_context().call
    assert call is not None
    return call


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
