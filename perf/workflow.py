"""What the workflow itself costs: of a flow run and of a stage in it, computed, cached and looked up, without its work.

Stages that do next to nothing are run as those of samples are: as children of one flow run, against a server of their
own. What a stage costs is the slope over the number of stages, what a flow run costs is the rest.
"""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from statistics import median
from uuid import UUID

from rich.table import Table

from dcap.scene.store.ref import Ref
from dcap.scene.types.materials import Material
from flows.server import prefect_server
from tasks.runner.context import RunContext, use_context
from tasks.runner.stage import stage

STAGES = 9
"""As a placement has."""
REPEATS = 5
SEEDS = count()


def made(seed: int) -> Material:
    """A small value."""
    return Material(f"made {seed}", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "a number")


def passed(material: Material, step: int) -> Material:
    """Another one like it."""
    return Material(f"{material.id} {step}", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "a number")


made_task, passed_task = stage(made), stage(passed)


def chain(seed: int, stages: int) -> Ref[Material]:
    """So many stages, each with what the one before it returned."""
    ref: Ref[Material] = made_task(seed)
    for step in range(stages - 1):
        ref = passed_task(ref, step)
    return ref


@contextmanager
def place_of_its_own() -> Iterator[None]:
    """A data folder that is gone afterwards, with a server."""
    before = os.environ.get("DCAP_DATA")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["DCAP_DATA"] = str(Path(folder))
        try:
            with prefect_server():
                yield
        finally:
            os.environ.pop("DCAP_DATA")
            if before is not None:
                os.environ["DCAP_DATA"] = before


def seconds(action: Callable[[], object]) -> float:
    """How long it takes [s]."""
    begin = time.perf_counter()
    action()
    return time.perf_counter() - begin


def children_seconds(parent: UUID) -> dict[str, tuple[float, float]]:
    """Seconds of a flow run with one stage and with all of them, computed and cached; medians of a few."""
    from flows.flow_runs import FlowRunNames, flow_run

    def child(seed: int, stages: int) -> float:
        begin = time.perf_counter()
        with flow_run(FlowRunNames("chain", f"{stages} stages", (), {}), parent):
            chain(seed, stages)
        return time.perf_counter() - begin

    def few(stages: int) -> tuple[float, float]:
        seeds = [next(SEEDS) for _ in range(REPEATS)]
        return median(child(seed, stages) for seed in seeds), median(child(seed, stages) for seed in seeds)

    few(1)  # what is loaded on first use
    one, all_of_them = few(1), few(STAGES)
    return {"computed": (one[0], all_of_them[0]), "cached": (one[1], all_of_them[1])}


def looked_up_seconds(seed: int) -> float:
    """Looking all stages up that have run, without a flow run [s]."""
    with use_context(RunContext(lookup_only=True)):
        return median(seconds(lambda: chain(seed, STAGES)) for _ in range(REPEATS))


def table() -> Table:
    """Costs by how a stage ends."""
    from flows.flow_runs import FlowRunNames, flow_run

    shown = Table("the workflow itself", "flow run", "stage", box=None)
    with place_of_its_own():
        with flow_run(FlowRunNames("benchmark", "perf", (), {})) as engine:
            assert engine.flow_run is not None
            found = children_seconds(engine.flow_run.id)
        for how, (one, all_of_them) in found.items():
            each = (all_of_them - one) / (STAGES - 1)
            shown.add_row(how, f"{one - each:.2f} s", f"{1e3 * each:.0f} ms")
        shown.add_row("looked up", "", f"{1e3 * looked_up_seconds(next(SEEDS) - 1) / STAGES:.0f} ms")
    return shown
