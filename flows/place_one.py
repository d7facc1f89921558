"""One placement for a person: says what is cached, starts a server only if something must run, shows the stages."""

import sys
from pathlib import Path

from rich.console import Console
from rich.text import Text

from dcap.language.model.ledger import in_words, totals
from dcap.language.protocol.session import Session
from dcap.scene.types.sample import Sample
from flows.place import PlaceConfig
from flows.sample_run import STAGE_NAMES, FinishedSample, plan_sample, run_sample
from flows.server import prefect_server
from tasks.runner.context import Event, RunContext, StageEvent


def place_one(sample: Sample, config: PlaceConfig, session: Session, *, quiet: bool) -> FinishedSample:
    """Place one sample; stage lines go to standard error unless `quiet`."""
    if session.ledger:  # of an earlier placement into the same folder
        Path(session.ledger).unlink(missing_ok=True)
    console = Console(file=sys.stderr, quiet=quiet, highlight=False)
    plan = plan_sample(sample, config)
    if plan.failed is not None:
        raise plan.failed.error
    if plan.finished is not None:
        console.print(f"all {len(plan.cached)} stages cached")
        return plan.finished
    with console.status("starting") as status, prefect_server():

        def show(event: StageEvent) -> None:
            if event.event is Event.STARTED:
                status.update(event.stage)
            elif event.event is Event.PROGRESS:
                status.update(Text(f"{event.stage} {event.part:4.0%} {event.text}"))
            else:
                console.print(stage_line(event))

        finished = run_sample(sample, config, context=RunContext(session=session), listener=show)
    if session.ledger and Path(session.ledger).is_file():
        console.print(in_words(totals(Path(session.ledger))))
    return finished


def stage_line(event: StageEvent) -> str:
    """A finished stage in a line."""
    assert event.record is not None
    width = max(len(name) for name in STAGE_NAMES)
    took = "cached" if event.event is Event.CACHED else f"{event.record.seconds:.2f} s"
    return f"{event.stage:<{width}}  {took:>9}  {event.record.size / 1024:9.0f} KiB  {event.record.ref.kind}"
