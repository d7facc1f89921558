"""A sample that another process places, perhaps on another machine: what it is asked, and what it tells.

In: a `SampleJob` as JSON. Out: what went wrong, if anything. Results come back through the store that both share:
whoever asked looks the sample up there, as it would look up one that was placed yesterday.
"""

import atexit
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import cache
from uuid import UUID

from dcap.language.protocol.session import Session
from dcap.scene.errors import StoreError
from dcap.scene.json_tree import JsonObject, object_to_json
from dcap.scene.types.sample import Sample
from flows.place import PlaceConfig
from flows.run_files import located, sample_from_json
from flows.run_names import WatchedRun
from flows.sample_run import (
    STAGE_NAMES,
    ElsewhereError,
    FailedSample,
    FinishedSample,
    Plan,
    heavy_modules,
    plan_sample,
    try_sample,
)
from tasks.runner.context import RunContext
from tasks.runner.process_server import ProcessServer, process_server

Told = tuple[Sample, JsonObject]
"""A sample that has ended elsewhere, and what was told of it."""


@dataclass(frozen=True, slots=True)
class SampleJob:
    """A sample to place."""

    sample: Sample
    config: PlaceConfig
    session: Session
    run: WatchedRun
    """The run that it belongs to."""

    def to_json(self) -> JsonObject:
        """Plain form."""
        return object_to_json(
            {
                "sample": asdict(located(self.sample)),  # workers have other working directories
                "config": self.config.model_dump(mode="json"),
                "session": self.session.to_json(),
                "run": self.run.name,
                "run_id": str(self.run.id) if self.run.id else None,
                "repeated": sorted(self.run.repeated),
            }
        )

    @classmethod
    def from_json(cls, tree: JsonObject) -> "SampleJob":
        """The job that `to_json` wrote."""
        sample, session, repeated = (tree[name] for name in ("sample", "session", "repeated"))
        assert isinstance(sample, dict)
        assert isinstance(session, dict)
        assert isinstance(repeated, list)
        run_id = tree["run_id"]
        return cls(
            sample=sample_from_json(sample),
            config=PlaceConfig.model_validate(tree["config"]),
            session=Session(**session),
            run=WatchedRun(str(tree["run"]), UUID(str(run_id)) if run_id else None, frozenset(map(str, repeated))),
        )


def place_job(tree: JsonObject) -> JsonObject:
    """Place a sample here, in a flow run of its own; what went wrong, empty if nothing."""
    result = placed(SampleJob.from_json(tree))
    return told_of(result.message, result.details) if isinstance(result, FailedSample) else told_of("")


def placed(job: SampleJob, *, in_own_run: bool = True) -> FinishedSample | FailedSample:
    """The sample of a job, placed here in a flow run of its own or in the one that this is called in."""
    context = RunContext(session=job.session, server=server_of_process())
    return try_sample(job.sample, job.config, context=context, run=job.run, in_own_run=in_own_run)


def told_of(error: str, details: str = "") -> JsonObject:
    """What is told of a sample: what went wrong, empty if nothing, and the traceback of what nobody foresaw."""
    return {"error": error, "details": details}


@cache
def server_of_process() -> ProcessServer | None:
    """What starts the processes of heavy stages for all samples that come to this process."""
    stack = ExitStack()
    atexit.register(stack.close)
    return stack.enter_context(process_server(heavy_modules(STAGE_NAMES)))


def fetched(plan: Plan, config: PlaceConfig, told: JsonObject) -> FinishedSample | FailedSample:
    """How a sample has ended that was placed elsewhere, by what was told of it and what lies in the store now. `plan`
    says which of its stages were there before."""
    if told["error"]:
        error = as_given(str(told["error"]), plan.sample)
        return FailedSample(plan.sample, ElsewhereError(error, str(told["details"])))
    now = plan_sample(plan.sample, config)
    if now.finished is None:
        return now.failed or FailedSample(plan.sample, not_shared(now))
    before = len(plan.cached)
    records = tuple((stage, one, k >= before) for k, (stage, one, _) in enumerate(now.finished.records))
    return replace(now.finished, records=records)


def as_given(message: str, sample: Sample) -> str:
    """A message with the user's paths instead of the whole ones that the job had."""
    whole = located(sample)
    for path, given in ((whole.scene, sample.scene), (whole.object, sample.object), (whole.labels, sample.labels)):
        message = message.replace(path, given) if path else message
    return message


def not_shared(plan: Plan) -> StoreError:
    """Why results that were computed are not here."""
    return StoreError(
        f"{plan.sample.id} was placed, but its stage {plan.missing} is not in the store here ({plan.why}); workers and "
        "this program need the same version of dcap and the same DCAP_DATA or DCAP_STORE"
    )
