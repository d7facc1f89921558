"""Runners of the samples of a benchmark: threads of this program, a cluster of Dask or Ray, or workers of a pool.

Threads hand heavy stages to processes of their own, and are the fastest way on one machine; the others are for many
machines that share a store. Imports Prefect when called.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from dcap.scene.errors import InputError
from flows.own_requests import LOOPBACK

if TYPE_CHECKING:
    from prefect import Task
    from prefect.task_runners import TaskRunner


class RunnerName(StrEnum):
    """Names of the runners."""

    LOCAL = "local"
    DASK = "dask"
    RAY = "ray"
    POOL = "pool"


@dataclass(frozen=True, slots=True)
class SampleRunner:
    """Runner of the samples of a run."""

    name: RunnerName = RunnerName.LOCAL
    cluster: str = ""
    """Address of a running cluster of Dask or Ray; empty: a local one for the duration of the run."""
    limits: Mapping[str, int] = field(default_factory=dict)
    """Most stages at a time on all machines of the server, by name of the limit."""

    def task(self) -> "Task[..., Any]":
        """Return the task that places a sample."""
        if self.name is RunnerName.POOL:
            from flows.pool import place_in_pool, register

            register()  # its samples wait there for the first worker
            return place_in_pool
        from flows.watched import place_sample

        return place_sample

    def task_runner(self, at_a_time: int) -> "TaskRunner[Any]":
        """Return Prefect's runner of these tasks."""
        runner: TaskRunner[Any]  # also if an extra is not installed, and its classes have no type
        if self.name is RunnerName.RAY:
            from prefect_ray import RayTaskRunner

            own = {"num_cpus": at_a_time, "include_dashboard": False, "log_to_driver": False}
            runner = RayTaskRunner(address=self.cluster) if self.cluster else RayTaskRunner(init_kwargs=own)
        elif self.name is RunnerName.DASK:
            import dask
            from prefect_dask.task_runners import DaskTaskRunner

            dask.config.set({"distributed.worker.daemon": False})  # stages start processes of their own
            local = {"n_workers": at_a_time, "threads_per_worker": 1, "host": LOOPBACK, "dashboard_address": None}
            runner = DaskTaskRunner(address=self.cluster) if self.cluster else DaskTaskRunner(cluster_kwargs=local)
        else:
            from prefect.task_runners import ThreadPoolTaskRunner

            runner = ThreadPoolTaskRunner(max_workers=at_a_time)
        return runner


RUNNER_PACKAGES = {RunnerName.DASK: "prefect_dask", RunnerName.RAY: "prefect_ray"}
"""Package that each runner needs."""


def check_runner(name: RunnerName, cluster: str, *, batch: bool) -> None:
    """Raise InputError for a runner that cannot work here, before anything is computed."""
    package = RUNNER_PACKAGES.get(name)
    if package is not None and find_spec(package) is None:
        raise InputError(f"--runner {name} needs {package.replace('_', '-')}; pip install 'dcap[{name}]'")
    if cluster and package is None:
        raise InputError(f"--cluster {cluster} is for --runner dask or ray, not {name}")
    if batch and name is not RunnerName.LOCAL:
        raise InputError(f"--batch gathers the questions of one program; with --runner {name} there are many")
