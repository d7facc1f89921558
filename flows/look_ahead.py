"""What placing a sample would take of every stage: looks on where a stage has no result.

Something pending stands for a result that is not there. What takes it may run, for the same bytes may come out again;
stages beside it are looked up as ever. Where a result itself decides how a placement goes on, the search ends.
"""

from collections.abc import Iterable
from typing import Any

from dcap.scene.errors import StoreError
from dcap.scene.store.ref import Ref
from dcap.scene.types.sample import Sample
from flows.methods import PENDING
from flows.place import PlaceConfig
from flows.sample_run import (
    EventRecorder,
    FailedSample,
    FinishedSample,
    Plan,
    StagePlan,
    StageState,
    stages_of,
    through_stages,
    told_to_user,
    told_why,
    whole_placement,
)
from tasks.runner.context import RunContext, StageEvent
from tasks.runner.records import Deciders
from tasks.runner.why import reference


class Lookahead(EventRecorder):
    """Notes every stage, with or without a result."""

    def __init__(self) -> None:
        super().__init__()
        self.stages: list[StagePlan] = []

    def __call__(self, event: StageEvent) -> None:
        """A stage whose result is there."""
        super().__call__(event)
        self.stages.append(StagePlan(event.stage, StageState.CACHED, None))

    def missing(self, deciders: Deciders) -> Ref[Any]:
        """A stage whose result is not; stands for it."""
        refs = [ref for one in deciders.inputs.values() if (ref := reference(one)) is not None]
        waits = dict.fromkeys(ref.sha256 for ref in refs if ref.kind == PENDING)
        row = StagePlan(deciders.stage, StageState.MAY_RUN, after(waits)) if waits else to_run(deciders)
        self.stages.append(row)
        return Ref(PENDING, deciders.stage)

    @property
    def waiting(self) -> list[StagePlan]:
        """Stages whose results are not there."""
        return [one for one in self.stages if one.state is not StageState.CACHED]

    def add_the_rest(self, config: PlaceConfig) -> None:
        """The stages after one whose result decides how it goes on."""
        told = {one.stage for one in self.stages}
        rest = [name for name in whole_placement(config) if name not in told]
        self.stages += [StagePlan(name, StageState.MAY_RUN, after([self.waiting[-1].stage])) for name in rest]


def after(stages: Iterable[str]) -> str:
    """What a stage waits for."""
    return f"depends on {', '.join(stages)}"


def to_run(deciders: Deciders) -> StagePlan:
    """A stage that would run."""
    return StagePlan(deciders.stage, StageState.RUNS, told_why(deciders))


def plan_ahead(sample: Sample, config: PlaceConfig) -> Plan:
    """The plan of a sample with all its stages, also those after the first one that has no result."""
    ahead, failed = Lookahead(), None
    try:
        context = RunContext(lookup_only=True, on_event=ahead, on_missing=ahead.missing)
        placement = through_stages(sample, config, context)
    except Exception as error:  # the border between samples: reported in full, never hidden
        if not (ahead.waiting and isinstance(error, StoreError)):  # what is pending cannot be read
            failed = FailedSample(sample, told_to_user(error, sample))
        else:
            ahead.add_the_rest(config)
    first = next(iter(ahead.waiting), None)
    if failed is None and first is None:
        finished = FinishedSample(sample, placement, tuple(ahead.records))
        return Plan(sample, stages_of(ahead), "", "", finished, stages=tuple(ahead.stages))
    missing, why = (first.stage, first.why or "") if first and not failed else ("", "")
    return Plan(sample, stages_of(ahead), missing, why, failed=failed, stages=tuple(ahead.stages))
