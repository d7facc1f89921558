"""The work pool of a Prefect server: samples that are run as deployments by workers, on any machine. Imports Prefect.

A worker that is lost with its machine cannot report it. A sample is therefore given up and runs again if its process is
gone, its worker has sent no heartbeat for long, or no worker has claimed it for long after its start.
"""

import os
import platform
import time
from dataclasses import asdict, replace
from typing import Any
from uuid import UUID

from prefect import flow, task
from prefect.cache_policies import NO_CACHE
from prefect.client.orchestration import SyncPrefectClient, get_client
from prefect.client.schemas.actions import WorkPoolCreate
from prefect.client.schemas.objects import FlowRun, State, TaskRun, WorkerStatus
from prefect.deployments import run_deployment
from prefect.exceptions import ObjectNotFound
from prefect.flows import Flow, load_flow_from_entrypoint
from prefect.runtime import flow_run
from prefect.states import Completed, Crashed, Failed
from prefect.utilities.callables import parameter_schema

from dcap.cores import available_cores
from dcap.language.protocol.session import Session
from dcap.scene.errors import DcapError, StoreError
from dcap.scene.readers.files import parse_yaml
from dcap.scene.settings import resource
from flows.configure import with_threads
from flows.place import PlaceConfig
from flows.run_files import located, sample_from_json
from flows.sample_run import FinishedSample, StageResult, error_line, plan_sample, sample_tags
from flows.server import was_given_up
from flows.watched import (
    PlacedSample,
    SampleJob,
    ending_of,
    run_watched,
    sample_run_name,
    show_pictures,
    tag_task_run,
)
from tasks.machine_errors import pass_over_server_errors
from tasks.process import die_with_parent

POOL, SAMPLE = "dcap", "place/sample"
"""The pool, and the deployment that places one sample."""
LOOK_SECONDS = 1.0
LOST_SECONDS = 120.0
"""Time without a heartbeat of its worker, sent every 10 s, after which a sample is given up [s]."""
CACHED, PROCESS = "Cached", "process:"
"""Name of the state of a fully cached sample; prefix of the tag that names a sample's process."""
WORKER = "DCAP_WORKER"
"""Variable with the worker's name, HOST-NUMBER-RANDOM, in the environment of a sample's process."""


class LostWorkerError(DcapError):
    """The worker that had a sample is gone."""


def register() -> None:
    """Create the pool and its deployments on the server of this program, or bring them up to date."""
    tree: Any = parse_yaml(resource("prefect.yaml").read_text(encoding="utf-8"))
    with get_client(sync_client=True) as client:
        client.create_work_pool(WorkPoolCreate(name=POOL, type="process"), overwrite=True)
        for one in tree["deployments"]:
            deployed: Flow[..., Any] = load_flow_from_entrypoint(one["entrypoint"])
            client.create_deployment(
                client.create_flow(deployed),
                one["name"],
                description=one["description"],
                work_pool_name=POOL,
                entrypoint=one["entrypoint"],
                parameter_openapi_schema=parameter_schema(deployed).model_dump(),
                enforce_parameter_schema=False,
                pull_steps=tree["pull"],
            )


def _worker_is_lost(task: Any, task_run: TaskRun, state: State[Any]) -> bool:
    return isinstance(state.data, LostWorkerError)


@task(
    name="sample", task_run_name=sample_run_name, cache_policy=NO_CACHE, persist_result=False,
    retries=3, retry_condition_fn=_worker_is_lost,
)  # fmt: skip
def place_in_pool(job: SampleJob) -> object:
    """Have a worker place a sample, and look its results up in the shared store."""
    tag_task_run(job)
    tags = sample_tags(job.sample, job.run)
    asked: Any = run_deployment(
        SAMPLE, parameters={"job": job_to_json(job)}, flow_run_name=job.sample.id, tags=list(tags), timeout=0
    )
    state = _final_state(asked.id)
    if not state.is_completed():
        raise DcapError(state.message or f"its flow run ended as {state.name}")
    plan = plan_sample(job.sample, job.config)
    if plan.finished is None:
        raise StoreError(
            f"{job.sample.id} was placed, but not all of it is in the store here ({plan.why}); workers and this "
            "program need the same version of dcap and the same DCAP_DATA or DCAP_STORE"
        )
    results = tuple(StageResult(one.stage, one.ref, state.name != CACHED) for one in plan.finished.results)
    finished = FinishedSample(job.sample, plan.finished.placement, results)
    name, why = ending_of(finished)
    return Completed(name=name, message=why or None, data=PlacedSample(finished))


def _final_state(run_id: UUID) -> State[Any]:
    """Wait for the final state of a flow run; LostWorkerError if its worker is lost, DcapError if the server is lost or
    no longer has the run."""
    heard = seen = time.monotonic()
    while True:
        time.sleep(LOOK_SECONDS)
        with pass_over_server_errors() as lost, get_client(sync_client=True) as client:
            try:
                run = client.read_flow_run(run_id)
            except ObjectNotFound:
                raise DcapError("its flow run was deleted from the server") from None
            heard = time.monotonic()
            if run.state is not None and run.state.is_final():
                return run.state
            worker, pid = _process_of(run)
            waits = run.state is None or run.state.is_scheduled()
            if waits or _is_online(client, worker):
                seen = time.monotonic()
            if _is_gone(worker, pid) or time.monotonic() - seen > LOST_SECONDS:
                client.set_flow_run_state(run_id, Crashed(message="its worker was lost"), force=True)
                raise LostWorkerError("its worker was lost")
        if (lost and was_given_up()) or time.monotonic() - heard > LOST_SECONDS:
            raise DcapError(
                "the Prefect server was lost, so it is unknown whether its worker has placed it; run it again"
            )


def _is_online(client: SyncPrefectClient, worker: str) -> bool:
    """Return whether a worker of this name answers."""
    try:
        workers = client.read_workers_for_work_pool(POOL)
    except ObjectNotFound:  # the pool was deleted
        return False
    return any(one.status is WorkerStatus.ONLINE and one.name == worker for one in workers)


def _process_of(run: FlowRun) -> tuple[str, int]:
    """Return the worker and the process that a flow run has reported; an empty name before it has begun."""
    told = next((tag.removeprefix(PROCESS) for tag in run.tags if tag.startswith(PROCESS)), ":0")
    worker, _, pid = told.rpartition(":")
    return worker, int(pid)


def _is_gone(worker: str, pid: int) -> bool:
    """Return whether a worker's process on this machine has ended; False for other machines, where it is unknown."""
    if worker.rsplit("-", 2)[0] != platform.node():
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    except PermissionError:
        return False
    return False


@flow(name="place", persist_result=False, validate_parameters=False)
def place_for_pool(job: dict[str, Any]) -> State[Any]:
    """Place the sample of a job on a worker, and leave its results in the store."""
    die_with_parent()  # killing a worker kills its samples
    mine = job_from_json(job)
    if not mine.config.drop.threads:
        mine = replace(mine, config=with_threads(mine.config, available_cores()))
    with pass_over_server_errors(), get_client(sync_client=True) as client:
        tags = [*sample_tags(mine.sample, mine.run), f"{PROCESS}{os.environ.get(WORKER, '')}:{os.getpid()}"]
        client.update_flow_run(UUID(flow_run.id), tags=tags)
    try:
        finished = run_watched(mine)
    except Exception as error:
        return Failed(message=error_line(error))
    show_pictures(finished)
    name, why = ending_of(finished)
    computed = any(one.computed for one in finished.results)
    return Completed(name=name if computed else CACHED, message=why or None)


def job_to_json(job: SampleJob) -> dict[str, Any]:
    """Return a job in plain form, with whole paths: workers have other working directories."""
    return {
        "sample": asdict(located(job.sample)),
        "config": job.config.model_dump(mode="json"),
        "session": job.session.to_json(),
        "run": job.run,
        "limits": sorted(job.limits),
    }


def job_from_json(tree: dict[str, Any]) -> SampleJob:
    """Return the job that `job_to_json` wrote."""
    return SampleJob(
        sample_from_json(tree["sample"]),
        PlaceConfig.model_validate(tree["config"]),
        Session(**tree["session"]),
        tree["run"],
        frozenset(tree["limits"]),
    )
