"""What a benchmark shows while it runs, and the tables it ends with, on standard error; and what a plan shows."""

import sys
import threading
import time
from collections.abc import Collection, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from dcap.evaluation.methods import joined_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_summary import RunSummary
from dcap.language.model.ledger import in_words
from dcap.scene.types.sample import Sample
from flows.sample_run import STAGE_NAMES, Plan
from flows.server import pages_of
from tasks.runner.context import Event, OnEvent, StageEvent

SHOWN_WIDTH = 46
WIDTH = 160


def console_on(stream: TextIO) -> Console:
    """A console that shows words as they are and does not break lines where nobody looks at a terminal."""
    width = None if stream.isatty() else WIDTH
    return Console(file=stream, highlight=False, markup=False, emoji=False, width=width)


def console_on_stderr() -> Console:
    """For all but what a command was asked for."""
    return console_on(sys.stderr)


class Display:
    """Live progress: samples done, the stages at work, and the time left."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self.console = console_on_stderr()
        self.progress = Progress(
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=self.console,
        )
        self.bar = self.progress.add_task("planning", total=len(samples), left="")
        self.begin = time.monotonic()
        self.stages = {sample.id: len(STAGE_NAMES) for sample in samples}
        """Number of stages of every sample that planning has not settled, as far as one can see."""
        self.stages_done = dict.fromkeys(self.stages, 0)
        self.ran = 0
        self.at_work: dict[str, tuple[str, str, float]] = {}
        self.lock = threading.Lock()
        self.live = Live(console=self.console, refresh_per_second=4, get_renderable=self.rendered)

    def __enter__(self) -> Self:
        self.live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.live.stop()
        if not self.console.is_terminal:  # where its last line has no end
            self.console.line()

    def rendered(self) -> RenderableType:
        """The bar and one line per sample at work."""
        with self.lock:
            done, total = sum(self.stages_done.values()), sum(self.stages.values())
            stages = Text(f"  {done} of {total} stages" if done or self.at_work else "")
            lines = [stages] + [Text(work_line(sample, *work)) for sample, work in self.at_work.items()]
        return Group(self.progress, *lines)

    def planned(self, plan: Plan) -> None:
        """One sample has been looked up."""
        with self.lock:
            if plan.finished is not None or plan.failed is not None:
                del self.stages[plan.sample.id]
            else:
                self.stages[plan.sample.id] = plan.stage_count
        self.progress.advance(self.bar)

    def serving(self, url: str) -> None:
        """Work begins; the runs can be watched at `url`."""
        self.console.print(f"Prefect: {pages_of(url)}")
        self.begin = time.monotonic()
        self.progress.reset(self.bar, total=len(self.stages), description="placing", left="")

    def listener(self, sample: Sample) -> OnEvent:
        """Where the stages of one sample report."""

        def on_event(event: StageEvent) -> None:
            with self.lock:
                if event.event in (Event.STARTED, Event.PROGRESS):
                    since = self.at_work.get(sample.id, ("", "", 0.0))
                    begun = since[2] if since[0] == event.stage else time.monotonic()
                    self.at_work[sample.id] = (event.stage, event.text, begun)
                else:
                    self.stages_done[sample.id] += 1

        return on_event

    def share(self) -> float:
        """How much of the work that planning has left is done, 0..1, by its stages."""
        with self.lock:
            return sum(self.stages_done[name] for name in self.stages) / (sum(self.stages.values()) or 1)

    def say(self, text: str) -> None:
        """A line that is not about one sample."""
        self.console.print(text)

    def finished(self, sample: Sample) -> None:
        """A sample is done; one that was placed elsewhere has told nothing of its stages."""
        with self.lock:
            if sample.id in self.stages and not self.stages_done[sample.id]:
                self.stages_done[sample.id] = self.stages[sample.id]
        self.count(sample)

    def failed(self, sample: Sample, message: str) -> None:
        """A sample did not get through."""
        self.console.print(Text("failed", "red"), f"{sample.id}: {message}")
        self.count(sample)

    def count(self, sample: Sample) -> None:
        """Move the bar, however the sample ended; what planning has settled has moved it already."""
        if sample.id not in self.stages:
            return
        with self.lock:
            self.at_work.pop(sample.id, None)
            self.ran += 1
            self.stages[sample.id] = self.stages_done[sample.id]  # now one knows
            left = (time.monotonic() - self.begin) / self.ran * (len(self.stages) - self.ran)
        self.progress.update(self.bar, completed=self.ran, left=f"about {left / 60:.0f} min left" if left > 60 else "")


def work_line(sample: str, stage: str, text: str, since: float) -> str:
    """A sample at work in a line."""
    seconds = time.monotonic() - since
    return f"  {sample[:SHOWN_WIDTH]:<{SHOWN_WIDTH}} {stage:<14} {seconds:5.0f} s  {text[:40]}"


def print_plan(plans: Sequence[Plan], *, stages: bool = False, to_stderr: bool = False) -> None:
    """What would run, per sample and perhaps per stage, and a line of totals, on standard output or error."""
    console = console_on(sys.stderr if to_stderr else sys.stdout)
    table = Table("sample", "cached", "would run", "why", box=None)
    for plan in plans:
        count = "all" if plan.finished else ("-" if plan.failed else f"{len(plan.cached)} of {plan.stage_count}")
        table.add_row(plan.sample.id, count, plan.missing or "-", plan.failed.message if plan.failed else plan.why)
        for one in plan.stages if stages else ():
            table.add_row("", "", f"{one.state.replace('_', ' ')} {one.stage}", one.why or "")
    console.print(table)
    console.print(f"{sum(plan.finished is not None for plan in plans)} of {len(plans)} samples are cached")


def print_table(rows: Sequence[SampleOutcome], summary: RunSummary, folder: Path, cached: Collection[str] = ()) -> None:
    """The results of a run; of samples that were `cached`, by their ids, no time is told, since they took none."""
    console = console_on_stderr()
    several = len({row.method for row in rows}) > 1
    table = Table(*(("method",) if several else ()), "sample", "verdict", "on", "expected", "", "s", box=None)
    for row in rows:
        verdict = row.verdict if not row.reason else f"{row.verdict}: {row.reason}"
        mark = "" if row.as_expected is None else ("yes" if row.as_expected else "NO")
        on = f"{row.base} {row.part}".strip() + (" (region missed)" if row.region_missed else "")
        style = "red" if row.error else ("yellow" if row.as_expected is False else "")
        took = "cached" if joined_id(row.method, row.sample) in cached else f"{row.seconds:.1f}"
        cells = (row.sample, row.error[:60] or verdict, on, row.expected, mark, took)
        table.add_row(*((row.method,) if several else ()), *cells, style=style)
    console.print(table)
    console.print(summary_line(summary))
    if summary.language:
        console.print(in_words(summary.language))
    console.print(f"report: {folder / 'report.html'}")


def print_lines(lines: Sequence[str]) -> None:
    """Lines as they are."""
    console = console_on_stderr()
    for line in lines:
        console.print(line)


def summary_line(summary: RunSummary) -> str:
    """The counts in a sentence."""
    posed = f"{summary.as_posed} as posed, " if summary.as_posed else ""
    line = (
        f"{summary.samples} samples: {summary.at_rest} at rest, {posed}{summary.infeasible} infeasible, "
        f"{summary.failed} failed"
    )
    if summary.feasible_intended or summary.infeasible_intended:
        line += (
            f"; as intended {summary.feasible_as_intended} of {summary.feasible_intended} feasible and "
            f"{summary.infeasible_with_right_reason} of {summary.infeasible_intended} infeasible"
        )
    return f"{line}; {summary.wall_s} s"
