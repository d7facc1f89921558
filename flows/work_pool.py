"""The work pool of a Prefect server: samples that wait in it, and the workers that take them. Imports Prefect.

A worker that is lost with its machine tells nobody. Each sample says which worker has it; one whose worker sends no
heartbeat any more ends as Crashed, and waits in the pool again.
"""

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.client.schemas.filters import FlowRunFilter
from prefect.client.schemas.objects import FlowRun, Worker, WorkerStatus
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.flows import Flow, load_flow_from_entrypoint
from prefect.utilities.callables import parameter_schema

from dcap.scene.errors import DcapError
from dcap.scene.json_tree import JsonObject
from dcap.scene.readers.files.yaml_text import parse_yaml
from dcap.scene.settings import resource
from flows.elsewhere import SampleJob, Told, told_of
from flows.flow_runs import IN_A_REQUEST, PLACE, WAS_INTERRUPTED, FlowRunNames, end_as_crashed, stand_in
from flows.lost_server import is_missing, server_errors_passed, server_lost
from flows.run_names import sample_tags
from flows.sample_flow import MOST_BEGINNINGS
from flows.server import START_SECONDS
from flows.server_wait import server_is_gone, wait_for_server

POOL = "dcap"
SAMPLE = "place/sample"
"""The deployment that places one sample."""
WORKER = "DCAP_WORKER"
"""Environment variable with the name of the worker whose process this is."""
LAST_BEAT_SECONDS = 15.0
"""A worker that claims a run has sent a heartbeat at most so long before."""
CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
"""It goes on while the machine sleeps."""
MOST_BETWEEN = 10.0
"""Seconds between two looks at the workers that count: in a longer time the server may have been away."""
LATE_SECONDS = 120.0
"""After such a time a worker is silent for so long before it counts as lost: its requests are tried again after up to
half a minute, and more of them than one may have failed."""
WORKER_LOST = "its worker was lost"
GONE = f"somebody has deleted the pool {POOL!r} or its deployment {SAMPLE!r} from the server; start a worker, which \
registers them, and give the command again: what is placed is kept"


def register() -> None:
    """Create the pool and its deployments on the server of this program, or bring them up to date."""
    tree: Any = parse_yaml(resource("prefect.yaml").read_text(encoding="utf-8"))
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=POOL, type="process"), overwrite=True)
        for one in tree["deployments"]:
            flow: Flow[..., Any] = load_flow_from_entrypoint(one["entrypoint"])
            client.create_deployment(
                client.create_flow(flow),
                one["name"],
                description=one["description"],
                work_pool_name=POOL,
                entrypoint=one["entrypoint"],
                parameter_openapi_schema=parameter_schema(flow).model_dump(),
                enforce_parameter_schema=False,
                pull_steps=tree["pull"],
            )


def worker_tag(name: str) -> str:
    """Tag of a flow run that a worker has."""
    return f"worker:{name}"


class WorkPool:
    """The pool as a benchmark uses it."""

    def __init__(self) -> None:
        self.begun: dict[str, int] = {}
        """How often each sample has begun."""
        self.waiting: dict[UUID, SampleJob] = {}
        """Samples that are in the pool, by their flow runs."""
        self.lost: dict[UUID, str] = {}
        """Flow runs that were lost with their workers and are not ended yet, and why they are to be."""
        self.silent: dict[str, Silence] = {}
        """Workers, since their last heartbeats."""
        self.claimed: dict[UUID, Silence] = {}
        """Flow runs that were claimed and have not begun."""
        self.looked = time.clock_gettime(CLOCK)
        """When the server has last said which workers there are."""

    def served(self) -> bool:
        """Whether any worker is there; the pool's deployments are registered if they were not."""
        with get_client(sync_client=True) as client:
            try:
                client.read_deployment_by_name(SAMPLE)
            except ObjectNotFound:
                register()
            return any(one.status is WorkerStatus.ONLINE for one in workers_of(client))

    def placed(self, jobs: Sequence[SampleJob], look_seconds: float) -> Iterator[Sequence[Told]]:
        """Put all samples into the pool, and yield them as they end. A server that is lost meanwhile is waited for, as
        long as a start may take: the pool is in its database."""
        left, silent_since = deque(jobs), math.inf
        with get_client(sync_client=True) as client:
            try:
                while left or self.waiting:
                    told: list[Told] = []
                    try:
                        while left:
                            self.ask(client, left[0])
                            left.popleft()
                            silent_since = math.inf
                        time.sleep(look_seconds)
                        told.extend(self.ended(client))
                        silent_since = math.inf
                    except (httpx.HTTPError, RuntimeError) as error:
                        yield told  # what is known already
                        told = []
                        silent_since = min(silent_since, time.monotonic())
                        if not server_lost(error) or time.monotonic() - silent_since > START_SECONDS:
                            raise
                        time.sleep(look_seconds)
                        wait_for_server()
                    yield told
            finally:  # who ends does not wait for a server
                for end in () if server_is_gone() else (self.end_lost, self.end_waiting):
                    with server_errors_passed():
                        end(client)

    def ended(self, client: SyncPrefectClient) -> Iterator[Told]:
        """The samples that have ended since the last look; those of lost workers are asked for again."""
        self.end_lost(client)
        runs = {run.id: run for run in self.known(client, list(self.waiting))}
        there, passed = workers_of(client), self.passed()
        gone = self.lost_workers(there, passed)
        for one, job in list(self.waiting.items()):
            run = runs.get(one)
            if run is None:
                if is_deleted(client, one):
                    del self.waiting[one]
                    yield job.sample, told_of("somebody has deleted its flow run")
            elif run.state is not None and run.state.is_final():
                del self.waiting[one]
                yield job.sample, told_by(run)
            elif why := lost(run, gone) or self.stuck(run, passed):
                again = self.begun[job.sample.id] < MOST_BEGINNINGS
                if again:
                    self.ask(client, job)
                self.lost[one] = why + "; the sample begins again" * again
                del self.waiting[one]
                if not again:
                    yield job.sample, told_of(f"{why}; it has begun {MOST_BEGINNINGS} times")
        self.end_lost(client)

    def end_lost(self, client: SyncPrefectClient) -> None:
        """Say of the flow runs that were lost with their workers that they will not go on."""
        for one, why in list(self.lost.items()):
            end_as_crashed(client, [one], why)
            del self.lost[one]

    def end_waiting(self, client: SyncPrefectClient) -> None:
        """Say of all that is in the pool that nobody waits for it any more."""
        end_as_crashed(client, self.waiting, WAS_INTERRUPTED)

    def ask(self, client: SyncPrefectClient, job: SampleJob) -> None:
        """Put a sample into the pool; once, also where an answer is lost on its way."""
        begun = self.begun.get(job.sample.id, 0)
        key = f"{job.run.id}/{job.sample.id}/{begun}"
        names = FlowRunNames(
            PLACE, job.run.title(job.sample), sample_tags(job.sample, job.run.name), {"job": job.to_json()}
        )  # fmt: skip
        try:
            deployment = client.read_deployment_by_name(SAMPLE)
        except ObjectNotFound:
            raise DcapError(GONE) from None
        run = client.create_flow_run_from_deployment(
            deployment.id,
            parameters=dict(names.parameters),
            name=names.name,
            tags=names.tags,
            idempotency_key=key,
            parent_task_run_id=None if job.run.id is None else stand_in(client, job.run.id, names, key),
        )
        self.waiting[run.id] = job
        self.begun[job.sample.id] = begun + 1

    def known(self, client: SyncPrefectClient, ids: Sequence[UUID]) -> Iterator[FlowRun]:
        """What the server knows of these flow runs, however few it tells at a time."""
        for begin in range(0, len(ids), IN_A_REQUEST):
            some = FlowRunFilter.model_validate({"id": {"any_": list(ids[begin : begin + IN_A_REQUEST])}})
            count = 0
            while page := client.read_flow_runs(flow_run_filter=some, offset=count):
                yield from page
                count += len(page)
                if count >= min(IN_A_REQUEST, len(ids) - begin):
                    break

    def passed(self) -> float:
        """The time since the server was heard last [s]; it has just been heard again."""
        before, self.looked = self.looked, time.clock_gettime(CLOCK)
        return self.looked - before

    def lost_workers(self, there: Sequence[Worker], passed: float) -> dict[str, datetime | None]:
        """Names of the workers that send no heartbeats any more, though they were listened for, and when they sent the
        last one."""
        self.silent = {one.name: Silence.after(self.silent.get(one.name), one.last_heartbeat_time, passed)
                       for one in there}  # fmt: skip
        return {
            one.name: one.last_heartbeat_time
            for one in there
            if one.status is not WorkerStatus.ONLINE and self.silent[one.name].is_telling
        }

    def stuck(self, run: FlowRun, passed: float) -> str:
        """Why a flow run that a worker has claimed does not go on; empty if it may. The server may have been away just
        as the worker asked for it, or said that it could not begin."""
        before = self.claimed.pop(run.id, None)
        if run.state is None or not run.state.is_pending():
            return ""
        silence = Silence.after(before, run.state.timestamp, passed)
        if silence.seconds > START_SECONDS:
            return "its worker has claimed it and not begun"
        self.claimed[run.id] = silence
        return ""


@dataclass(frozen=True)
class Silence:
    """How long nothing was heard of a worker, or a flow run, while the server could be asked."""

    since: datetime | None
    """When something was."""
    seconds: float = 0.0
    is_whole: bool = True
    """Whether no time is missing in which the server may have been away."""

    @classmethod
    def after(cls, before: "Silence | None", since: datetime | None, passed: float) -> "Silence":
        """What is found so long after the last look [s]: one that goes on, or a new one."""
        known = before if before is not None and before.since == since else cls(since)
        return cls(since, known.seconds + min(passed, MOST_BETWEEN), known.is_whole and passed <= MOST_BETWEEN)

    @property
    def is_telling(self) -> bool:
        """Whether it says that the worker is lost; the server has judged by the time alone."""
        return self.is_whole or self.seconds > LATE_SECONDS


def is_deleted(client: SyncPrefectClient, run: UUID) -> bool:
    """Whether the server knows nothing of a flow run."""
    try:
        client.read_flow_run(run)
    except ObjectNotFound:
        return True
    return False


def workers_of(client: SyncPrefectClient) -> list[Worker]:
    """The workers that have served the pool, however few the server tells at a time."""
    found: list[Worker] = []
    try:
        while page := client.read_workers_for_work_pool(POOL, offset=len(found)):
            found += page
    except (ObjectNotFound, PrefectHTTPStatusError) as error:
        if is_missing(error):
            raise DcapError(GONE) from None
        raise
    return found


def lost(run: FlowRun, gone: Mapping[str, datetime | None]) -> str:
    """Why a flow run goes on only on paper: its worker is gone, or one that may have claimed it and did not get so far
    as to say so. Empty if it may go on."""
    if run.state is None or run.state.is_scheduled():
        return ""
    names = [tag.partition(":")[2] for tag in run.tags if tag.startswith(worker_tag(""))]
    if names:
        return WORKER_LOST if names[-1] in gone else ""
    claimed = run.state.timestamp - timedelta(seconds=LAST_BEAT_SECONDS)
    return WORKER_LOST if any(last is not None and last >= claimed for last in gone.values()) else ""


def told_by(run: FlowRun) -> JsonObject:
    """What a flow run that has ended tells of its sample."""
    assert run.state is not None
    if run.state.is_completed():
        return told_of("")
    return told_of(run.state.message or f"its flow run ended as {run.state.name}")
