"""Runs or looks up the stages of one sample, and keeps the result of each."""

import os
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dcap.scene.errors import DcapError
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.secrets import redacted
from dcap.scene.text import shortened
from dcap.scene.types.sample import Sample
from flows.methods import place_by
from flows.place import SECTIONS, STAGES, PlaceConfig, PlacementRefs
from tasks.artifact import FILES, Record, Ref, Store
from tasks.machine_errors import machine_error
from tasks.overview import overview_task
from tasks.run_context import Event, Mode, OnEvent, RunContext, StageEvent, use_context
from tasks.upkeep import why_not_cached

LONGEST = 200
"""Longest name or tag on a page of Prefect [characters]."""
STAGE_NAMES = tuple(stage.name for stage in STAGES)
OVERVIEW = overview_task.name
"""Stages of an infeasible placement after the stage that found it infeasible."""


@dataclass(frozen=True, slots=True)
class StageResult:
    """Result of a stage of a sample."""

    stage: str
    ref: Ref[object]
    computed: bool
    """True if computed now, False if found in the cache."""

    @property
    def record(self) -> Record:
        """Record of its computation."""
        assert self.ref.record is not None
        return self.ref.record


@dataclass(frozen=True, slots=True)
class FinishedSample:
    """A sample whose stages have all returned."""

    sample: Sample
    placement: PlacementRefs
    results: tuple[StageResult, ...]
    """In the order of the stages."""


@dataclass(frozen=True, slots=True)
class FailedSample:
    """A sample that failed."""

    sample: Sample
    error: BaseException

    @property
    def message(self) -> str:
        """The error in one line."""
        return error_line(self.error)

    @property
    def details(self) -> str:
        """Traceback of an unexpected failure, else empty."""
        return "" if known_error(self.error) else redacted("".join(traceback.format_exception(self.error)))


@dataclass(frozen=True, slots=True)
class StagePlan:
    """Plan for one stage of a sample."""

    stage: str
    state: str
    """cached, runs, or may_run: it depends on a stage that runs, and may get the same input as before."""
    why: str | None
    """Why it would run, or for which stages it waits; None if its result is there."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Plan for placing a sample."""

    sample: Sample
    stages: tuple[StagePlan, ...]
    """Every stage that can be foreseen, in order."""
    finished: FinishedSample | None = None
    """The result, if nothing would run."""
    failed: FailedSample | None = None
    """The sample's error, if it cannot run."""
    found: tuple[StageResult, ...] = ()
    """Cached results."""

    @property
    def cached(self) -> tuple[str, ...]:
        """Stages whose results are cached."""
        return tuple(one.stage for one in self.stages if one.state == "cached")

    @property
    def missing(self) -> tuple[StagePlan, ...]:
        """Stages that run or may run."""
        return tuple(one for one in self.stages if one.state != "cached")

    @property
    def why(self) -> str:
        """Why the first stage would run, or the sample's error."""
        if self.failed is not None:
            return self.failed.message
        return (self.missing[0].why or "") if self.missing else ""


class EventRecorder:
    """Keeps the results of the stages of one sample, passes events on, and plans the missing stages."""

    def __init__(self, listener: OnEvent | None = None) -> None:
        self.results: list[StageResult] = []
        self.plans: list[StagePlan] = []
        self.listener = listener

    def __call__(self, event: StageEvent) -> None:
        """Take one event."""
        if event.ref is not None:
            self.results.append(StageResult(event.stage, event.ref, event.event is Event.FINISHED))
            self.plans.append(StagePlan(event.stage, "cached", None))
        elif event.event is Event.MISSING and event.recipe:
            self.plans.append(StagePlan(event.stage, "runs", why_not_cached(event.recipe, key_of_setting)))
        elif event.event is Event.MISSING:
            self.plans.append(StagePlan(event.stage, "may_run", f"depends on {event.text}"))
        if self.listener is not None:
            self.listener(event)


def key_of_setting(stage: str, name: str) -> str:
    """Return the name of a stage's setting in `dcap.yaml`."""
    return f"{SECTIONS.get(stage, stage)}.{name}"


def run_sample(sample: Sample, config: PlaceConfig, context: RunContext) -> FinishedSample:
    """Run the stages of a sample as `context` says, or look them up."""
    recorder = EventRecorder(context.on_event)
    with sample_context(sample, replace(context, on_event=recorder)):
        placement = place_by(sample, config)
    return FinishedSample(sample, placement, tuple(recorder.results))


def plan_sample(sample: Sample, config: PlaceConfig, *, bring: bool = True) -> Plan:
    """Look up every stage of a sample, including those after missing results. With `bring`, results that only the
    shared store has are copied here."""
    recorder = EventRecorder()
    try:
        with sample_context(sample, RunContext(Mode.LOOKUP, recorder, bring=bring)):
            placement = place_by(sample, config)
    except Exception as error:  # an error of one sample is reported, and the others are planned
        failed = FailedSample(sample, error)
        return Plan(sample, tuple(recorder.plans), failed=failed, found=tuple(recorder.results))
    results = tuple(recorder.results)
    complete = all(one.state == "cached" for one in recorder.plans)
    finished = FinishedSample(sample, placement, results) if complete else None
    return Plan(sample, tuple(recorder.plans), finished, found=results)


@contextmanager
def sample_context(sample: Sample, context: RunContext, run: str = "") -> Iterator[None]:
    """Run the stages that are called inside as those of a sample; errors name the user's files."""
    session = replace(context.session, sample=sample.id)
    try:
        with use_context(replace(context, session=session, tags=context.tags or sample_tags(sample, run))):
            yield
    except DcapError as error:
        raise type(error)(in_users_words(str(error), sample)) from error


def in_users_words(message: str, sample: Sample) -> str:
    """Return a message with the user's paths instead of the store's."""
    store = Store.default()
    for given in (sample.scene, sample.object):
        inside = store.source_path(given)
        if inside is None:
            continue
        message = message.replace(str(inside), given)
        if inside.name != FILES:  # not the whole folder: the file itself names its companions
            message = message.replace(os.path.join(inside.parent, ""), os.path.join(os.path.dirname(given), ""))
    return message


def known_error(error: BaseException) -> DcapError | None:
    """Return the error as one that a user can fix; None for a bug of ours."""
    return error if isinstance(error, DcapError) else machine_error(error)


def error_line(error: BaseException) -> str:
    """Return the error message without secrets, with the error's class if it is a bug of ours."""
    known = known_error(error)
    lines = [line for line in str(known or error).splitlines() if line.strip()]
    if any(line.startswith("Traceback") for line in lines[:-1]):  # last output of a process
        lines = [lines[0], "…", lines[-1]]
    words = " ".join(" ".join(lines).split())
    return redacted(words if known else f"{type(error).__name__}: {words}")


def sample_tags(sample: Sample, run: str = "") -> tuple[str, ...]:
    """Return the tags of a sample's task run and of its stages."""
    named = ("run", run), ("method", sample.method), ("scene", plain_name(sample.scene))
    return tuple(shorten(f"{key}:{value}") for key, value in named if value)


def benchmark_tags(run: str, methods: Sequence[str]) -> tuple[str, ...]:
    """Return the tags of a benchmark's flow run."""
    return (shorten(f"run:{run}"), *(f"method:{method}" for method in methods))


def plain_name(path: str) -> str:
    """Return the name of a file or folder, without a suffix or name that only says that it is a mesh."""
    last = Path(path)
    return last.stem if last.suffix.lower() in MESH_SUFFIXES else last.name


def shorten(text: str) -> str:
    """Return a name shortened to fit a line."""
    line = " ".join("".join(one if one.isprintable() else " " for one in text).split())
    return shortened(line, LONGEST)
