"""A benchmark as one flow run of Prefect: its samples are its children, its results its artifacts; imports Prefect."""

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from prefect.client.orchestration import get_client
from prefect.client.schemas.filters import FlowRunFilter

from dcap.scene.types.sample import Sample
from flows.flow_runs import (
    BENCHMARK,
    COMPLETED,
    FAILED,
    WAS_INTERRUPTED,
    FlowRunNames,
    ShownFlowRun,
    end_as_crashed,
    end_stages,
    every_flow_run,
    flow_run,
)
from flows.lost_server import server_errors_passed
from flows.run_artifacts import RunArtifacts, plain_text, table_data
from flows.run_names import WatchedRun, benchmark_tags, repeated_titles
from flows.server_wait import server_is_gone
from flows.watching import SettledSample, Watch

PROGRESS_SECONDS, TABLE_SECONDS = 1.0, 30.0
"""How often these are written anew while samples are placed."""


class FlowRunWatch(Watch):
    """Shows a benchmark as its flow run does: progress, a table of results, the way to the report."""

    def __init__(self, folder: Path, samples: Sequence[Sample], engine: ShownFlowRun) -> None:
        assert engine.flow_run is not None
        self._engine, self._folder, self._id = engine, folder, engine.flow_run.id
        self._run = WatchedRun(folder.name, self._id, repeated_titles(samples))
        self.order = {sample.id: number for number, sample in enumerate(samples)}
        self.rows: dict[str, dict[str, object]] = {}
        self.artifacts = RunArtifacts(self._id)
        self.written = {"progress": 0.0, "results": time.monotonic()}

    @property
    def run(self) -> WatchedRun:
        """The run that the samples' flow runs belong to."""
        return self._run

    def settled(self, one: SettledSample) -> None:
        """A sample is done."""
        self.rows[one.sample.id] = one.to_row()
        if self.due("results", TABLE_SECONDS):
            self.write_table()

    def progress(self, share: float) -> None:
        """So much of the work is done, 0..1."""
        if self.due("progress", PROGRESS_SECONDS):
            self.write_progress(share)

    def due(self, name: str, seconds: float) -> bool:
        """Whether it is time to write an artifact anew."""
        now = time.monotonic()
        if now - self.written[name] < seconds:
            return False
        self.written[name] = now
        return True

    def write_progress(self, share: float) -> None:
        """Write the progress."""
        failed = sum(row["verdict"] == "failed" for row in self.rows.values())
        text = f"{len(self.rows)} of {len(self.order)} samples" + (f", {failed} failed" if failed else "")
        self.artifacts.put("progress", "progress", round(100.0 * share, 1), text)

    def write_table(self) -> None:
        """Write the table of results."""
        rows = [self.rows[name] for name in sorted(self.rows, key=self.order.__getitem__)]
        self.artifacts.put("results", "table", table_data(rows), "How each sample ended.")

    def write_report(self, line: str) -> None:
        """Write what came out and where the report lies: browsers open no file from a page of a server."""
        text = f"{plain_text(line)}\n\nOpen in a browser:\n\n    {self._folder / 'report.html'}\n"
        self.artifacts.put("report", "markdown", text, "Where the results are.")

    def finished(self, fine: bool, line: str) -> None:
        """The report is written."""
        self.write_progress(1.0)
        self.write_table()
        self.write_report(line)
        with server_errors_passed(), get_client(sync_client=True) as client:
            end_stages(client, {"id": {"any_": [self._id]}}, "its flow run did not end, or was deleted")
        self._engine.ending = COMPLETED if fine else FAILED, line

    def interrupted(self) -> None:
        """The run ends now, and with it what is at work."""
        own = FlowRunFilter.model_validate(
            {"parent_flow_run_id": {"any_": [self._id]}, "state": {"type": {"any_": ["PENDING", "RUNNING"]}}}
        )
        if server_is_gone():
            return
        with server_errors_passed(), get_client(sync_client=True) as client:
            end_as_crashed(client, [child.id for child in every_flow_run(client, own)], WAS_INTERRUPTED)
            end_stages(client, {"id": {"any_": [self._id]}}, WAS_INTERRUPTED)  # which stand for children


def check_access() -> None:
    """Raises what the server refuses to those who do not sign in."""
    with get_client(sync_client=True) as client:
        client.read_flow_runs(limit=1)


@contextmanager
def benchmark_run(folder: Path, samples: Sequence[Sample], parameters: dict[str, object]) -> Iterator[FlowRunWatch]:
    """A block as the flow run of a benchmark, and what shows there how it goes."""
    methods = list(dict.fromkeys(sample.method for sample in samples))
    names = FlowRunNames(BENCHMARK, folder.name, benchmark_tags(folder.name, methods), parameters)
    with flow_run(names) as engine:
        watch = FlowRunWatch(folder, samples, engine)
        watch.write_progress(0.0)
        yield watch
