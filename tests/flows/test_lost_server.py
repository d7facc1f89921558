"""The server only watches: what it does not answer, or refuses, costs no sample and hangs nothing."""

import ctypes
import fcntl
import json
import os
import sys
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import httpx
import pytest
import small_stages
from prefect.client.schemas.objects import State, StateType, WorkerStatus
from prefect.exceptions import ObjectNotFound
from prefect.settings import PREFECT_CLIENT_MAX_RETRIES
from prefect.states import Completed

from dcap.scene.errors import DcapError
from dcap.scene.settings import server_folder
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import Sample
from flows import pool, server, watched
from flows.place import PlaceConfig
from tasks.artifact import Ref, Store
from tasks.cache import SIMULATIONS, stage
from tasks.machine_errors import is_lost_server, pass_over_server_errors
from tasks.run_context import RunContext, use_context


def answered(status: int) -> httpx.HTTPStatusError:
    """What a client raises for an answer."""
    return httpx.HTTPStatusError("it says", request=httpx.Request("GET", "http://a"), response=httpx.Response(status))


def answer(error: Exception) -> None:
    """Answer with an error."""
    raise error


UNREACHED = httpx.ConnectError("refused")
LOST = (UNREACHED, httpx.ReadTimeout("late"), answered(503), RuntimeError("Failed to reach API at http://a"),
        RuntimeError("Retry handling ended before a response"))  # fmt: skip
REFUSED = (answered(404), answered(409), ObjectNotFound(answered(404)))


def test_a_refusal_is_no_lost_server() -> None:
    """One is lost that does not answer, or fails; both are passed over, and no other error is."""
    for error in (*LOST, *REFUSED):
        with pass_over_server_errors() as lost:
            answer(error)
        assert lost == [error] * (error in LOST), error
        assert is_lost_server(error) is (error in LOST)
    with pytest.raises(ValueError, match="ours"), pass_over_server_errors():
        answer(ValueError("ours"))


@pytest.mark.parametrize("when", ["asked", "told"])
def test_a_limit_holds_while_its_server_is_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, when: str) -> None:
    """The stage runs all the same where the server is gone when a slot is asked for, or given back."""

    @contextmanager
    def slot(name: str) -> Iterator[None]:
        if when == "asked":
            raise UNREACHED
        yield
        raise UNREACHED

    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setattr("prefect.concurrency.sync.concurrency", slot)
    simulating = stage(small_stages.slow, simulates=True)
    with use_context(RunContext(limits=frozenset({SIMULATIONS}))):
        ref: Ref[Mesh] = simulating(4)
    assert isinstance(Store.default().load(ref), Mesh)


class Answering:
    """A client whose server answers each time with an error."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def __enter__(self) -> "Answering":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is open."""

    def read_flow_run(self, _: object) -> Any:
        """Answer."""
        raise self.error

    def update_flow_run(self, *_: object, **__: object) -> None:
        """Answer."""
        raise self.error


def test_nobody_waits_for_a_sample_that_nobody_tells_of(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its flow run was deleted, or the server is gone for long."""
    monkeypatch.setattr(pool, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(pool, "LOST_SECONDS", 0.1)
    for error, words in ((REFUSED[2], "deleted"), (UNREACHED, "server was lost")):
        monkeypatch.setattr(pool, "get_client", lambda sync_client, error=error: Answering(error))
        with pytest.raises(DcapError, match=words):
            pool._final_state(uuid4())


class OfferingPool:
    """A client of a pool with one flow run, and workers of some names that answer."""

    def __init__(self, state: StateType, tags: list[str], online: list[str], looks: int) -> None:
        self.run = SimpleNamespace(tags=tags, state=State(type=state))
        self.workers = [SimpleNamespace(name=name, status=WorkerStatus.ONLINE) for name in online]
        self.looks = looks

    def __enter__(self) -> "OfferingPool":
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing is open."""

    def read_flow_run(self, _: object) -> Any:
        """The run, which is completed after some looks."""
        self.looks -= 1
        if not self.looks:
            self.run.state = Completed()
        return self.run

    def read_workers_for_work_pool(self, _: str) -> Any:
        """Those that answer."""
        return self.workers

    def set_flow_run_state(self, _: object, state: Any, force: bool) -> None:
        """Take it."""
        self.run.state = state


@pytest.mark.parametrize(
    ("state", "told", "online", "lost"),
    [
        (StateType.SCHEDULED, "", [], False),  # nobody has begun it: a worker may still come
        (StateType.PENDING, "", ["far-1-aa"], True),  # lost before it told which worker it has
        (StateType.RUNNING, "", [], True),
        (StateType.RUNNING, "far-1-aa", ["far-1-aa"], False),
        (StateType.RUNNING, "far-1-aa", ["far-1-bb", "far-1-aa-1-cc"], True),  # started again; a name that begins alike
    ],
)
def test_a_sample_is_given_up_with_its_own_worker(
    monkeypatch: pytest.MonkeyPatch, state: StateType, told: str, online: list[str], lost: bool
) -> None:
    """And not while that worker answers, nor before anybody has begun it."""
    monkeypatch.setattr(pool, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(pool, "LOST_SECONDS", 0.1)
    client = OfferingPool(state, [f"process:{told}:1"] * bool(told), online, 40)
    monkeypatch.setattr(pool, "get_client", lambda sync_client: client)
    if lost:
        with pytest.raises(pool.LostWorkerError):
            pool._final_state(uuid4())
        assert client.run.state.is_crashed()
    else:
        assert pool._final_state(uuid4()).is_completed()


def test_a_refusal_at_the_end_loses_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where somebody has deleted the flow run meanwhile; an error of the work itself is raised."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setattr(watched, "claimed_run", lambda: nullcontext(tmp_path / "claim"))
    monkeypatch.setattr(watched, "flow_run", SimpleNamespace(id=str(uuid4())))
    monkeypatch.setattr(watched, "get_client", lambda sync_client: Answering(UNREACHED))
    lost: list[bool] = []
    monkeypatch.setattr(watched, "give_up_server", lambda: lost.append(True))
    monkeypatch.setattr(watched, "was_given_up", lambda: bool(lost))

    def shown(error: Exception) -> Any:
        def run(return_state: bool) -> None:
            watched.do_work()
            raise error

        return run

    for error in (*REFUSED, *LOST):
        said: list[str] = []
        lost.clear()
        watched.in_flow(shown(error), (), lambda: ("Completed", ""), said.append)
        assert said == [watched.LOST] * (error in LOST), error

    def fail() -> tuple[str, str]:
        raise ValueError("ours")

    with pytest.raises(ValueError, match="ours"):
        watched.in_flow(shown(UNREACHED), (), fail, print)


def test_a_claim_holds_until_the_run_has_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else another program would tell the server that this one has crashed."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    run = uuid4()
    monkeypatch.setattr(watched, "flow_run", SimpleNamespace(id=str(run)))
    monkeypatch.setattr(watched, "get_client", lambda sync_client: Answering(UNREACHED))
    claim = server_folder() / "running" / str(run)

    def is_held() -> bool:
        with claim.open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
        return False

    held: list[bool] = []
    foreign = claim.with_name("notes.txt")
    foreign.parent.mkdir(parents=True)
    foreign.write_text("somebody else's")

    def shown(return_state: bool) -> None:
        watched.do_work()
        held.append(is_held())  # here Prefect tells the server how it ended

    watched.in_flow(shown, (), lambda: ("Completed", ""), print)
    assert held == [True]
    assert not claim.exists()
    assert foreign.exists()


def test_a_slow_server_is_not_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is there as long as its keeper is, whether it answers in time or not."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    url = "http://127.0.0.1:9/api"
    monkeypatch.setenv("DCAP_OWN_SERVER", url)
    assert server.own_server_has_ended()
    server_folder().mkdir(parents=True)
    (server_folder() / server.ADDRESS).write_text(json.dumps({"url": url}))
    with (server_folder() / server.SERVING).open("w") as keeper:
        fcntl.flock(keeper, fcntl.LOCK_EX)
        assert not server.own_server_has_ended()
    assert server.own_server_has_ended()


def test_the_users_patience_is_that_of_the_next_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a person has set is in force again when another server is used."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_CLIENT_MAX_RETRIES", "7")
    server.give_up_server()
    server.give_up_server()
    assert (server.was_given_up(), os.environ["PREFECT_CLIENT_MAX_RETRIES"]) == (True, "0")
    assert PREFECT_CLIENT_MAX_RETRIES.value() == 0
    with server._as_own_server("http://127.0.0.1:9/api"):
        assert (server.was_given_up(), os.environ["PREFECT_CLIENT_MAX_RETRIES"]) == (False, "7")
        assert PREFECT_CLIENT_MAX_RETRIES.value() == 7
        server.give_up_server()
    assert os.environ["PREFECT_CLIENT_MAX_RETRIES"] == "7"
    with server._as_own_server("http://127.0.0.1:9/api"):  # for the tests that follow
        assert not server.was_given_up()


def has_own_folder() -> bool:
    """Whether a thread may have a working directory of its own: on Linux, unless a container forbids it."""
    if sys.platform != "linux":
        return False
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(ctypes.CDLL(None).unshare, server.CLONE_FS).result() == 0


@pytest.mark.skipif(not has_own_folder(), reason="all threads have the same working directory")
def test_settings_are_read_in_a_folder_that_no_other_thread_sees(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The others place samples whose paths are relative to the working directory."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    before, asked, told, seen = os.getcwd(), threading.Event(), threading.Event(), list[str]()

    def refresh() -> None:
        asked.set()
        assert told.wait(10.0)
        seen.append(os.getcwd())

    def look() -> None:
        assert asked.wait(10.0)
        seen.append(os.getcwd())
        told.set()

    monkeypatch.setattr("prefect.context.refresh_global_settings_context", refresh)
    other = threading.Thread(target=look)
    other.start()
    server.apply_settings()
    other.join()
    assert seen == [before, str(server_folder())]


def test_a_slow_server_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody starts another one beside it; one that never answers is told."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setattr(server, "POLL_SECONDS", 0.01)
    answers = iter([False, False, True])
    monkeypatch.setattr(server, "is_healthy", lambda url: next(answers, False))
    url = "http://127.0.0.1:9/api"
    server_folder().mkdir(parents=True)
    assert server._wait_for_running(server_folder()) == ""
    (server_folder() / server.ADDRESS).write_text(json.dumps({"url": url}))
    with (server_folder() / server.SERVING).open("w") as keeper:
        fcntl.flock(keeper, fcntl.LOCK_EX)
        print(1234, file=keeper, flush=True)
        assert server._wait_for_running(server_folder()) == url
        monkeypatch.setattr(server, "START_SECONDS", 0.05)
        with pytest.raises(DcapError, match="does not answer; stop process 1234"):
            server._wait_for_running(server_folder())


def test_programs_wait_for_a_slow_server_at_the_same_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not one after the other, each for two minutes."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setattr(server, "is_healthy", lambda url: False)
    monkeypatch.setattr(server, "START_SECONDS", 0.05)
    server_folder().mkdir(parents=True)
    (server_folder() / server.ADDRESS).write_text(json.dumps({"url": "http://127.0.0.1:9/api"}))
    with (
        (server_folder() / server.SERVING).open("w") as keeper,
        (server_folder() / server.STARTING).open("w") as another,
    ):
        fcntl.flock(keeper, fcntl.LOCK_EX)
        fcntl.flock(another, fcntl.LOCK_EX)
        with pytest.raises(DcapError, match="does not answer"):
            server._joined_server(server.PORT, only_there=False)


def test_a_server_that_is_lost_at_the_beginning_costs_no_sample(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is placed without a flow run, and a line says so; what else goes wrong is raised."""
    monkeypatch.setattr(watched, "give_up_server", lambda: None)
    monkeypatch.setattr(watched, "run_sample", lambda *_: "placed")
    said: list[str] = []
    sample = Sample("one", "room", "ball", "put it")
    placed = partial(watched.place_in_flow, sample, PlaceConfig(), RunContext(), said.append)
    monkeypatch.setattr(watched, "in_flow", lambda *_: answer(UNREACHED))
    assert str(placed()) == "placed"
    assert said == [watched.LOST]
    monkeypatch.setattr(watched, "in_flow", lambda *_: answer(ValueError("ours")))
    with pytest.raises(ValueError, match="ours"):
        placed()


def test_a_server_is_named_until_the_last_thread_has_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first to end takes its address from no other."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    url = "http://127.0.0.1:9/api"
    first, second = server._as_own_server(url), server._as_own_server(url)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert os.environ["PREFECT_API_URL"] == url
    second.__exit__(None, None, None)
    assert "PREFECT_API_URL" not in os.environ


def test_a_named_server_that_is_gone_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A single placement does without it."""
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:9/api")
    said: list[str] = []
    with server.watching_server(said.append) as url:
        assert url == ""
    assert ["http://127.0.0.1:9" in line for line in said] == [True]


def test_pages_stay_while_their_server_is_slow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody waits for an answer of a server whose keeper lives: `dcap ui` would stop it by leaving."""
    url = "http://127.0.0.1:9/api"
    monkeypatch.setenv("DCAP_OWN_SERVER", url)
    monkeypatch.setattr(server, "LOOK_SECONDS", 0.0)
    ended = iter([False] * 5 + [True])
    monkeypatch.setattr(server, "own_server_has_ended", lambda: next(ended))
    server.wait_for_end(url)
    assert next(ended, None) is None
    monkeypatch.delenv("DCAP_OWN_SERVER")
    monkeypatch.setattr(server, "own_server_has_ended", lambda: False)
    server.wait_for_end(url)


def test_a_dead_run_waits_for_its_own_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another one does not know it, and would say so for ever."""
    monkeypatch.delenv("DCAP_OWN_SERVER", raising=False)
    monkeypatch.setattr(watched, "get_client", lambda sync_client: pytest.fail("nothing is asked"))
    claim = tmp_path / str(uuid4())
    claim.write_text("http://one.example/api")
    monkeypatch.setenv("PREFECT_API_URL", "http://another.example/api")
    watched.end_dead_runs(tmp_path)
    assert claim.is_file()
