"""Entry points of the deployments in prefect.yaml; samples have one of their own (pool.py). Imports Prefect.

Parameters are plain values with defaults, because Prefect's pages make a form of them. A worker has its place of data,
store and server from its own environment and `dcap.yaml`.
"""

from collections.abc import Callable
from typing import Annotated, Any

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed
from pydantic import Field

from dcap.scene.errors import DcapError
from dcap.scene.machine_errors import as_machine_errors
from flows.benchmark import rerun_sample
from flows.benchmark_config import place_dataset
from flows.display import summary_line
from flows.options import BenchmarkOptions
from flows.output import result_line
from flows.settings.effective import effective_options


@flow(name="benchmark on a worker", persist_result=False)
def benchmark(
    dataset: str = "",
    methods: str = "",
    scenes: str = "",
    limit: Annotated[int, Field(ge=1)] | None = None,
    workers: Annotated[int, Field(ge=1, le=64)] | None = None,
    only_failed: bool = False,
) -> State[Any]:
    """Place the samples of a data set (a path of the worker's machine; empty: the embedded rooms) and write the run's
    folder there. Empty parameters are read from the worker's `dcap.yaml`."""

    def work() -> State[Any]:
        asked: dict[str, object] = {
            "dataset": dataset, "methods": methods, "scenes": scenes, "limit": limit, "workers": workers,
            "only_failed": only_failed,
        }  # fmt: skip
        flags = {name: value for name, value in asked.items() if value}
        here: dict[str, object] = {"runner": "local", "cluster": ""}  # on this worker
        run = place_dataset(effective_options(BenchmarkOptions, flags | here))
        line = f"{run.folder.name}: {summary_line(run.summary)}"
        return Failed(message=line) if run.failed else Completed(message=line)

    return state_of(work)


@flow(name="rerun", persist_result=False)
def rerun(run: str = "last", sample: str = "", stage: str = "drop") -> State[Any]:
    """Compute a stage of a sample of a run again; later stages follow where their inputs changed."""

    def work() -> State[Any]:
        tree, page = rerun_sample(run, sample, stage)
        return Completed(message=f"{result_line(tree)}; report: {page}")

    return state_of(work)


def state_of(work: Callable[[], State[Any]]) -> State[Any]:
    """Do some work and return its final state; an error that a user can fix is one line in the state, as in a
    terminal."""
    try:
        with as_machine_errors():
            return work()
    except DcapError as error:
        return Failed(message=str(error))
