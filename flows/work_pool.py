"""The work pool of a Prefect server: samples that wait in it, and the workers that take them. Imports Prefect.

A worker that is lost with its machine tells nobody. Each sample says which worker has it; one whose worker sends no
heartbeat any more ends as Crashed, and waits in the pool again.
"""

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timedelta
from functools import partial
from typing import Any, TypeVar
from uuid import UUID

import httpx
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.client.schemas.filters import FlowRunFilter
from prefect.client.schemas.objects import FlowRun, WorkerStatus
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound, PrefectException
from prefect.flows import Flow, load_flow_from_entrypoint
from prefect.utilities.callables import parameter_schema

from dcap.scene.json_tree import JsonObject
from dcap.scene.readers.files.yaml_text import parse_yaml
from dcap.scene.settings import resource
from flows.elsewhere import SampleJob, Told, told_of
from flows.flow_runs import IN_A_REQUEST, WAS_INTERRUPTED, end_as_crashed
from flows.run_names import sample_tags
from flows.sample_flow import server_lost
from flows.server import wait_for_server

Answer = TypeVar("Answer")

POOL = "dcap"
SAMPLE = "place/sample"
"""The deployment that places one sample."""
WORKER = "DCAP_WORKER"
"""Environment variable with the name of the worker whose process this is."""
TIMES = 4
"""How often a sample may begin again because its worker was lost; how often in a row a look may lose the server."""
UNTOLD = (httpx.HTTPError, PrefectException, RuntimeError)
"""What a server that is away, or refuses, comes to where nothing depends on its answer."""
LAST_BEAT_SECONDS = 15.0
"""A worker that claims a run has sent a heartbeat at most so long before."""
SLOW_SECONDS = 10.0
"""A server that answers a request only after so long was not there: Prefect's client has asked it again and again."""
LATE_SECONDS = 120.0
"""So long after a loss of the server, a worker's silence says nothing: its requests are tried again after up to half a
minute, and more of them than one may have failed."""


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
        self.heard_since = -math.inf
        """When the server was there again, as the last of its losses ended."""

    def served(self) -> bool:
        """Whether any worker is there; the pool's deployments are registered if they were not."""
        with get_client(sync_client=True) as client:
            try:
                client.read_deployment_by_name(SAMPLE)
            except ObjectNotFound:
                register()
            return bool(online(client))

    def placed(self, jobs: Sequence[SampleJob], look_seconds: float) -> Iterator[Sequence[Told]]:
        """Put all samples into the pool, and yield them as they end. A server that is lost meanwhile is waited for: the
        pool is in its database."""
        left, losses = deque(jobs), 0
        with get_client(sync_client=True) as client:
            try:
                while left or self.waiting:
                    told: list[Told] = []
                    try:
                        while left:
                            self.ask(client, left[0])
                            left.popleft()
                        time.sleep(look_seconds)
                        told.extend(self.ended(client))
                        losses = 0
                    except (httpx.HTTPError, RuntimeError) as error:
                        yield told  # what is known already
                        losses, told = losses + 1, []
                        if not server_lost(error) or losses == TIMES:
                            raise
                        wait_for_server()
                        self.heard_since = time.monotonic()
                    yield told
            finally:
                with suppress(*UNTOLD):  # who ends does not wait for a server
                    self.end_lost(client)
                    end_as_crashed(client, self.waiting, WAS_INTERRUPTED)

    def ended(self, client: SyncPrefectClient) -> Iterator[Told]:
        """The samples that have ended since the last look; those of lost workers are asked for again."""
        self.end_lost(client)
        runs = {run.id: run for run in self.known(client, list(self.waiting))}
        silent = self.heard(partial(lost_workers, client))
        gone = silent if time.monotonic() - self.heard_since > LATE_SECONDS else {}
        for one, job in list(self.waiting.items()):
            run = runs.get(one)
            if run is None:
                if is_deleted(client, one):
                    del self.waiting[one]
                    yield job.sample, told_of("somebody has deleted its flow run")
            elif run.state is not None and run.state.is_final():
                del self.waiting[one]
                yield job.sample, told_by(run)
            elif lost(run, gone):
                again = self.begun[job.sample.id] < TIMES
                if again:
                    self.ask(client, job)
                self.lost[one] = "its worker was lost" + "; the sample begins again" * again
                del self.waiting[one]
                if not again:
                    yield job.sample, told_of(f"its worker was lost {TIMES} times")
        self.end_lost(client)

    def end_lost(self, client: SyncPrefectClient) -> None:
        """Say of the flow runs that were lost with their workers that they will not go on."""
        for one, why in list(self.lost.items()):
            end_as_crashed(client, [one], why)
            del self.lost[one]

    def ask(self, client: SyncPrefectClient, job: SampleJob) -> None:
        """Put a sample into the pool; once, also where an answer is lost on its way."""
        begun = self.begun.get(job.sample.id, 0)
        asking = partial(
            run_deployment,
            SAMPLE,
            parameters={"job": job.to_json()},
            flow_run_name=job.run.title(job.sample),
            tags=sample_tags(job.sample, job.run.name),
            timeout=0,
            idempotency_key=f"{job.run.id}/{job.sample.id}/{begun}",
        )
        run: FlowRun = self.heard(asking)  # type: ignore[assignment]  # a coroutine only in a loop
        self.waiting[run.id] = job
        self.begun[job.sample.id] = begun + 1
        if run.parent_task_run_id is not None:  # stands for it in the benchmark's flow run, with a name of Prefect's
            with suppress(*UNTOLD):
                client.set_task_run_name(run.parent_task_run_id, job.run.title(job.sample))

    def known(self, client: SyncPrefectClient, ids: Sequence[UUID]) -> Iterator[FlowRun]:
        """What the server knows of these flow runs, however few it tells at a time."""
        for begin in range(0, len(ids), IN_A_REQUEST):
            some = FlowRunFilter.model_validate({"id": {"any_": list(ids[begin : begin + IN_A_REQUEST])}})
            count = 0
            while page := self.heard(partial(client.read_flow_runs, flow_run_filter=some, offset=count)):
                yield from page
                count += len(page)
                if count >= min(IN_A_REQUEST, len(ids) - begin):
                    break

    def heard(self, request: Callable[[], Answer]) -> Answer:
        """The answer to one request; it is noted where the server was away before it."""
        begin = time.monotonic()
        answer = request()
        if time.monotonic() - begin > SLOW_SECONDS:
            self.heard_since = time.monotonic()
        return answer


def is_deleted(client: SyncPrefectClient, run: UUID) -> bool:
    """Whether the server knows nothing of a flow run."""
    try:
        client.read_flow_run(run)
    except ObjectNotFound:
        return True
    return False


def online(client: SyncPrefectClient) -> set[str]:
    """Names of the workers that send heartbeats."""
    workers = client.read_workers_for_work_pool(POOL)
    return {one.name for one in workers if one.status is WorkerStatus.ONLINE}


def lost_workers(client: SyncPrefectClient) -> dict[str, datetime | None]:
    """Names of the workers that send no heartbeats any more, and when they sent the last one."""
    workers = client.read_workers_for_work_pool(POOL)
    return {one.name: one.last_heartbeat_time for one in workers if one.status is not WorkerStatus.ONLINE}


def lost(run: FlowRun, gone: Mapping[str, datetime | None]) -> bool:
    """Whether a flow run goes on only on paper: its worker is gone, or one that may have claimed it and did not get so
    far as to say so."""
    if run.state is None or run.state.is_scheduled():
        return False
    names = [tag.partition(":")[2] for tag in run.tags if tag.startswith(worker_tag(""))]
    if names:
        return names[-1] in gone
    claimed = run.state.timestamp - timedelta(seconds=LAST_BEAT_SECONDS)
    return any(last is not None and last >= claimed for last in gone.values())


def told_by(run: FlowRun) -> JsonObject:
    """What a flow run that has ended tells of its sample."""
    assert run.state is not None
    if run.state.is_completed():
        return told_of("")
    return told_of(run.state.message or f"its flow run ended as {run.state.name}")
