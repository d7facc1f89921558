"""Flow runs of Prefect with names, tags and final states in our words; imports Prefect: only once a server answers.

A benchmark is one flow run, `benchmark`; each of its samples that has work is a child of it, `place`. Prefect would
number the children of threads by a counter that the threads race for, and two samples would share a run; so children
are created here, each with a key of its own.
"""

import signal
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from uuid import UUID, uuid4

from prefect import Flow, Task
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.filters import FlowFilter, FlowRunFilter, TaskRunFilter
from prefect.client.schemas.objects import FlowRun, State
from prefect.context import SyncClientContext
from prefect.flow_engine import FlowRunEngine
from prefect.states import Completed, Crashed, Failed, Pending

from dcap.scene.errors import DcapError, ServerGoneError
from flows.interrupts import put_off
from flows.lost_server import refusals_passed, server_errors_passed
from flows.programs import Program
from flows.server_wait import server_is_gone
from tasks.runner.task_runs import broken

PROGRAM = "program"
"""Key in the context of a flow run, where its program stands."""
BENCHMARK, PLACE = "benchmark", "place"
"""Names of our flows."""
IN_A_REQUEST = 100
"""Flow runs that are asked about at once."""
NOBODY_WAITS = "the benchmark that asked for it is gone"
WAS_INTERRUPTED = "the benchmark was interrupted"
ShownState = tuple[str, str]
"""Name of a final state, Completed, Infeasible or Failed, and the line that says why."""
COMPLETED, FAILED = "Completed", "Failed"


@dataclass(frozen=True, slots=True)
class FlowRunNames:
    """How a flow run is shown."""

    flow: str
    name: str
    tags: tuple[str, ...]
    parameters: Mapping[str, object]
    """What it was asked, as JSON."""


@dataclass
class ShownFlowRun(FlowRunEngine[..., Any]):
    """Prefect's engine of flow runs, with final states in our words."""

    ending: ShownState = (COMPLETED, "")
    """The final state, unless something is raised."""

    @property
    def heartbeat_seconds(self) -> int | None:
        """There is no heartbeat: the thread of one is waited for at the end, up to a second."""
        return None

    def handle_success(self, result: Any) -> Any:
        """The flow has come to its end: nothing is persisted."""
        name, why = self.ending
        self.set_state(Failed(message=why) if name == FAILED else Completed(name=name, message=why or None))
        self._return_value = result
        return result

    def handle_crash(self, exc: BaseException) -> None:
        """Somebody has interrupted the program: where no server answers, the next run tells it."""
        self.short_circuit |= server_is_gone()
        super().handle_crash(exc)

    def handle_exception(self, exc: Exception, msg: str | None = None, result_store: object = None) -> State[Any]:
        """The flow has broken."""
        self._raised = exc
        self.short_circuit |= isinstance(exc, ServerGoneError)  # nobody is there to be told
        return self.set_state(broken(exc, self.logger))


@contextmanager
def flow_run(names: FlowRunNames, parent: UUID | None = None) -> Iterator[ShownFlowRun]:
    """A block as a flow run, the child of `parent` if that is named. It ends as its `ending` says, or as Failed or
    Crashed by what the block raises."""
    flow = Flow(the_block, name=names.flow, validate_parameters=False, persist_result=False)
    with SyncClientContext.get_or_create() as context:
        if parent is None:
            with server_errors_passed():  # others' runs: a server that is lost shows itself below
                end_left_runs(context.client)
        engine = ShownFlowRun(flow=flow, flow_run=created(context.client, flow, names, parent))
        with engine.start(), put_off(signal.SIGTERM):  # Prefect's own handler raises in the middle of imports
            if not engine.is_running():
                raise DcapError(f"the flow run {names.name!r} was ended before it began: {engine.state.name}")
            with engine.run_context():
                yield engine
                engine.handle_success(None)
        engine.result()  # raises what the block has raised, once it is told


def the_block() -> None:
    """Stands for what a flow run consists of: Prefect asks for a function, and names it nowhere."""


def created(client: SyncPrefectClient, flow: Flow[Any, Any], names: FlowRunNames, parent: UUID | None) -> FlowRun:
    """A new flow run; in its parent a task run stands for it."""
    return client.create_flow_run(
        flow,
        name=names.name,
        parameters=dict(names.parameters),
        tags=names.tags,
        context={PROGRAM: Program.this().to_json()},
        parent_task_run_id=None if parent is None else stand_in(client, parent, names, str(uuid4())),
        state=Pending(),
    )


def stand_in(client: SyncPrefectClient, parent: UUID, names: FlowRunNames, key: str) -> UUID:
    """The task run that stands for a flow run in its parent; the same one for the same key."""
    task = Task(the_block, name=names.flow)
    made = client.create_task_run(
        task, parent, dynamic_key=key, name=names.name, extra_tags=names.tags, state=Pending()
    )  # fmt: skip
    return made.id


def end_left_runs(client: SyncPrefectClient) -> None:
    """Say of flow runs that their program is gone, where it was killed on this machine before it could do so itself.
    What the server refuses of that is left: it is no matter of the run that begins."""
    unended = FlowRunFilter.model_validate({"state": {"type": {"any_": ["PENDING", "RUNNING"]}}})
    for one in every_flow_run(client, unended):
        program = Program.from_json(one.context.get(PROGRAM))
        if program is not None and program.is_gone:
            gone = f"its program, process {program.pid} of {program.host}, is gone"
            # the parent last: who is interrupted here leaves it for the next to find
            for run, why in (*((child, NOBODY_WAITS) for child in waiting_children(client, one.id)), (one.id, gone)):
                end_as_crashed(client, [run], why)
    # a server keeps what begins a moment later: a stage may have come after its flow run had ended
    end_stages(client, {"state": {"type": {"any_": ["CRASHED"]}}}, "its flow run has crashed")


def waiting_children(client: SyncPrefectClient, parent: UUID) -> list[UUID]:
    """Flow runs that wait in the pool for a worker, or were claimed by one and have not begun."""
    wanted = FlowRunFilter.model_validate(
        {"parent_flow_run_id": {"any_": [parent]}, "state": {"type": {"any_": ["SCHEDULED", "PENDING"]}}}
    )
    return [one.id for one in every_flow_run(client, wanted)]


def every_flow_run(client: SyncPrefectClient, wanted: FlowRunFilter) -> list[FlowRun]:
    """The flow runs that a filter lets through, however few the server tells at a time; what it refuses is left."""
    found: list[FlowRun] = []
    with refusals_passed():
        while page := client.read_flow_runs(flow_run_filter=wanted, offset=len(found)):
            found += page
    return found


def end_as_crashed(client: SyncPrefectClient, runs: Iterable[UUID], why: str) -> None:
    """Say of flow runs, and of what is at work in them, that they will not go on."""
    ended = list(runs)
    for begin in range(0, len(ended), IN_A_REQUEST):  # first: who is interrupted here leaves the rest to be found
        end_stages(client, {"id": {"any_": ended[begin : begin + IN_A_REQUEST]}}, why)
    for one in ended:
        with refusals_passed():  # not ours to end, or deleted meanwhile
            client.set_flow_run_state(one, Crashed(message=why), force=True)


def end_stages(client: SyncPrefectClient, within: Mapping[str, object], why: str) -> None:
    """Say of task runs that the server takes to be at work in some of our flow runs that they will not go on; what it
    refuses of that is left."""
    runs = FlowRunFilter.model_validate(within)
    ours = FlowFilter.model_validate({"name": {"any_": [BENCHMARK, PLACE]}})
    unended = TaskRunFilter.model_validate({"state": {"type": {"any_": ["PENDING", "RUNNING"]}}})
    found: list[UUID] = []
    with refusals_passed():
        while page := client.read_task_runs(
            flow_filter=ours, flow_run_filter=runs, task_run_filter=unended, offset=len(found)
        ):
            found += [one.id for one in page]  # as many as the server gives
    for one in found:
        with refusals_passed():
            client.set_task_run_state(one, Crashed(message=why), force=True)
