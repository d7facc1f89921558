"""Costs of a run of a data set, their growth during the run, and a forecast for a larger one.

python -m perf.scale RUN [--scenes 186 --prompts 5 --cores 2,16,128 --main SECONDS --busy SHARE]

RUN is a run whose stages were computed for it (`dcap benchmark` on an empty store, any methods). A stage counts once
for all placements that share it: one time to the millisecond in placements of one scene, object or sample is one
computation. The cost of a larger data set is the mean of each stage, for each scene, object or placement, times their
number; on C cores with a worker each the time is the cost over C, and over the share of time in which a worker of RUN
was in a stage. The placing program prepares and writes the stages' results; with `--main`, its processor time for a
placement, the time for this program alone is printed too, a lower bound for any number of workers.
"""

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, median

import numpy as np
from rich.console import Console
from rich.table import Table

from dcap.evaluation.methods import split_id
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.run_page.sections import Timings, timings_of
from dcap.scene.errors import InputError
from flows.find_run import RUN, find_run

PER_SCENE = frozenset({"mesh_scene", "surface_scene", "segment"})
PER_OBJECT = frozenset({"mesh_object", "surface_object", "segment_object"})
"""Stages shared by all placements in a scene, and of an object; each other stage belongs to one placement."""
PARTS = 4
"""Number of consecutive parts of a run."""
HOUR = 3600.0


@dataclass(frozen=True, slots=True)
class TimedPlacement:
    """Times of a placement."""

    method: str
    scene: str
    thing: str
    sample: str
    timings: Timings

    def owner(self, stage: str) -> tuple[str, str]:
        """Owner of a stage: the scene, object or placement that shares it."""
        if stage in PER_SCENE:
            return "scene", self.scene
        return ("object", self.thing) if stage in PER_OBJECT else ("placement", self.sample)


@dataclass(frozen=True, slots=True)
class Computed:
    """A stage that was computed, for the first placement that needed it."""

    stage: str
    kind: str
    method: str
    seconds: float
    part: int
    """Part of the run, by the order of its samples."""


@dataclass(frozen=True, slots=True)
class Cost:
    """Mean seconds of all stages of one scene, one object, and one placement by each method."""

    scene: float
    thing: float
    placement: Mapping[str, float]
    busy: float
    """Share of a worker's time spent in stages [-]."""

    def seconds(self, scenes: int, objects: int, prompts: int) -> float:
        """Seconds of one core for `scenes` scenes with `prompts` prompts each, by every method."""
        return scenes * (self.scene + prompts * sum(self.placement.values())) + objects * self.thing


def placements(folder: Path) -> list[TimedPlacement]:
    """Placements of a run that have times, in its order."""
    found = []
    for sample in json.loads((folder / RUN).read_bytes())["samples"]:
        path = sample_folder(folder, sample["id"]) / "placement.json"
        timings = timings_of(json.loads(path.read_bytes())) if path.is_file() else {}
        if timings:
            method, name = split_id(sample["id"])
            found.append(TimedPlacement(method, sample["scene"], sample["object"], name, timings))
    if not found:
        raise InputError(f"{folder}: no placement has times; give a run of `dcap benchmark`")
    return found


def computed(found: Sequence[TimedPlacement]) -> Iterator[Computed]:
    """Every stage once, with the part of the run that needed it first."""
    order = {sample: place for place, sample in enumerate(dict.fromkeys(one.sample for one in found))}
    seen = set()
    for one in found:
        part = order[one.sample] * PARTS // len(order)
        for stage, seconds in one.timings.items():
            kind, name = one.owner(stage)
            key = kind, name, stage, round(seconds, 3)
            if key not in seen:
                seen.add(key)
                yield Computed(stage, kind, one.method, seconds, part)


def cost_of(found: Sequence[TimedPlacement], stages: Sequence[Computed], busy: float) -> Cost:
    """Means over the scenes, objects and placements of a run."""
    total: dict[tuple[str, str], float] = defaultdict(float)
    for one in stages:
        total[one.kind, one.method if one.kind == "placement" else ""] += one.seconds
    methods = dict.fromkeys(one.method for one in found)
    return Cost(
        total["scene", ""] / len({one.scene for one in found}),
        total["object", ""] / len({one.thing for one in found}),
        {name: total["placement", name] / sum(one.method == name for one in found) for name in methods},
        busy,
    )


def busy_share(folder: Path, stages: Sequence[Computed], workers: int) -> float:
    """Share of the workers' time in a run that was spent in stages [-]; InputError if some of it was another run's."""
    path = folder / "summary.json"
    if not path.is_file():
        raise InputError(f"{path} is not there: the run has not ended")
    wall = float(json.loads(path.read_bytes())["wall_s"])
    share = sum(one.seconds for one in stages) / (workers * wall)
    if share > 1.0:
        raise InputError(
            f"{folder}: {share:.2f} times as many seconds of stages as {workers} workers have in {wall:.0f} s; "
            "give a run that computed all of them, and its --workers; or --busy"
        )
    return share


def stage_table(stages: Sequence[Computed]) -> Table:
    """Seconds of every stage, the costliest first, and their mean in each part of the run."""
    by_stage: dict[str, list[Computed]] = defaultdict(list)
    for one in stages:
        by_stage[one.stage].append(one)
    shown = Table("stage", "n", "median s", "mean s", "95 %", "most", "in all s",
                  *(f"part {part + 1}" for part in range(PARTS)), box=None)  # fmt: skip
    for stage, own in sorted(by_stage.items(), key=lambda item: -sum(one.seconds for one in item[1])):
        seconds = [one.seconds for one in own]
        parts = [[one.seconds for one in own if one.part == part] for part in range(PARTS)]
        shown.add_row(
            stage, str(len(own)), f"{median(seconds):.2f}", f"{mean(seconds):.2f}",
            f"{np.quantile(seconds, 0.95):.2f}", f"{max(seconds):.1f}", f"{sum(seconds):.0f}",
            *(f"{mean(part):.2f}" if part else "-" for part in parts),
        )  # fmt: skip
    return shown


def forecast_table(cost: Cost, scenes: int, objects: int, prompts: int, cores: Sequence[int], main: float) -> Table:
    """Hours of a data set on so many cores, with a worker on each."""
    total, count = cost.seconds(scenes, objects, prompts), scenes * prompts * len(cost.placement)
    shown = Table(f"{count} placements", "hours", *(["not less by one program"] if main else []), box=None)
    for number in cores:
        alone = [f"{main * count / HOUR:.1f}"] if main else []
        shown.add_row(f"{number} cores", f"{total / cost.busy / number / HOUR:.1f}", *alone)
    return shown


def main() -> None:
    """Read a run and print."""
    about = argparse.ArgumentParser(
        prog="python -m perf.scale", description="Costs of a run, and a forecast for a larger one."
    )
    about.add_argument("run", help="name or folder of a run, or 'last'")
    about.add_argument("--workers", type=int, default=2, help="number of workers of the run")
    about.add_argument(
        "--busy", type=float, help="share of a worker's time in stages, for a run that found some cached"
    )
    about.add_argument("--scenes", type=int, default=186)
    about.add_argument("--prompts", type=int, default=5, help="of each scene")
    about.add_argument("--cores", default="2,16,128", help="between commas")
    about.add_argument("--main", type=float, default=0.0, help="processor time of the main program per placement [s]")
    asked = about.parse_args()
    console = Console(highlight=False, width=140)
    try:
        folder = find_run(asked.run)
        found = placements(folder)
        stages = list(computed(found))
        cost = cost_of(found, stages, asked.busy or busy_share(folder, stages, asked.workers))
    except InputError as error:
        raise SystemExit(f"perf.scale: {error}") from error
    console.print(stage_table(stages))
    each = ", ".join(f"{name} {seconds:.1f}" for name, seconds in cost.placement.items())
    console.print(
        f"seconds of a core: a scene {cost.scene:.1f}, an object {cost.thing:.1f}, a placement: {each} (what methods "
        f"share counts for the first); workers are in stages {cost.busy:.0%} of the time"
    )
    objects = len({one.thing for one in found})
    cores = [int(number) for number in asked.cores.split(",")]
    console.print(forecast_table(cost, asked.scenes, objects, asked.prompts, cores, asked.main))


if __name__ == "__main__":
    main()
