"""Overhead of the workflow: time of a stage that does almost nothing, by mode of running.

A chain of stages is run without Prefect, and in a flow run against a server of its own.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from statistics import median

from rich.table import Table

from dcap.scene.types.materials import Material
from flows.server import prefect_server
from tasks.artifact import Ref
from tasks.cache import stage
from tasks.run_context import Mode, RunContext, use_context

STAGES, REPEATS = 18, 5
"""Number of stages, as in a measured placement; and number of runs for the median."""


def made(seed: int) -> Material:
    """A small value."""
    return Material(f"made {seed}", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "a number")


def passed(material: Material, step: int) -> Material:
    """Another one like it."""
    return Material(f"{material.id} {step}", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "a number")


made_task, passed_task = stage(made), stage(passed)


def chain(seed: int) -> None:
    """Run the stages, each with the result of the one before."""
    ref: Ref[Material] = made_task(seed)
    for step in range(STAGES - 1):
        ref = passed_task(ref, step)


def chain_seconds(seeds: Iterator[int]) -> tuple[float, float]:
    """Return the time of a stage that is computed, and of one that is cached: medians [s]."""
    some = [next(seeds) for _ in range(REPEATS)]
    computed = median(seconds(lambda seed=seed: chain(seed)) for seed in some)  # type: ignore[misc]
    return computed / STAGES, median(seconds(lambda seed=seed: chain(seed)) for seed in some) / STAGES  # type: ignore[misc]


def seconds(action: Callable[[], object]) -> float:
    """Return the duration of an action [s]."""
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


@contextmanager
def own_data_folder() -> Iterator[None]:
    """Use a temporary data folder."""
    before = os.environ.get("DCAP_DATA")
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        os.environ["DCAP_DATA"] = folder
        try:
            yield
        finally:
            os.environ.pop("DCAP_DATA")
            if before is not None:
                os.environ["DCAP_DATA"] = before


def table() -> Table:
    """Return the costs of a stage by mode of running."""
    shown = Table("the workflow itself, a stage", "computed", "cached", box=None)
    seeds, found = count(), dict[str, tuple[float, float]]()
    with own_data_folder():
        chain(next(seeds))  # load everything that is loaded on first use
        found["without Prefect"] = chain_seconds(seeds)
        with prefect_server():
            from prefect import flow

            @flow(name="chain", persist_result=False)
            def watched() -> None:
                with use_context(RunContext(Mode.WATCHED)):
                    chain(next(seeds))
                    found["in a flow run"] = chain_seconds(seeds)

            watched()
    for how, (computed, cached) in found.items():
        shown.add_row(how, f"{1e3 * computed:.1f} ms", f"{1e3 * cached:.1f} ms")
    return shown
