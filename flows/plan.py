"""Plan of a benchmark, sample by sample and stage by stage, with reasons; nothing is run."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from dcap.evaluation.methods import DCAP
from dcap.scene.errors import MachineError
from flows.benchmark import measured_config
from flows.display import console_on
from flows.place import PlaceConfig
from flows.sample_run import Plan, StagePlan, plan_sample
from flows.selection import Selection, dataset_samples


@dataclass(frozen=True, slots=True)
class PlanRow:
    """Plan for one sample."""

    sample: str
    cached: tuple[str, ...]
    """Stages whose results are cached."""
    runs: str | None
    """First stage that would run; None if none would."""
    why: str | None
    """Why it would run, or the sample's error; None if everything is cached."""
    may_run: tuple[str, ...]
    """Stages that run too, or run if what they depend on changes."""
    stages: tuple[StagePlan, ...]
    """Every stage that can be foreseen."""


def plan_benchmark(
    dataset: Path | None,
    config: PlaceConfig,
    *,
    limit: int | None = None,
    methods: Sequence[str] = (DCAP,),
    scenes: str = "",
    stages: bool = False,
    to_stderr: bool = False,
) -> list[PlanRow]:
    """Print what would run and why, on standard output or error, with a line for each stage if `stages`."""
    _, samples = dataset_samples(dataset, methods, Selection(limit=limit, scenes=scenes))
    config = measured_config(config, methods)
    plans = [plan_sample(sample, config, bring=False) for sample in samples]
    failed = [plan.failed.error for plan in plans if plan.failed]
    if len(failed) == len(plans) and all(isinstance(one, OSError | MachineError) for one in failed):
        raise failed[0]  # a full disk or missing permissions, not an error of one sample
    print_plan(plans, stages=stages, to_stderr=to_stderr)
    return [plan_row(plan) for plan in plans]


def plan_row(plan: Plan) -> PlanRow:
    """Return the row of a sample."""
    names = [one.stage for one in plan.missing]
    return PlanRow(
        plan.sample.id, plan.cached, names[0] if names else None, plan.why or None, tuple(names[1:]), plan.stages
    )


def print_plan(plans: Sequence[Plan], *, stages: bool = False, to_stderr: bool = False) -> None:
    """Print the plans of the samples, perhaps of their stages, and a line of totals."""
    console = console_on(sys.stderr if to_stderr else sys.stdout)
    table = Table("sample", "cached", "would run", "why", box=None)
    for plan in plans:
        count = "all" if plan.finished else "-" if plan.failed else f"{len(plan.cached)} of {len(plan.stages)}"
        table.add_row(plan.sample.id, count, plan.missing[0].stage if plan.missing else "-", plan.why)
        for one in plan.stages if stages else ():
            table.add_row("", "", f"{one.state.replace('_', ' ')} {one.stage}", one.why or "")
    console.print(table)
    console.print(f"{sum(plan.finished is not None for plan in plans)} of {len(plans)} samples are cached")
