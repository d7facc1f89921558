"""What workers run: the entry points of the deployments in prefect.yaml. Imports Prefect.

Parameters are plain values with defaults, because Prefect's pages make a form of them. A worker has its place of data,
store and server from its own environment and `dcap.yaml`.
"""

import math
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any
from uuid import UUID

import httpx
from prefect import flow
from prefect.client.orchestration import get_client
from prefect.client.schemas.objects import State
from prefect.exceptions import ObjectNotFound
from prefect.runtime import flow_run
from prefect.states import Completed, Crashed, Failed
from pydantic import Field

from dcap.cores import available_cores
from dcap.evaluation.methods import methods_of
from dcap.scene.errors import DcapError
from dcap.scene.machine_errors import as_machine_errors
from flows.benchmark import rerun_sample, run_benchmark
from flows.benchmark_config import benchmark_config, runner_of
from flows.configure import with_threads
from flows.display import summary_line
from flows.elsewhere import SampleJob, placed
from flows.find_run import find_run
from flows.flow_runs import NOBODY_WAITS, PROGRAM
from flows.lost_server import server_errors_passed, server_lost
from flows.output import result_line
from flows.programs import Program
from flows.run_names import benchmark_tags, shown
from flows.sample_flow import MOST_BEGINNINGS, ending_of
from flows.sample_pictures import show_pictures
from flows.sample_run import FailedSample, FinishedSample
from flows.server_wait import wait_for_server
from flows.settings.own import run_settings
from flows.work_pool import WORKER, worker_tag


@flow(name="place", persist_result=False, validate_parameters=False)
def place_sample(job: dict[str, Any]) -> State[Any]:
    """Place the sample of a job (flows/elsewhere.py) and leave its results in the store."""
    mine = SampleJob.from_json(job)
    if not mine.config.drop.threads:
        mine = replace(mine, config=with_threads(mine.config, available_cores()))
    for _ in range(MOST_BEGINNINGS):
        result = placed_for(mine)
        # a worker has nothing better to do than to wait; it could not tell how this ends, either
        wait_for_server(math.inf)
        if not (isinstance(result, FailedSample) and server_lost(result.error)):
            break
    if result is None:
        return Crashed(message=NOBODY_WAITS)
    if isinstance(result, FailedSample):
        return Failed(message=result.message)
    assert flow_run.id
    show_pictures(result.placement, UUID(flow_run.id))
    name, why = ending_of(result.placement)
    return Completed(name=name, message=why or None)


def placed_for(job: SampleJob) -> FinishedSample | FailedSample | None:
    """The sample of a job, placed in this flow run; None if nobody waits for it."""
    try:
        told_where()
        if job.run.id is not None and is_left(job.run.id):
            return None
    except (httpx.HTTPError, RuntimeError) as error:
        return FailedSample(job.sample, error)
    return placed(job, in_own_run=False)


def is_left(benchmark: UUID) -> bool:
    """Whether a benchmark has surely ended, by what its flow run says or because its program is gone."""
    with get_client(sync_client=True) as client, suppress(ObjectNotFound):
        asked = client.read_flow_run(benchmark)
        if asked.state is not None and asked.state.is_final():
            return True
        program = Program.from_json(asked.context.get(PROGRAM))
        return program is not None and program.is_gone
    return True  # somebody has deleted it


def told_where() -> None:
    """Say in this flow run which worker has it, so that one that is lost with its worker is found."""
    if name := os.environ.get(WORKER):
        add_tags(worker_tag(name))


def add_tags(*tags: str) -> None:
    """Tag this flow run."""
    if flow_run.id:
        with get_client(sync_client=True) as client:
            known = client.read_flow_run(UUID(flow_run.id)).tags
            client.update_flow_run(flow_run.id, tags=list(dict.fromkeys([*known, *tags])))


def benchmark_name() -> str:
    """Name of a flow run of a benchmark on a worker: what it is asked to place."""
    return shown(f"benchmark of {flow_run.parameters.get('dataset') or 'the embedded rooms'}")


def rerun_name() -> str:
    """Name of a flow run of a rerun: run, sample and stage."""
    return shown(" / ".join(("rerun", *(str(flow_run.parameters.get(name)) for name in ("run", "sample", "stage")))))


@flow(name="benchmark on a worker", flow_run_name=benchmark_name, persist_result=False)
def benchmark(
    dataset: str = "",
    methods: str = "",
    scenes: str = "",
    limit: Annotated[int, Field(ge=1)] | None = None,
    workers: Annotated[int, Field(ge=1, le=64)] | None = None,
    only_failed: bool = False,
) -> State[Any]:
    """Place the samples of a data set (a path of the worker's machine; empty: the embedded rooms) and write the run's
    folder there. What is left empty is as the worker's `dcap.yaml` says."""

    def work() -> State[Any]:
        told = {"methods": methods or None, "workers": workers, "runner": "local", "cluster": ""}  # on this worker
        asked = run_settings({name: one for name, one in told.items() if one is not None})
        config, language = benchmark_config({}, asked)
        run = run_benchmark(
            Path(dataset) if dataset else None,
            config,
            language,
            limit=limit,
            workers=asked.workers,
            only_failed=only_failed,
            methods=methods_of(asked.methods),
            scenes=scenes,
            runner=runner_of(asked),
        )
        with server_errors_passed():  # the run is there, whether it is found by them
            add_tags(*benchmark_tags(run.folder.name, methods_of(asked.methods)))
        line = f"{run.folder.name}: {summary_line(run.summary)}"
        return Failed(message=line) if run.failed else Completed(message=line)

    return state_of(work)


@flow(name="rerun", flow_run_name=rerun_name, persist_result=False)
def rerun(run: str = "last", sample: str = "", stage: str = "drop") -> State[Any]:
    """Compute a stage of a sample of a run again; later stages follow where their inputs changed."""

    def work() -> State[Any]:
        add_tags(*benchmark_tags(find_run(run).name, ()))
        tree, page = rerun_sample(run, sample, stage)
        return Completed(message=f"{result_line(tree)}; report: {page}")

    return state_of(work)


def state_of(work: Callable[[], State[Any]]) -> State[Any]:
    """What it comes to; what a person or the machine can mend is a line in the state, as it is in a terminal."""
    try:
        with as_machine_errors():
            return work()
    except DcapError as error:
        return Failed(message=str(error))
