"""What a benchmark makes of what a server tells of its samples in the pool."""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from uuid import UUID, uuid4

import httpx
import pytest
from prefect.client.schemas.filters import FlowRunFilter
from prefect.client.schemas.objects import FlowRun, State
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Completed, Failed, Running

from dcap.language.protocol.session import Session
from dcap.scene.types.sample import Sample
from flows.elsewhere import SampleJob, Told, told_of
from flows.place import PlaceConfig
from flows.run_names import WatchedRun
from flows.sample_flow import server_lost
from flows.work_pool import TIMES, WorkPool


class FewAtATime:
    """A server that tells two flow runs at a time."""

    def __init__(self, runs: dict[UUID, State], unlisted: Sequence[UUID] = ()) -> None:
        self.runs, self.unlisted = runs, unlisted

    def read_flow_runs(self, flow_run_filter: FlowRunFilter, offset: int = 0) -> list[FlowRun]:
        """A page of those that are wanted."""
        assert flow_run_filter.id is not None
        wanted = [one for one in flow_run_filter.id.any_ or () if one in self.runs and one not in self.unlisted]
        return [FlowRun(id=one, flow_id=uuid4(), state=self.runs[one]) for one in wanted[offset : offset + 2]]

    def read_flow_run(self, run: UUID) -> FlowRun:
        """One of them."""
        if run not in self.runs:
            raise ObjectNotFound(KeyError(run))
        return FlowRun(id=run, flow_id=uuid4(), state=self.runs[run])

    def read_workers_for_work_pool(self, pool: str) -> Sequence[object]:
        """There are none, and none was lost."""
        return []


def job(name: str) -> SampleJob:
    """A sample to place."""
    return SampleJob(Sample(name, "room", "mug", "put it there"), PlaceConfig(), Session(), WatchedRun("run"))


def test_each_sample_is_told_of_once_however_few_the_server_tells_at_a_time() -> None:
    """One whose flow run is deleted has failed; one that runs is waited for."""
    ids = {name: uuid4() for name in ("done", "broken", "at work", "done too", "deleted", "at work too", "not listed")}
    states: dict[UUID, State] = {
        ids["done"]: Completed(), ids["broken"]: Failed(message="a defect"), ids["at work"]: Running(),
        ids["done too"]: Completed(), ids["at work too"]: Running(), ids["not listed"]: Running(),
    }  # fmt: skip
    pool = WorkPool()
    pool.waiting = {one: job(name) for name, one in ids.items()}
    told = {sample.id: what for sample, what in pool.ended(FewAtATime(states, [ids["not listed"]]))}  # type: ignore[arg-type]
    assert told == {
        "done": told_of(""), "broken": told_of("a defect"), "done too": told_of(""),
        "deleted": told_of("somebody has deleted its flow run"),
    }  # fmt: skip
    assert {one.sample.id for one in pool.waiting.values()} == {"at work", "at work too", "not listed"}


@pytest.mark.parametrize(("status", "lost"), [(502, True), (503, True), (504, True), (500, False), (409, False)])
def test_a_web_server_before_it_says_that_a_server_is_away(status: int, lost: bool) -> None:
    """By its status; what the server itself refuses is no loss of it."""
    request = httpx.Request("GET", "http://127.0.0.1/api/health")
    answer = httpx.Response(status, request=request)
    assert server_lost(PrefectHTTPStatusError("no", request=request, response=answer)) is lost


def test_no_worker_counts_as_lost_for_an_outage(monkeypatch: pytest.MonkeyPatch) -> None:
    """Prefect's client asks again until the server answers: a look that took long was an outage, and for a while after
    it the silence of a worker says nothing."""
    clock = [1000.0]
    monkeypatch.setattr("flows.work_pool.time.monotonic", lambda: clock[0])
    monkeypatch.setattr("flows.work_pool.lost_workers", lambda client: {"one": None})
    asked: list[str] = []
    monkeypatch.setattr(WorkPool, "ask", lambda pool, client, again: asked.append(again.sample.id))
    monkeypatch.setattr("flows.work_pool.end_as_crashed", lambda *_: None)
    run, pool = uuid4(), WorkPool()
    pool.begun["a"] = 1

    class Slow(FewAtATime):
        """It answers after so many seconds."""

        seconds = 0.0

        def read_flow_runs(self, flow_run_filter: FlowRunFilter, offset: int = 0) -> list[FlowRun]:
            clock[0] += self.seconds
            self.seconds = 0.0
            return [FlowRun(id=run, flow_id=uuid4(), state=Running(), tags=["worker:one"])][offset:]

    server = Slow({run: Running()})
    pool.waiting = {run: job("a")}
    server.seconds = 45.0
    assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    clock[0] += 60.0
    assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    assert asked == []
    clock[0] += 61.0
    assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    assert asked == ["a"]


def test_a_sample_is_asked_for_once_where_the_server_is_lost_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that is lost on its way is asked for by the same key; a name that cannot be told is let be."""
    keys: list[str] = []

    def deploy(name: str, *, idempotency_key: str, **_: object) -> FlowRun:
        keys.append(idempotency_key)
        if len(keys) == 1:
            raise httpx.ReadError("the answer is lost")
        return FlowRun(id=uuid4(), flow_id=uuid4(), parent_task_run_id=uuid4())

    class Nameless(FewAtATime):
        """It is away when a name is told."""

        def set_task_run_name(self, run: UUID, name: str) -> None:
            raise httpx.ConnectError("away")

    monkeypatch.setattr("flows.work_pool.run_deployment", deploy)
    pool, server = WorkPool(), Nameless({})
    with pytest.raises(httpx.ReadError):
        pool.ask(server, job("a"))  # type: ignore[arg-type]
    pool.ask(server, job("a"))  # type: ignore[arg-type]
    assert keys == [keys[0]] * 2
    assert (len(pool.waiting), pool.begun) == (1, {"a": 1})
    pool.ask(server, job("a"))  # type: ignore[arg-type]
    assert keys[2] != keys[0]


def test_what_is_known_is_told_before_a_lost_server_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """And one that stays lost, though it says that it is well, ends the benchmark."""
    waited: list[str] = []
    monkeypatch.setattr("flows.work_pool.get_client", lambda **_: nullcontext(FewAtATime({})))
    monkeypatch.setattr("flows.work_pool.wait_for_server", lambda: waited.append("waited"))
    monkeypatch.setattr("flows.work_pool.end_as_crashed", lambda *_: None)

    def ended(pool: WorkPool, client: object) -> Iterator[Told]:
        if not waited:
            yield job("a").sample, told_of("")
        raise httpx.ConnectError("away")

    monkeypatch.setattr(WorkPool, "ended", ended)
    pool = WorkPool()
    pool.waiting = {uuid4(): job("a"), uuid4(): job("b")}
    told: list[str] = []
    with pytest.raises(httpx.ConnectError):
        told.extend(sample.id for some in pool.placed([], 0.0) for sample, _ in some)
    assert told == ["a"]
    assert len(waited) == TIMES - 1
