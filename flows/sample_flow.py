"""A sample as a flow run of Prefect, by itself or as the child of a benchmark's; imports Prefect.

A server that dies while a sample is placed loses the flow run, not the sample: the server is started again
(flows/server.py), and the sample begins again in a new flow run, in which the stages that it had finished are cached.
"""

from collections.abc import Iterator
from dataclasses import asdict
from types import TracebackType
from uuid import UUID

import httpx
from prefect.client.orchestration import get_client

from dcap.scene.errors import DcapError
from dcap.scene.settings import server_folder
from dcap.scene.store.artifacts import Store
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.sample import Sample
from flows.flow_runs import COMPLETED, PLACE, FlowRunNames, ShownFlowRun, ShownState, end_as_crashed, flow_run
from flows.lost_server import server_errors_passed, server_lost
from flows.place import PlacementRefs
from flows.run_names import WatchedRun, sample_tags, title_of
from flows.sample_pictures import show_pictures
from flows.server import why_gone
from flows.server_wait import wait_for_server
from tasks.runner.outcomes import reason_line
from tasks.runner.task_runs import INFEASIBLE

MOST_BEGINNINGS = 4
"""How often a sample begins: again where the server was lost, or its worker."""


class SampleFlowRun:
    """The block in which the stages of a sample run. What it raises is raised again where the flow run can tell it, by
    the loop over `flow_runs_of`; so nothing leaves that loop from inside of the block."""

    def __init__(self, engine: ShownFlowRun) -> None:
        self._engine = engine
        self.error: BaseException | None = None
        """What the block has raised."""

    def __enter__(self) -> None:
        self.error = None

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self.error = error
        return True

    def show(self, placement: PlacementRefs) -> None:
        """Show what came of the sample: its pictures, or why there is no way."""
        assert self._engine.flow_run is not None
        show_pictures(placement, self._engine.flow_run.id)
        self._engine.ending = ending_of(placement)


def ending_of(placement: PlacementRefs) -> ShownState:
    """How the flow run of a sample ends that has got through."""
    if not placement.renders.infeasible:
        return COMPLETED, ""
    found = Store.default().load(placement.renders)
    assert isinstance(found, Infeasible)
    return INFEASIBLE, reason_line(found)


def flow_runs_of(sample: Sample, run: WatchedRun | None = None) -> Iterator[SampleFlowRun]:
    """The flow runs in which a sample is placed: one, and another each time that the server is lost."""
    names = FlowRunNames(
        flow=PLACE,
        name=run.title(sample) if run else title_of(sample),
        tags=sample_tags(sample, run.name if run else ""),
        parameters=asdict(sample),
    )
    for _ in range(MOST_BEGINNINGS):
        begun: list[UUID] = []
        try:
            with flow_run(names, run.id if run else None) as engine:
                assert engine.flow_run is not None
                begun.append(engine.flow_run.id)
                block = SampleFlowRun(engine)
                yield block
                if block.error is not None:
                    raise block.error
        except (httpx.HTTPError, RuntimeError) as error:
            if not server_lost(error):
                raise
            wait_for_server()
            with server_errors_passed(), get_client(sync_client=True) as client:
                end_as_crashed(client, begun, "the server was lost; the sample begins again")
        else:
            return
    lost = f"the Prefect server was lost {MOST_BEGINNINGS} times"
    raise DcapError(f"{lost} while {sample.id} was placed; {why_gone(server_folder())}")
