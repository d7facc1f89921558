"""Progress of a benchmark while it runs, and its final tables, on standard error."""

import sys
import threading
import time
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Self, TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table
from rich.text import Text

from dcap.evaluation.methods import joined_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import RunSummary
from dcap.language.model.ledger import in_words
from dcap.scene.types.sample import Sample
from tasks.run_context import Event, OnEvent, StageEvent

SHOWN_WIDTH = 46
WIDTH = 160


def console_on(stream: TextIO, *, quiet: bool = False) -> Console:
    """A console that shows text literally, and breaks no lines unless the stream is a terminal."""
    asks = getattr(stream, "isatty", None)  # a program may have no stream, or one that can only be written to
    width = None if asks is not None and asks() else WIDTH
    return Console(
        file=stream, quiet=quiet, highlight=False, markup=False, emoji=False, width=width, force_jupyter=False
    )


def console_on_stderr() -> Console:
    """Console for everything but a command's result."""
    return console_on(sys.stderr)


class Display:
    """Live progress: samples done, the stages at work, and the time left."""

    def __init__(self, samples: Sequence[Sample]) -> None:
        self.console = console_on_stderr()
        self.progress = Progress(
            SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(),
            TimeElapsedColumn(), TextColumn("{task.fields[work]}", markup=False),
            console=self.console, refresh_per_second=4,
        )  # fmt: skip
        self.bar = self.progress.add_task("placing", total=len(samples), work="")
        self.count, self.done, self.failures, self.stages = len(samples), 0, 0, 0
        self.begin, self.lines, self.lock = time.monotonic(), dict[str, TaskID](), threading.Lock()

    def __enter__(self) -> Self:
        self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.progress.stop()
        if not self.console.is_terminal:  # end the last line, which has no newline yet
            self.console.line()

    def listener(self, sample: Sample) -> OnEvent:
        """Return a listener for the stages of one sample, which has a line while it is at work."""

        def on_event(event: StageEvent) -> None:
            with self.lock:
                if event.event in (Event.STARTED, Event.PROGRESS):
                    if sample.id not in self.lines:
                        self.lines[sample.id] = self.progress.add_task(sample.id[:SHOWN_WIDTH], total=1, work="")
                    self.progress.update(self.lines[sample.id], work=f"{event.stage} {event.text[:40]}")
                else:
                    self.stages += 1
                    self.progress.update(self.bar, work=f"{self.stages} stages done")

        return on_event

    @property
    def share(self) -> float:
        """Share of the work that is done, 0..1."""
        return self.done / self.count

    @property
    def counts(self) -> str:
        """The same in words."""
        return f"{self.done} of {self.count} samples" + (f", {self.failures} failed" if self.failures else "")

    def say(self, text: str) -> None:
        """Show a line that is not about one sample."""
        self.console.print(text)

    def ended(self, sample: Sample, failure: str = "") -> None:
        """Count a sample that has ended, and show why it failed."""
        if failure:
            self.console.print(Text("failed", "red"), f"{sample.id}: {failure}")
        with self.lock:
            if (line := self.lines.pop(sample.id, None)) is not None:
                self.progress.remove_task(line)
            self.done += 1
            self.failures += failure != ""
            left = (time.monotonic() - self.begin) / self.done * (self.count - self.done)
        told = f"{self.stages} stages done" + (f", about {left / 60:.0f} min left" if left > 60 else "")
        self.progress.update(self.bar, completed=self.done, work=told)


def print_table(rows: Sequence[SampleOutcome], summary: RunSummary, folder: Path, cached: Collection[str] = ()) -> None:
    """Print the results of a run. `cached` samples, by their ids, have no time because they took none."""
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
    """Print lines without markup."""
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
