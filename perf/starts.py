"""How long it takes from the request for a stage's process to the first line of the stage's own code."""

import importlib
import time
from pathlib import Path
from statistics import median

from rich.table import Table

from dcap.scene.errors import InputError
from dcap.scene.types.outcome import Infeasible
from tasks.runner.process import run_in_process
from tasks.runner.process_server import FORK_SERVER, ProcessServer, process_server, start_method

REPEATS = 5
STAGES = ("drop", "mesh", "segment", "rotation", "particles", "render")
"""Those with processes of their own (mesh where there are only splats), and others for comparison."""


def first_line(module: str) -> Infeasible:
    """A stage that needs a stage's module and does nothing but say when it began."""
    importlib.import_module(module)
    raise InputError(str(time.monotonic()))


def start_seconds(stage: str, server: ProcessServer | None) -> float:
    """From request to first line [s]."""
    module = f"tasks.{stage}.stage"
    job = {"module": __name__, "function": first_line.__name__, "inputs": {"module": {"value": module}}}
    begin = time.monotonic()
    try:
        run_in_process(job | {"config": None, "session": {}}, lambda part, text: None, server)
    except InputError as error:
        return float(str(error)) - begin
    raise AssertionError("the stage says when it began")


def best_and_median(stage: str, server: ProcessServer | None) -> list[str]:
    """Of a few starts."""
    seconds = [start_seconds(stage, server) for _ in range(REPEATS)]
    return [f"{number:.3f} s" for number in (min(seconds), median(seconds))]


def table() -> Table:
    """Best and median of a few starts of every stage, spawned and, where processes are, forked, and what the server
    holds."""
    columns = ["spawned", "median"] + ["forked", "median", "server"] * (start_method() == FORK_SERVER)
    shown = Table("start of a stage's process", *columns, box=None)
    for stage in STAGES:
        forked: list[str] = []
        with process_server([__name__, f"tasks.{stage}.stage"]) as server:
            if server is not None:
                start_seconds(stage, server)  # the server has loaded once this has begun
                forked = [*best_and_median(stage, server), f"{proportional_memory(server.pid) / 2**20:.0f} MiB"]
        shown.add_row(stage, *best_and_median(stage, None), *forked)
    return shown


def proportional_memory(pid: int) -> int:
    """Resident memory of a process, pages that it shares counted in parts [bytes]."""
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("Pss:")) * 1024
