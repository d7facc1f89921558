"""Who places the samples of a benchmark: threads of this program, a cluster of Dask or Ray, or Prefect's workers.

Each way yields results as they come, and nothing every second in which none has, so that progress is shown. Threads
hand heavy stages to processes of their own, and are the fastest way on one machine; the others are for many machines
that share a store (flows/elsewhere.py).
"""

import queue
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import Context
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from dcap.scene.errors import InputError, ServerGoneError
from dcap.scene.json_tree import JsonObject
from dcap.scene.types.sample import Sample
from flows.elsewhere import SampleJob, Told, place_job, told_of
from flows.own_requests import LOOPBACK

if TYPE_CHECKING:
    from prefect.futures import PrefectFuture
    from prefect.task_runners import TaskRunner

LOOK_SECONDS = 1.0
"""How often progress is shown while no sample ends."""


class RunnerName(StrEnum):
    """Who places samples."""

    LOCAL = "local"
    DASK = "dask"
    RAY = "ray"
    POOL = "pool"


@dataclass(frozen=True, slots=True)
class SampleRunner:
    """Who places the samples of a run."""

    name: RunnerName = RunnerName.LOCAL
    cluster: str = ""
    """Address of a cluster of Dask or Ray that is there; empty: one of this machine for the time of the run."""
    limits: Mapping[str, int] = field(default_factory=dict)
    """Most stages at a time on all machines of the server, by name of the limit."""

    def place(self, jobs: Sequence[SampleJob], workers: int, say: Callable[[str], None]) -> Iterator[Sequence[Told]]:
        """Samples as they end, placed by others than this program."""
        if self.name is RunnerName.POOL:
            return placed_by_workers(jobs, say)
        return placed_in_cluster(self.name, self.cluster, jobs, workers)


PACKAGES = {RunnerName.DASK: "prefect_dask", RunnerName.RAY: "prefect_ray"}
"""What must be installed."""


def check_runner(name: RunnerName, cluster: str, *, batch: bool) -> None:
    """InputError for a runner that cannot work here, before anything is computed."""
    package = PACKAGES.get(name)
    if package is not None and find_spec(package) is None:
        raise InputError(f"--runner {name} needs {package.replace('_', '-')}; pip install 'dcap[{name}]'")
    if cluster and package is None:
        raise InputError(f"--cluster {cluster} is for --runner dask or ray, not {name}")
    if batch and name is not RunnerName.LOCAL:
        raise InputError(f"--batch gathers the questions of one program; with --runner {name} there are many")


def placed_in_cluster(
    name: RunnerName, address: str, jobs: Sequence[SampleJob], workers: int
) -> Iterator[Sequence[Told]]:
    """Samples as they end, placed in a cluster that is there, or in one of `workers` processes for the time being."""
    from prefect import Task
    from prefect.cache_policies import NO_CACHE

    task: Task[..., JsonObject] = Task(place_job, name="place sample", cache_policy=NO_CACHE, persist_result=False)
    ended: queue.SimpleQueue[PrefectFuture[JsonObject]] = queue.SimpleQueue()
    with cluster_of(name, address, workers) as runner:
        left: dict[PrefectFuture[JsonObject], Sample] = {}
        for job in jobs:
            # outside of our flow run, whose body cannot be sent: the sample makes a child of it there
            future = Context().run(runner.submit, task, {"tree": job.to_json()})
            left[future] = job.sample
            future.add_done_callback(ended.put)
        while left:
            try:
                future = ended.get(timeout=LOOK_SECONDS)
            except queue.Empty:
                yield []
            else:
                yield [(left.pop(future), told_by(future))]


def told_by(future: "PrefectFuture[JsonObject]") -> JsonObject:
    """What a task told, or why it could not."""
    told: Any = future.result(raise_on_failure=False)
    if isinstance(told, ServerGoneError):  # nor will the others find it
        raise told
    if isinstance(told, BaseException):
        return told_of(f"its worker was lost: {' '.join(str(told).split()) or type(told).__name__}")
    assert isinstance(told, dict)
    return told


def cluster_of(name: RunnerName, address: str, workers: int) -> "TaskRunner[Any]":
    """Prefect's way to a cluster; a local one has no thread besides the worker's, and no page for others to see."""
    cluster: TaskRunner[Any]  # also where the extra is not installed, and its classes have no type
    if name is RunnerName.RAY:
        from prefect_ray import RayTaskRunner

        own: dict[str, object] = {
            "num_cpus": workers,
            "include_dashboard": False,
            "log_to_driver": False,
            "configure_logging": False,
        }
        cluster = RayTaskRunner(address=address) if address else RayTaskRunner(init_kwargs=own)
        return cluster
    from prefect_dask.task_runners import DaskTaskRunner

    own = {"n_workers": workers, "threads_per_worker": 1, "host": LOOPBACK, "dashboard_address": None}
    cluster = DaskTaskRunner(address=address) if address else DaskTaskRunner(cluster_kwargs=own)
    return cluster


def placed_by_workers(jobs: Sequence[SampleJob], say: Callable[[str], None]) -> Iterator[Sequence[Told]]:
    """Samples as they end, placed by whoever serves the work pool of this server."""
    from flows.work_pool import WorkPool

    pool = WorkPool()
    if not pool.served():
        say("no worker serves the pool yet; one that is starting is waited for, else start one: dcap worker")
    yield from pool.placed(jobs, LOOK_SECONDS)
