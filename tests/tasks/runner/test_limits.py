"""How many stages of a kind compute at a time on one server."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier, Lock
from time import sleep
from types import SimpleNamespace

import httpx
import pytest
from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError

from dcap.language.protocol.client import ClientName
from flows.place import PlaceConfig
from flows.server import prefect_server
from tasks.drop.stage import drop_task
from tasks.intent.stage import intent_task
from tasks.runner.limits import MODEL_CALLS, SIMULATIONS, is_limited, limit_on, set_limits, slot_of


class Inside:
    """Counts who is in a block at the same time."""

    def __init__(self) -> None:
        self.lock, self.now, self.most, self.times = Lock(), 0, 0, 0

    def stay(self, name: str) -> None:
        """Hold a slot for a while."""
        with slot_of(name):
            with self.lock:
                self.now += 1
                self.times += 1
                self.most = max(self.most, self.now)
            sleep(0.5)
            with self.lock:
                self.now -= 1


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", [SIMULATIONS, MODEL_CALLS])
def test_a_limit_bounds_whoever_computes_on_its_server(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also a run that does not know of it, and is told; without one, all compute at once."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with prefect_server(), ThreadPoolExecutor(3) as threads:

        def meet(together: Barrier) -> None:
            with slot_of(name):
                together.wait(60.0)

        list(threads.map(meet, [Barrier(3)] * 3))
        assert set_limits({name: 1}) == {}
        inside = Inside()
        list(threads.map(lambda _: inside.stay(name), range(3)))
        assert (inside.most, inside.times) == (1, 3)
        assert set_limits({name: 2}) == {}
        list(threads.map(meet, [Barrier(2)] * 2))
        assert set_limits({}) == {name: 2}
        assert is_limited(name)


class Limits:
    """A server that answers so for any limit."""

    def __init__(self, answer: SimpleNamespace | Exception) -> None:
        self.answer = answer

    def read_global_concurrency_limit_by_name(self, name: str) -> SimpleNamespace:
        """What it says of one."""
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def refused(status: int) -> PrefectHTTPStatusError:
    """How Prefect's client says that a request was refused."""
    request = httpx.Request("GET", "http://127.0.0.1/api/v2/concurrency_limits/one")
    return PrefectHTTPStatusError("no", request=request, response=httpx.Response(status, request=request))


@pytest.mark.parametrize(
    ("answer", "found"),
    [
        (SimpleNamespace(limit=3, active=True), 3),
        (SimpleNamespace(limit=3, active=False), None),
        (ObjectNotFound(KeyError("one")), None),
        (refused(403), None),
    ],
)
def test_a_limit_is_one_that_the_server_tells_us_and_keeps(
    answer: SimpleNamespace | Exception, found: int | None
) -> None:
    """Whom it tells nothing is bounded by nothing, at the start of a benchmark and in each stage alike."""
    assert limit_on(Limits(answer), SIMULATIONS) == found  # type: ignore[arg-type]


def test_a_server_that_breaks_is_no_server_without_limits() -> None:
    """What it should bound would run unbounded."""
    with pytest.raises(PrefectHTTPStatusError):
        limit_on(Limits(refused(500)), SIMULATIONS)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("client", "limit"),
    [(ClientName.OFFLINE, ""), (ClientName.ANTHROPIC, MODEL_CALLS), (ClientName.OPENAI, MODEL_CALLS)],
)
def test_what_asks_a_model_falls_under_the_limit_of_calls(client: ClientName, limit: str) -> None:
    """A reader of our own asks nobody; what simulates has its own limit, whoever reads the sentence."""
    config = PlaceConfig()
    language = config.intent.language.model_copy(update={"client": client})
    asking = config.intent.model_copy(update={"language": language})
    assert intent_task.limit(asking.model_dump(mode="json")) == limit
    assert drop_task.limit(config.drop.model_dump(mode="json")) == SIMULATIONS


def test_a_stage_outside_of_any_run_waits_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no server is named, none is asked, or started."""
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with slot_of(SIMULATIONS), slot_of(""):
        pass
