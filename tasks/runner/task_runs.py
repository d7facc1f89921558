"""A stage as a task run of Prefect: what it depends on, and a state that tells how it ended.

Prefect looks for what a task depends on by the addresses of its inputs (`id()`): it finds nothing for references, which
are values, and something wrong where a short-lived value lies at the address of an earlier one. So its own search gets
nothing to find, and a stage names the task runs that made the very references that it is given.

A computed stage ends as Completed, one whose record was found as Cached, one that found no way as Infeasible (a
completed state: its reason is a result, and is cached like any other), a broken one as Failed; the last two with a line
that says why. What Prefect persists is not touched by that. Imports Prefect: to be imported on the first run only.
"""

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any
from uuid import UUID

import httpx
from prefect import Task
from prefect._internal.result_records import ResultRecord
from prefect.client.schemas.objects import RunInput, State, TaskRunResult
from prefect.states import Crashed, Failed
from prefect.task_engine import SyncTaskRunEngine
from prefect.transactions import Transaction

from dcap.scene.errors import DcapError
from dcap.scene.machine_errors import says_no_server
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.types.outcome import Infeasible
from tasks.runner.context import Producers, current_context
from tasks.runner.outcomes import error_line, reason_line
from tasks.runner.process_server import InterruptedRunError

CACHED, INFEASIBLE = "Cached", "Infeasible"
"""Names of states; the first is Prefect's own."""


class StageRunEngine(SyncTaskRunEngine[..., dict[str, object]]):
    """Prefect's engine of task runs, with states in our words."""

    @property
    def returned(self) -> tuple[dict[str, object], UUID]:
        """What the function has returned, and the id of the task run."""
        result = self.result()
        assert isinstance(result, dict)
        assert self.task_run is not None
        return result, self.task_run.id

    def begin_run(self) -> None:
        """Start, with tags only from here on: before, Prefect asks its server about limits of each tag."""
        assert self.task_run is not None
        self.task_run.tags = list(current_context().tags)
        super().begin_run()

    def set_state(self, state: State[Any], force: bool = False) -> State[Any]:
        """Take on a state, with the reason where a stage found no way."""
        if state.is_completed():
            tell_reason(state)
        return super().set_state(state, force)

    def handle_exception(self, exc: Exception) -> None:
        """A broken stage: nothing is tried again, and no record is written."""
        self.set_state(broken(exc, self.logger))
        self._raised = exc


def broken(exc: Exception, logger: logging.Logger | logging.LoggerAdapter[Any]) -> State[Any]:
    """The final state of a run that has broken: Failed, or Crashed where its program was interrupted, or its server was
    lost; logged."""
    if isinstance(exc, InterruptedRunError):
        return Crashed(message=str(exc))
    if isinstance(exc, httpx.TransportError) or says_no_server(exc):
        return Crashed(message="the server was lost")
    logger.error("%s", error_line(exc), exc_info=None if isinstance(exc, DcapError) else exc)
    return Failed(message=error_line(exc))


def tell_reason(state: State[Any]) -> None:
    """Say in the final state of a stage why there is no value, if there is none."""
    assert isinstance(state.data, ResultRecord)
    ref: Ref[Any] = Ref.from_json(state.data.result["ref"])
    if ref.infeasible:
        found = Store.default().load(ref)
        assert isinstance(found, Infeasible)
        state.message = reason_line(found)
        if state.name != CACHED:
            state.name = INFEASIBLE


@contextmanager
def task_run(
    task: "Task[..., dict[str, object]]", inputs: Mapping[str, object], producers: Producers
) -> Iterator[tuple[StageRunEngine, Transaction]]:
    """A task run in the flow run of this thread, whose function the block is to call; raises what that has raised."""
    made_by: dict[str, set[RunInput]] = {
        name: {TaskRunResult(id=run_id)} for name, value in inputs.items() if (run_id := producers.of(value))
    }
    # the task reads its inputs from the context: Prefect gets their names, and nothing whose address it could look up
    engine = StageRunEngine(task=task, parameters=dict.fromkeys(inputs))
    with engine.start(dependencies=made_by), engine.run_context(), engine.transaction_context() as transaction:
        yield engine, transaction
    engine.result()
