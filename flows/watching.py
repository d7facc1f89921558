"""What is shown of a benchmark besides the terminal: nothing here, a flow run in flows/benchmark_flow.py."""

from dataclasses import dataclass

from dcap.evaluation.outcome_table import row_of
from dcap.scene.json_tree import JsonObject
from dcap.scene.types.sample import Sample
from flows.run_names import WatchedRun


@dataclass(frozen=True, slots=True)
class SettledSample:
    """A sample of which it is known how it ended."""

    sample: Sample
    tree: JsonObject | None
    """Its placement.json; None if it failed."""
    error: str
    cached: bool
    """Whether nothing had to be computed."""

    def to_row(self) -> dict[str, object]:
        """As a row of a table for people."""
        row = row_of(self.sample, self.tree, self.error, None)
        return {
            "sample": row.sample,
            "method": row.method,
            "verdict": row.verdict,
            "on": f"{row.base} {row.part}".strip(),
            "seconds": row.seconds,
            "cached": "cached" if self.cached else "",
            "why": row.error or " ".join(f"{row.reason}: {row.message}".split()).rstrip(": ") * bool(row.reason),
        }


class Watch:
    """Shows nothing: all samples are cached, and no server runs."""

    @property
    def run(self) -> WatchedRun | None:
        """The run that the samples' flow runs belong to."""
        return None

    def settled(self, one: SettledSample) -> None:
        """A sample is done."""

    def progress(self, share: float) -> None:
        """So much of the work is done, 0..1."""

    def finished(self, fine: bool, line: str) -> None:
        """The report is written: whether all samples got through, and the counts in a line."""

    def interrupted(self) -> None:
        """The run ends now, and with it what is at work."""
