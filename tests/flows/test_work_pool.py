"""What a benchmark makes of what a server tells of its samples in the pool."""

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from uuid import UUID, uuid4

import httpx
import pytest
from prefect.client.schemas.filters import FlowRunFilter
from prefect.client.schemas.objects import FlowRun, State, Worker, WorkerStatus
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError
from prefect.states import Completed, Failed, Pending, Running

from dcap.language.protocol.session import Session
from dcap.scene.errors import DcapError
from dcap.scene.team_server import API_URL, OWN_URL
from dcap.scene.types.sample import Sample
from flows.elsewhere import SampleJob, Told, told_of
from flows.flow_runs import end_as_crashed
from flows.lost_server import is_missing, server_lost
from flows.place import PlaceConfig
from flows.run_names import WatchedRun
from flows.server import START_SECONDS
from flows.work_pool import CLOCK, LATE_SECONDS, WorkPool

PAGE = 2
"""What the server of these tests tells at a time."""
RUN = uuid4()
STARTED = datetime(2026, 1, 1, tzinfo=UTC)


class FewAtATime:
    """A server that tells two flow runs, or workers, at a time."""

    def __init__(
        self, runs: dict[UUID, State], unlisted: Sequence[UUID] = (), workers: Sequence[Worker] = (), tag: str = ""
    ) -> None:
        self.runs, self.unlisted, self.workers, self.tag = runs, unlisted, workers, tag

    def read_flow_runs(self, flow_run_filter: FlowRunFilter, offset: int = 0) -> list[FlowRun]:
        """A page of those that are wanted."""
        assert flow_run_filter.id is not None
        wanted = [one for one in flow_run_filter.id.any_ or () if one in self.runs and one not in self.unlisted]
        return [
            FlowRun(id=one, flow_id=uuid4(), state=self.runs[one], tags=[self.tag])
            for one in wanted[offset : offset + PAGE]
        ]

    def read_flow_run(self, run: UUID) -> FlowRun:
        """One of them."""
        if run not in self.runs:
            raise ObjectNotFound(KeyError(run))
        return FlowRun(id=run, flow_id=uuid4(), state=self.runs[run])

    def read_workers_for_work_pool(self, pool: str, offset: int = 0) -> Sequence[Worker]:
        """A page of those that have served the pool."""
        return self.workers[offset : offset + PAGE]


def worker(name: str, status: WorkerStatus = WorkerStatus.OFFLINE) -> Worker:
    """One whose last heartbeat is old."""
    return Worker(name=name, work_pool_id=uuid4(), status=status, last_heartbeat_time=STARTED)


def answer(status: int) -> PrefectHTTPStatusError:
    """What Prefect's client raises at an answer."""
    request = httpx.Request("GET", "http://127.0.0.1/api/health")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


def job(name: str) -> SampleJob:
    """A sample to place."""
    return SampleJob(Sample(name, "room", "mug", "put it there"), PlaceConfig(), Session(), WatchedRun("run", RUN))


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
def test_a_web_server_before_it_says_that_a_server_is_away(
    monkeypatch: pytest.MonkeyPatch, status: int, lost: bool
) -> None:
    """By its status; what the server itself refuses is no loss of it."""
    for name in (API_URL, OWN_URL):
        monkeypatch.setenv(name, "http://127.0.0.1:9/api")
    assert server_lost(answer(status)) is lost
    assert is_missing(answer(status)) is False


def test_a_team_s_server_without_its_database_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """It answers 500 to all that it is asked, as to its own mistakes."""
    monkeypatch.setenv(API_URL, "http://127.0.0.1:9/api")
    monkeypatch.delenv(OWN_URL, raising=False)
    assert server_lost(answer(500))
    assert not server_lost(answer(404))


class Clock:
    """A clock that goes on when it is told so."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 1000.0
        clocks = SimpleNamespace(
            clock_gettime=lambda clock: {CLOCK: self.now}[clock], monotonic=lambda: self.now, sleep=self.sleep
        )
        monkeypatch.setattr("flows.work_pool.time", clocks)

    def sleep(self, seconds: float) -> None:
        """Go on."""
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of the pool."""
    return Clock(monkeypatch)


def asked_again(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The samples that are asked for again from now on."""
    asked: list[str] = []
    monkeypatch.setattr(WorkPool, "ask", lambda pool, client, again: asked.append(again.sample.id))
    monkeypatch.setattr("flows.work_pool.end_as_crashed", lambda *_: None)
    return asked


def at_work(workers: Sequence[Worker], has_it: str) -> tuple[WorkPool, FewAtATime]:
    """A pool with one sample, which a worker has."""
    run, pool = uuid4(), WorkPool()
    pool.begun["a"] = 1
    pool.waiting = {run: job("a")}
    return pool, FewAtATime({run: Running()}, workers=workers, tag=f"worker:{has_it}")


def test_a_lost_worker_is_found_at_once_however_many_there_are(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """Where the server was there all the time; those that live come first, on another page."""
    asked = asked_again(monkeypatch)
    pool, server = at_work([*(worker(name, WorkerStatus.ONLINE) for name in "bcd"), worker("one")], "one")
    clock.sleep(1.0)
    assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    assert asked == ["a"]


def test_no_worker_counts_as_lost_for_an_outage(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """A long time between two looks, for whatever reason, may have been one: the silence of a worker says nothing for
    a while then."""
    asked = asked_again(monkeypatch)
    pool, server = at_work([worker("one")], "one")
    clock.sleep(45.0)
    while clock.now < 1000.0 + 45.0 + LATE_SECONDS - 11.0:
        assert list(pool.ended(server)) == []  # type: ignore[arg-type]
        assert asked == []
        clock.sleep(1.0)
    for _ in range(3):
        clock.sleep(1.0)
        assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    assert asked == ["a"]


def test_a_heartbeat_after_an_outage_ends_a_silence(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """The next silence begins with it."""
    asked = asked_again(monkeypatch)
    one = worker("one")
    pool, server = at_work([one], "one")
    for beat in range(5):
        one.last_heartbeat_time = STARTED + timedelta(seconds=beat)
        clock.sleep(LATE_SECONDS)
        for _ in range(100):
            assert list(pool.ended(server)) == []  # type: ignore[arg-type]
            clock.sleep(1.0)
    assert asked == []


def test_a_slow_server_hides_no_lost_worker(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """Each look takes half a minute, and the worker is found all the same."""
    asked = asked_again(monkeypatch)
    pool, server = at_work([worker("one")], "one")
    for _ in range(14):
        clock.sleep(30.0)
        assert list(pool.ended(server)) == []  # type: ignore[arg-type]
    assert asked == ["a"]


def test_a_sample_that_was_claimed_and_never_begins_is_asked_for_again(
    monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    """Its worker lives; an answer to it, or its word that nothing begins, was lost in an outage."""
    asked = asked_again(monkeypatch)
    pool, server = at_work([worker("one", WorkerStatus.ONLINE)], "one")
    server.runs = dict.fromkeys(server.runs, Pending())
    begin = clock.now
    while not asked:
        clock.sleep(1.0)
        assert list(pool.ended(server)) == []  # type: ignore[arg-type]
        assert clock.now < begin + 2.0 * START_SECONDS
    assert clock.now > begin + START_SECONDS


class TakesRuns(FewAtATime):
    """A server that takes flow runs, and is lost with some requests."""

    def __init__(self, lost: Sequence[int] = ()) -> None:
        super().__init__({})
        self.lost = lost
        self.requests = 0
        self.keys: list[tuple[str, str]] = []
        """Of what stands for a flow run, and of the run."""
        self.key_of: dict[UUID, str] = {}

    def read_deployment_by_name(self, name: str) -> SimpleNamespace:
        """The one there is."""
        return SimpleNamespace(id=uuid4())

    def create_task_run(self, task: object, parent: UUID, *, dynamic_key: str, **_: object) -> SimpleNamespace:
        """What stands for a run."""
        made = uuid4()
        self.key_of[made] = dynamic_key
        return SimpleNamespace(id=made)

    def create_flow_run_from_deployment(
        self, deployment: UUID, *, idempotency_key: str, parent_task_run_id: UUID, **_: object
    ) -> FlowRun:
        """A run that ends at once; the answer may be lost."""
        self.keys.append((self.key_of[parent_task_run_id], idempotency_key))
        self.requests += 1
        if self.requests in self.lost:
            raise httpx.ReadError("the answer is lost")
        run = uuid4()
        self.runs[run] = Completed()
        return FlowRun(id=run, flow_id=uuid4())


def test_a_sample_is_asked_for_once_where_the_server_is_lost_meanwhile() -> None:
    """An answer that is lost on its way is asked for by the same keys: one run, and one that stands for it."""
    pool, server = WorkPool(), TakesRuns(lost=[1])
    with pytest.raises(httpx.ReadError):
        pool.ask(server, job("a"))  # type: ignore[arg-type]
    pool.ask(server, job("a"))  # type: ignore[arg-type]
    assert server.keys == [server.keys[0]] * 2
    assert server.keys[0][0] == server.keys[0][1]
    assert (len(pool.waiting), pool.begun) == (1, {"a": 1})
    pool.ask(server, job("a"))  # type: ignore[arg-type]
    assert server.keys[2] != server.keys[0]


def test_a_server_that_is_lost_now_and_then_ends_no_benchmark(monkeypatch: pytest.MonkeyPatch, clock: Clock) -> None:
    """However often, as long as there is progress between."""
    server = TakesRuns(lost=range(3, 90, 3))
    monkeypatch.setattr("flows.work_pool.get_client", lambda **_: nullcontext(server))
    monkeypatch.setattr("flows.work_pool.wait_for_server", lambda: clock.sleep(START_SECONDS / 10.0))
    jobs = [job(f"{number}") for number in range(50)]
    told = [sample.id for some in WorkPool().placed(jobs, 1.0) for sample, _ in some]
    assert sorted(told, key=int) == [one.sample.id for one in jobs]


def test_what_is_known_is_told_before_a_lost_server_is_waited_for(
    monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    """And one that stays lost, though it says that it is well, ends the benchmark after as long as a start may take."""
    told: list[str] = []
    told_at_waits: list[list[str]] = []
    monkeypatch.setattr("flows.work_pool.get_client", lambda **_: nullcontext(FewAtATime({})))
    monkeypatch.setattr("flows.work_pool.wait_for_server", lambda: told_at_waits.append([*told]))
    monkeypatch.setattr("flows.work_pool.end_as_crashed", lambda *_: None)

    def ended(pool: WorkPool, client: object) -> Iterator[Told]:
        if not told_at_waits:
            yield job("a").sample, told_of("")
        raise httpx.ConnectError("away")

    monkeypatch.setattr(WorkPool, "ended", ended)
    pool = WorkPool()
    pool.waiting = {uuid4(): job("a"), uuid4(): job("b")}

    def go_on() -> None:
        for some in pool.placed([], 1.0):
            told.extend(sample.id for sample, _ in some)

    with pytest.raises(httpx.ConnectError):
        go_on()
    assert told_at_waits[0] == told == ["a"]
    assert START_SECONDS < clock.now - 1000.0 < START_SECONDS + 10.0


@pytest.mark.parametrize("what", ["pool", "deployment"])
def test_a_pool_that_somebody_deletes_is_told_in_a_line(what: str) -> None:
    """With what brings it back."""

    class Deleted(TakesRuns):
        def read_deployment_by_name(self, name: str) -> SimpleNamespace:
            raise ObjectNotFound(KeyError(name))

        def read_workers_for_work_pool(self, pool: str, offset: int = 0) -> Sequence[Worker]:
            raise answer(404)

    pool, server = WorkPool(), Deleted()
    pool.waiting = {uuid4(): job("b")}
    with pytest.raises(DcapError, match=r"somebody has deleted the pool 'dcap'.*start a worker"):
        list(pool.ended(server)) if what == "pool" else pool.ask(server, job("a"))  # type: ignore[arg-type]


def test_who_ends_runs_waits_once_for_a_server_that_is_away() -> None:
    """And not with each of them again; what it refuses of one run is passed over."""
    asked: list[str] = []

    class Away:
        def __init__(self, status: int) -> None:
            self.status = status

        def read_task_runs(self, **_: object) -> list[object]:
            asked.append("stages")
            raise answer(self.status)

        def set_flow_run_state(self, run: UUID, state: State, force: bool) -> None:
            asked.append("run")
            raise answer(self.status)

    runs = [uuid4() for _ in range(250)]
    with pytest.raises(PrefectHTTPStatusError):
        end_as_crashed(Away(503), runs, "why")  # type: ignore[arg-type]
    assert asked == ["stages"]
    asked.clear()
    end_as_crashed(Away(403), runs, "why")  # type: ignore[arg-type]
    assert asked == ["stages"] * 3 + ["run"] * 250
