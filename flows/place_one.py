"""One placement for a person: says what is cached, starts a server only if something must run, shows the stages."""

import sys
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.status import Status
from rich.text import Text

from dcap.language.model.ledger import in_words, spending_of
from dcap.scene.json_tree import JsonObject
from dcap.scene.types.sample import Sample, SourceOptions
from flows.configure import configured
from flows.language_options import language_options
from flows.options import PlaceOptions
from flows.output import write_placement
from flows.sample_run import STAGE_NAMES, FinishedSample, heavy_modules, place_flow, plan_sample, recorded
from flows.server import prefect_server
from tasks.arch import chosen_arch
from tasks.runner.context import Event, RunContext, StageEvent
from tasks.runner.process_server import process_server


def place_files(scene: str, thing: str, prompt: str, options: PlaceOptions, out: Path, *, quiet: bool) -> JsonObject:
    """Place the object of one file in the scene of another; writes the results into `out`, returns placement.json.

    Stage lines go to standard error unless `quiet`.
    """
    sample = sample_of(scene, thing, prompt, options)
    asking = language_options(options)
    config = configured(options, language=asking.config(), arch=chosen_arch(options.arch))
    session = asking.session(out)
    if session.ledger:  # of an earlier placement into the same folder
        Path(session.ledger).unlink(missing_ok=True)
    console = Console(file=sys.stderr, quiet=quiet, highlight=False, force_jupyter=False)
    plan = plan_sample(sample, config)
    if plan.failed is not None:
        raise plan.failed.error
    if plan.finished is not None:
        console.print(f"all {len(plan.cached)} stages cached")
        return write_placement(plan.finished, out)
    with (
        console.status("starting") as status,
        prefect_server(),
        process_server(heavy_modules(plan.coming)) as server,
        recorded(sample, RunContext(session=session, server=server), partial(show, console, status)) as recorder,
    ):
        placement = place_flow(sample)(sample, config)
    if session.ledger and Path(session.ledger).is_file():
        console.print(in_words(spending_of(Path(session.ledger))))
    return write_placement(FinishedSample(sample, placement, tuple(recorder.records)), out)


def show(console: Console, status: Status, event: StageEvent) -> None:
    """Show what happens to a stage: a line that changes while it works, a line that stays when it has finished."""
    if event.event is Event.STARTED:
        status.update(event.stage)
    elif event.event is Event.PROGRESS:
        status.update(Text(f"{event.stage} {event.part:4.0%} {event.text}"))
    else:
        console.print(stage_line(event))


def sample_of(scene: str, thing: str, prompt: str, options: PlaceOptions) -> Sample:
    """What is placed where, as the stages take it."""
    return Sample(
        id=f"{Path(thing).stem} in {Path(scene).name}",
        scene=scene,
        object=thing,
        prompt=prompt,
        scene_options=SourceOptions(options.up, options.unit, options.label),
        object_options=SourceOptions(options.object_up, options.object_unit, options.object_label),
        mass=options.mass,
        seed=options.seed,
    )


def stage_line(event: StageEvent) -> str:
    """A finished stage in a line."""
    assert event.record is not None
    width = max(len(name) for name in STAGE_NAMES)
    took = "cached" if event.event is Event.CACHED else f"{event.record.seconds:.2f} s"
    return f"{event.stage:<{width}}  {took:>9}  {event.record.size / 1024:9.0f} KiB  {event.record.ref.kind}"
