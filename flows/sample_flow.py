"""A sample as a flow run of Prefect, by itself or as the child of a benchmark's; imports Prefect.

A server that dies while a sample is placed loses the flow run, not the sample: the server is started again
(flows/server.py), and the sample begins again in a new flow run, in which the stages that it had finished are cached.
"""

from collections.abc import Callable
from dataclasses import asdict
from uuid import UUID

import httpx
from prefect.client.orchestration import get_client

from dcap.scene.errors import DcapError
from dcap.scene.store.artifacts import Store
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.sample import Sample
from flows.flow_runs import COMPLETED, FlowRunNames, ShownState, end_as_crashed, run_shown
from flows.place import PlacementRefs
from flows.run_names import WatchedRun, sample_tags, title_of
from flows.sample_pictures import show_pictures
from flows.server import wait_for_server
from tasks.runner.outcomes import reason_line
from tasks.runner.task_runs import INFEASIBLE

TIMES = 4
"""How often a sample begins again because the server was lost."""
NO_SERVER = "Failed to reach API"
"""How the plain RuntimeError of Prefect's client begins."""


def place_in_flow_run(
    stages: Callable[[], PlacementRefs], sample: Sample, run: WatchedRun | None = None
) -> PlacementRefs:
    """What the stages of a sample return, called in a flow run."""
    names = FlowRunNames(
        flow="place",
        name=run.title(sample) if run else title_of(sample),
        tags=sample_tags(sample, run.name if run else ""),
        parameters=asdict(sample),
    )
    begun: list[UUID] = []

    def body(run_id: UUID) -> PlacementRefs:
        begun.append(run_id)
        placement = stages()
        show_pictures(placement, run_id)
        return placement

    for _ in range(TIMES):
        try:
            return run_shown(body, names, shown=shown_state, parent=run.id if run else None)
        except (httpx.TransportError, RuntimeError) as error:
            if not server_lost(error):
                raise
            wait_for_server()
            with get_client(sync_client=True) as client:
                end_as_crashed(client, begun, "the server was lost; the sample begins again")
            begun.clear()
    raise DcapError(f"the Prefect server was lost {TIMES} times while {sample.id} was placed; its log says why")


def shown_state(placement: PlacementRefs) -> ShownState:
    """How the flow run of a sample ends."""
    if not placement.renders.infeasible:
        return COMPLETED, ""
    found = Store.default().load(placement.renders)
    assert isinstance(found, Infeasible)
    return INFEASIBLE, reason_line(found)


def server_lost(error: Exception) -> bool:
    """Whether an error says that no server answers."""
    return isinstance(error, httpx.TransportError) or NO_SERVER in str(error)
