"""Runs the stages of one sample: first a look at what is there, then a Prefect flow if anything is missing."""

import os
import traceback
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum

from dcap.scene.errors import DcapError, ServerGoneError
from dcap.scene.secrets import redacted
from dcap.scene.store.artifacts import FILES_FOLDER, Store
from dcap.scene.types.sample import Sample
from flows.methods import measuring, place_by
from flows.place import SECTIONS, STAGES, PlaceConfig, PlacementRefs
from flows.run_names import WatchedRun, sample_tags
from tasks.overview import overview_task
from tasks.runner.context import Event, NotCachedError, OnEvent, Producers, RunContext, StageEvent, use_context
from tasks.runner.outcomes import error_line, known_error
from tasks.runner.records import Deciders, Record
from tasks.runner.why import in_words, why_not_cached

STAGE_NAMES = tuple(stage.name for stage in STAGES)
OVERVIEW = overview_task.name
"""What an infeasible placement ends with, after the stage that found no way."""


class StageState(StrEnum):
    """What would become of a stage."""

    CACHED = "cached"
    RUNS = "runs"
    MAY_RUN = "may_run"


@dataclass(frozen=True, slots=True)
class StagePlan:
    """What placing a sample would take of one stage."""

    stage: str
    state: StageState
    why: str | None
    """Why it would run, or on which stages it depends; None if its result is there."""


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
    stages: tuple[StagePlan, ...] = ()
    """Every stage that is foreseen, in order; empty where nobody has looked ahead."""
    whole: tuple[str, ...] = STAGE_NAMES
    """The stages of a feasible placement, in order, with those that measure it if it is measured."""

    @property
    def settled(self) -> "FinishedSample | FailedSample | None":
        """How the sample ends without any work; None if there is some."""
        return self.finished or self.failed

    @property
    def later(self) -> tuple[str, ...]:
        """Stages after the first missing one; they run if their inputs change and a placement stays feasible."""
        if self.stages:
            ahead = [one.stage for one in self.stages if one.state is not StageState.CACHED]
            return tuple(ahead[1:])
        if self.missing in ("", OVERVIEW):
            return ()
        known = [self.whole.index(name) for name in (*self.cached, self.missing) if name in self.whole]
        return self.whole[max(known, default=-1) + 1 :]

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
        return error_line(self.error)

    @property
    def details(self) -> str:
        """Traceback of an unexpected failure, else empty."""
        if isinstance(self.error, ElsewhereError):
            return self.error.details
        return "" if known_error(self.error) else redacted("".join(traceback.format_exception(self.error)))


class ElsewhereError(DcapError):
    """What went wrong with a sample where another process placed it."""

    def __init__(self, message: str, details: str = "") -> None:
        super().__init__(message)
        self.details = details
        """Its traceback there, if nobody foresaw it."""


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


def whole_placement(config: PlaceConfig) -> tuple[str, ...]:
    """The stages of a feasible placement, in order."""
    return (*STAGE_NAMES, *measuring(config))


def told_why(deciders: Deciders) -> str:
    """Why a stage has no result, settings by their names in `dcap.yaml`."""
    return in_words(why_not_cached(deciders, Store.default()), lambda stage, key: f"{SECTIONS.get(stage, stage)}.{key}")


def through_stages(sample: Sample, config: PlaceConfig, context: RunContext) -> PlacementRefs:
    """A sample's stages as a context says that looks only."""
    with use_context(context):
        return place_by(sample, config)


def plan_sample(sample: Sample, config: PlaceConfig) -> Plan:
    """Look every stage up without running any; a failure of this sample is a value: the others go on."""
    recorder = EventRecorder()
    try:
        placement = through_stages(sample, config, RunContext(lookup_only=True, on_event=recorder))
    except NotCachedError as missing:
        reason = told_why(missing.deciders)
        return Plan(sample, stages_of(recorder), missing.deciders.stage, reason, whole=whole_placement(config))
    except Exception as error:  # the border between samples: reported in full, never hidden
        failed = FailedSample(sample, told_to_user(error, sample))
        return Plan(sample, stages_of(recorder), "", "", failed=failed)
    return Plan(sample, stages_of(recorder), "", "", FinishedSample(sample, placement, tuple(recorder.records)))


def looked_up(sample: Sample, config: PlaceConfig) -> tuple[list[Record], str]:
    """The records of a sample that are there, up to the first missing one; and what is wrong with the sample."""
    recorder, wrong = EventRecorder(), ""
    try:
        with use_context(RunContext(lookup_only=True, on_event=recorder)):
            place_by(sample, config)
    except NotCachedError:
        pass  # the rest was not computed
    except Exception as error:  # the border between samples: what is wrong with one is told
        wrong = FailedSample(sample, error).message
    return [record for _, record, _ in recorder.records], wrong


def heavy_modules(names: Iterable[str]) -> list[str]:
    """Modules of those of the named stages that run in processes of their own."""
    wanted = set(names)
    return [stage.function.__module__ for stage in STAGES if stage.process is True and stage.name in wanted]


def stages_of(recorder: EventRecorder) -> tuple[str, ...]:
    """Names of the recorded stages."""
    return tuple(stage for stage, _, _ in recorder.records)


@contextmanager
def recorded(
    sample: Sample, context: RunContext, listener: OnEvent | None = None, run: str = ""
) -> Iterator[EventRecorder]:
    """Records the stages that are called inside as those of `sample` in a run; errors name the user's files. `context`
    says how they run, but for its events."""
    recorder = EventRecorder(listener)
    own = replace(
        context,
        on_event=recorder,
        session=replace(context.session, sample=sample.id),
        producers=Producers(),
        tags=sample_tags(sample, run),
    )
    with users_words(sample), use_context(own):
        yield recorder


@contextmanager
def users_words(sample: Sample) -> Iterator[None]:
    """Errors name the user's files."""
    try:
        yield
    except DcapError as error:
        raise type(error)(in_users_words(str(error), sample)) from error


def try_sample(
    sample: Sample,
    config: PlaceConfig,
    *,
    context: RunContext,
    listener: OnEvent | None = None,
    run: WatchedRun | None = None,
    in_own_run: bool = True,
) -> FinishedSample | FailedSample:
    """Run the stages of a sample, in a flow run of its own or in the one that this is called in; a failure is a value:
    the others go on."""
    try:
        with recorded(sample, context, listener, run.name if run else "") as recorder:
            if not in_own_run:
                placement = place_by(sample, config)
            else:
                from flows.sample_flow import flow_runs_of  # imports Prefect, after the server's address is known

                for flow_run in flow_runs_of(sample, run):
                    recorder.records.clear()  # of a flow run that was lost with its server
                    with flow_run, users_words(sample):
                        placement = place_by(sample, config)
                        flow_run.show(placement)
    except ServerGoneError:  # nor will the others find it
        raise
    except Exception as error:  # the border between samples: reported in full, never hidden
        return FailedSample(sample, error)
    return FinishedSample(sample, placement, tuple(recorder.records))


def told_to_user(error: Exception, sample: Sample) -> Exception:
    """An error on purpose with the user's paths; any other as it is."""
    return type(error)(in_users_words(str(error), sample)) if isinstance(error, DcapError) else error


def in_users_words(message: str, sample: Sample) -> str:
    """A message with the user's paths instead of the store's."""
    store = Store.default()
    for given in (sample.scene, sample.object):
        inside = store.source_path(given)
        if inside is None:
            continue
        message = message.replace(str(inside), given)
        if inside.name != FILES_FOLDER:  # not a whole folder: what lies beside the file was named by it
            beside = os.path.join(os.path.dirname(given), "")
            message = message.replace(os.path.join(inside.parent, ""), beside)
    return message
