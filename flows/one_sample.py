"""A single sample from a person's options, and its stages as they are shown while they run."""

from pathlib import Path

from rich.console import Console
from rich.status import Status
from rich.text import Text

from dcap.scene.types.sample import Sample, SourceOptions
from flows.given import height_of, place_of
from flows.options import PlaceOptions
from flows.sample_run import STAGE_NAMES
from tasks.runner.context import Event, StageEvent


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
        labels=options.labels,
        place=place_of(options.at, options.support),
        known_height=height_of(options.height_of, options.unit),
    )


def stage_line(event: StageEvent) -> str:
    """A finished stage in a line."""
    assert event.record is not None
    width = max(len(name) for name in STAGE_NAMES)
    took = "cached" if event.event is Event.CACHED else f"{event.record.seconds:.2f} s"
    return f"{event.stage:<{width}}  {took:>9}  {event.record.size / 1024:9.0f} KiB  {event.record.ref.kind}"
