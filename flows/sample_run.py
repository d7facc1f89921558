"""Runs the stages of one sample: first a look at what is there, then a Prefect flow if anything is missing."""

import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from dcap.scene.errors import DcapError
from dcap.scene.store.artifacts import Store
from dcap.scene.types.sample import Sample
from flows.methods import place_by, plain
from flows.place import STAGES, PlaceConfig, PlacementRefs, place
from tasks.overview import overview_task
from tasks.runner.context import Event, NotCachedError, OnEvent, RunContext, StageEvent, use_context
from tasks.runner.records import Record, why_not_cached

if TYPE_CHECKING:
    from prefect import Flow

STAGE_NAMES = tuple(stage.name for stage in STAGES)
OVERVIEW = overview_task.name
"""What an infeasible placement ends with, after the stage that found no way."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What placing a sample would take."""

    sample: Sample
    cached: tuple[str, ...]
    """Stages whose results are there."""
    missing: str
    """First stage that would run; empty if none."""
    why: str
    """Why it would run."""
    finished: "FinishedSample | None" = None
    """The result, if nothing would run."""
    failed: "FailedSample | None" = None
    """What is wrong with the sample, if it cannot run."""

    @property
    def later(self) -> tuple[str, ...]:
        """Stages after the first missing one; they run if their inputs change and a placement stays feasible."""
        if self.missing in ("", OVERVIEW):
            return ()
        known = [STAGE_NAMES.index(name) for name in (*self.cached, self.missing) if name in STAGE_NAMES]
        return STAGE_NAMES[max(known, default=-1) + 1 :]

    @property
    def coming(self) -> tuple[str, ...]:
        """Stages that run or may run."""
        return (self.missing, *self.later)

    @property
    def stage_count(self) -> int:
        """Number of stages of this sample, as far as one can see."""
        return len(self.cached) + (self.missing != "") + len(self.later)


@dataclass(frozen=True, slots=True)
class FinishedSample:
    """A sample whose stages have all returned."""

    sample: Sample
    placement: PlacementRefs
    records: tuple[tuple[str, Record, bool], ...]
    """(stage, record, computed now) in order."""


@dataclass(frozen=True, slots=True)
class FailedSample:
    """A sample that did not get through."""

    sample: Sample
    error: Exception

    @property
    def message(self) -> str:
        """What went wrong in one line."""
        name = "" if isinstance(self.error, DcapError) else f"{type(self.error).__name__}: "
        return " ".join(f"{name}{self.error}".split())

    @property
    def details(self) -> str:
        """Traceback of an unexpected failure, else empty."""
        return "" if isinstance(self.error, DcapError) else "".join(traceback.format_exception(self.error))


class EventRecorder:
    """Keeps the records of the stages of one sample and passes events on."""

    def __init__(self, listener: OnEvent | None = None) -> None:
        self.records: list[tuple[str, Record, bool]] = []
        self.listener = listener

    def __call__(self, event: StageEvent) -> None:
        """One event."""
        if event.record is not None:
            self.records.append((event.stage, event.record, event.event is Event.FINISHED))
        if self.listener is not None:
            self.listener(event)


def plan_sample(sample: Sample, config: PlaceConfig) -> Plan:
    """Look every stage up without running any; a failure of this sample is a value: the others go on."""
    recorder = EventRecorder()
    try:
        with use_context(RunContext(lookup_only=True, on_event=recorder)):
            placement = place_by(sample, config)
    except NotCachedError as missing:
        why = why_not_cached(missing.deciders, Store.default())
        return Plan(sample, stages_of(recorder), missing.deciders.stage, why)
    except DcapError as error:
        told = type(error)(in_users_words(str(error), sample))
        return Plan(sample, stages_of(recorder), "", "", failed=FailedSample(sample, told))
    except Exception as error:  # the border between samples: reported in full, never hidden
        return Plan(sample, stages_of(recorder), "", "", failed=FailedSample(sample, error))
    return Plan(sample, stages_of(recorder), "", "", FinishedSample(sample, placement, tuple(recorder.records)))


def heavy_modules(names: Iterable[str]) -> list[str]:
    """Modules of those of the named stages that run in processes of their own."""
    wanted = set(names)
    return [stage.function.__module__ for stage in STAGES if stage.process is True and stage.name in wanted]


def stages_of(recorder: EventRecorder) -> tuple[str, ...]:
    """Names of the recorded stages."""
    return tuple(stage for stage, _, _ in recorder.records)


def place_flow(sample: Sample, config: PlaceConfig) -> "Flow[[Sample, PlaceConfig], PlacementRefs]":
    """The stages of a sample as one Prefect flow; needs a server.

    Prefect is imported here, after the server's address is known.
    """
    from prefect import Flow

    name = sample.id.replace("{", "(").replace("}", ")")
    stages = place if plain(sample, config) else place_by
    return Flow(stages, name="place", flow_run_name=name, validate_parameters=False, persist_result=False)


@contextmanager
def recorded(sample: Sample, context: RunContext, listener: OnEvent | None = None) -> Iterator[EventRecorder]:
    """Records the stages that are called inside as those of `sample`; errors name the user's files. `context` says how
    they run, but for its events."""
    recorder = EventRecorder(listener)
    session = replace(context.session, sample=sample.id)
    try:
        with use_context(replace(context, on_event=recorder, session=session)):
            yield recorder
    except DcapError as error:
        raise type(error)(in_users_words(str(error), sample)) from error


def try_sample(
    sample: Sample, config: PlaceConfig, *, context: RunContext, listener: OnEvent | None = None
) -> FinishedSample | FailedSample:
    """Run the stages of a sample; a failure is a value: the others go on."""
    try:
        with recorded(sample, context, listener) as recorder:
            placement = place_flow(sample, config)(sample, config)
    except Exception as error:  # the border between samples: reported in full, never hidden
        return FailedSample(sample, error)
    return FinishedSample(sample, placement, tuple(recorder.records))


def in_users_words(message: str, sample: Sample) -> str:
    """A message with the user's paths instead of the store's."""
    store = Store.default()
    for given in (sample.scene, sample.object):
        inside = store.source_path(given)
        if inside is not None:
            message = message.replace(str(inside), given)
    return message
