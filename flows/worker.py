"""A worker of the pool: Prefect's own with a server; and the entry points of the deployments.

The kernel kills Prefect's worker with this program, and the worker's samples with it.

Samples have a deployment of their own (pool.py).

Parameters are plain values with defaults, because Prefect's pages make a form of them. A worker has its place of data,
store and server from its own environment and `dcap.yaml`.
"""

import os
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from secrets import token_hex
from typing import Annotated, Any

from prefect import flow
from prefect.client.schemas.objects import State
from prefect.states import Completed, Failed
from pydantic import Field

from dcap.cores import SHARE, available_cores
from dcap.scene.errors import DcapError
from dcap.scene.settings import data_root, shared_store_url
from flows.benchmark import rerun_sample
from flows.benchmark_config import place_dataset
from flows.display import summary_line
from flows.given_settings import FILE_VARIABLE, settings_file
from flows.options import BenchmarkOptions
from flows.output import result_line
from flows.server import pages_of, prefect_server
from flows.settings import effective_options
from tasks.machine_errors import as_machine_errors
from tasks.process import die_with_parent

HEARTBEAT_SECONDS = 10
STOP_SECONDS = 10.0


def serve_pool(at_a_time: int, announce: Callable[[str], None]) -> None:
    """Serve the pool until interrupted; `announce` is called with a line when the worker starts."""
    with prefect_server() as url, tempfile.TemporaryDirectory(prefix="dcap-worker-") as folder:
        from flows.pool import POOL, WORKER, register

        register()
        name = f"{platform.node()}-{os.getpid()}-{token_hex(3)}"  # restarted containers share name and number
        environment = (
            os.environ
            | whole_places()
            | {
                SHARE: str(max(1, available_cores() // at_a_time)),
                WORKER: name,
                "PYTHONSAFEPATH": "1",  # its processes import nothing from the working directory
                "PREFECT_WORKER_HEARTBEAT_SECONDS": str(HEARTBEAT_SECONDS),
            }
        )
        words = ("worker", "start", "--pool", POOL, "--type", "process", "--name", name, "--limit", str(at_a_time))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "prefect", *words], env=environment, cwd=folder, preexec_fn=die_with_parent
        )
        announce(f"worker {name} of the pool {POOL!r}, server {pages_of(url)}, {at_a_time} at a time")
        try:
            status = process.wait()
        finally:
            process.terminate()
            try:
                process.wait(STOP_SECONDS)
            except subprocess.TimeoutExpired:
                process.kill()
    raise DcapError(f"Prefect's worker ended with status {status}; see its output above")


def whole_places() -> dict[str, str]:
    """Return environment variables with absolute paths of the folders that a worker shares with this program."""
    store, given = shared_store_url(), settings_file()
    places = {"DCAP_DATA": str(data_root())}
    if store:
        places["DCAP_STORE"] = store if "://" in store else str(Path(store).resolve())
    if given is not None:
        places[FILE_VARIABLE] = str(given)
    return places


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
