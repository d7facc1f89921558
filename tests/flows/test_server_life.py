"""The local server comes back when it dies under a run, and goes when nobody needs it."""

import base64
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import patience
import pytest
from fake_benchmark import end, fake_benchmark
from foreign_names import LIBRARIES, OURS, foreign_folder, marks
from prefect_pages import PrefectPages
from process_trees import descendants

from dcap.packages import module_command
from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT, server_folder
from flows.interrupts import PutOff
from flows.programs import Program
from flows.server import free_port, is_healthy, is_server, known, known_pid, prefect_server, server_host

PATIENCE = 240.0
"""For machines that are busy [s]."""
PROMPT_SECONDS = 10.0
"""An interrupted run ends in about two on an idle machine; it took 16 when it waited for its threads."""


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder of the test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "data"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    return tmp_path


wait_until = partial(patience.wait_until, seconds=PATIENCE, every=0.05)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_server_that_dies_is_started_again_and_no_sample_is_lost(data: Path) -> None:
    """Killed while a sample is placed, it is there again at the same address with all runs, and the benchmark ends as
    if nothing had happened."""
    (data / "busy").touch()
    run = fake_benchmark(data, ["put the ball on the slow table", "put the ball on the table"])
    try:
        wait_until((data / "begun").exists)
        folder = server_folder()
        before = known(folder)
        os.killpg(known_pid(folder), signal.SIGKILL)
        wait_until(lambda: known(folder).get("pid") not in (None, before["pid"]) and is_healthy(str(before["url"])))
        assert known(folder)["url"] == before["url"]
        (data / "busy").unlink()
        out, err = run.communicate(timeout=PATIENCE)
    finally:
        end(run)
    assert run.returncode == 0, err
    counts = json.loads(out)
    assert (counts["samples"], counts["at_rest"], counts["failed"]) == (2, 2, 0)
    with prefect_server() as url:
        pages = PrefectPages(url)
        parent = next(one for one in pages.flow_runs() if one["name"] == Path(counts["run"]).name)
        assert parent["state_type"] == "COMPLETED"
        ended: dict[str, set[object]] = {}
        for child in pages.flow_runs(str(parent["id"])):
            ended.setdefault(str(child["name"]), set()).add(child["state_name"])
        assert len(ended) == 2
        assert all("Completed" in states and states <= {"Completed", "Crashed"} for states in ended.values())


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("where", ["slow", "slow heavy"], ids=["thread", "process"])
@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM], ids=lambda kind: kind.name)
def test_an_interrupted_benchmark_ends_at_once(data: Path, kind: signal.Signals, where: str) -> None:
    """Although a stage computes, in a thread or a process of its own; no process stays, and its runs are shown as
    crashed with the stages that were at work: none has failed, and none seems to go on."""
    (data / "busy").touch()
    run = fake_benchmark(data, [f"put the ball on the {where} table"])
    try:
        wait_until((data / "begun").exists)
        folder = server_folder()
        server, children, pages = known_pid(folder), descendants(run.pid), PrefectPages(str(known(folder)["url"]))
        assert server
        (child,) = pages.flow_runs(str(pages.flow_runs()[0]["id"]))

        def at_work() -> bool:
            states = stage_states(pages, child["id"])
            return states.pop("intent s0", None) == "RUNNING" and {*states.values()} == {"COMPLETED"}

        wait_until(at_work)  # the server hears of what begins a little later
        begin = time.monotonic()
        os.kill(run.pid, kind)
        run.wait(PATIENCE)
        took = time.monotonic() - begin
    finally:
        end(run)
    assert run.returncode == 130
    assert took < PROMPT_SECONDS
    wait_until(lambda: not is_server(server), seconds=PROMPT_SECONDS)
    wait_until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in children), seconds=PROMPT_SECONDS)
    (data / "busy").unlink()
    with prefect_server() as url:
        pages = PrefectPages(url)
        parent = pages.flow_runs()[0]
        assert parent["state_type"] == "CRASHED"
        (child,) = pages.flow_runs(str(parent["id"]))
        assert child["state_type"] == "CRASHED"
        states = stage_states(pages, child["id"])
        assert states["intent s0"] == "CRASHED", states
        assert {*states.values()} == {"COMPLETED", "CRASHED"}
        assert [one["state_type"] for one in pages.task_runs(parent["id"])] == ["CRASHED"]


@pytest.mark.slow
@pytest.mark.long
def test_all_samples_of_an_interrupted_benchmark_are_shown_as_crashed(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However few of those at work the server tells at a time."""
    monkeypatch.setenv("PREFECT_SERVER_API_DEFAULT_LIMIT", "2")
    with prefect_server():
        from prefect import Flow
        from prefect.client.orchestration import get_client

        from flows.benchmark_flow import benchmark_run
        from flows.flow_runs import PLACE, FlowRunNames, created, the_block

        with benchmark_run(data, [], {}) as watch, get_client(sync_client=True) as client:
            names = [FlowRunNames(PLACE, f"{number}", (), {}) for number in range(5)]
            children = [created(client, Flow(the_block, name=PLACE), one, watch.run.id).id for one in names]
            watch.interrupted()
            assert {client.read_flow_run(one).state_type for one in children} == {"CRASHED"}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_flow_runs_of_a_killed_program_end_as_crashed_with_the_next_run(
    data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The next run says so in a line of them, and of no other: neither of one that goes on nor of one elsewhere; of all
    of them, however few the server tells at a time."""
    monkeypatch.setenv("PREFECT_SERVER_API_DEFAULT_LIMIT", "2")
    (data / "busy").touch()
    with prefect_server() as url:
        pages = PrefectPages(url)
        killed = fake_benchmark(data, ["put the ball on the slow table"])
        try:
            wait_until((data / "begun").exists)
            parent = pages.flow_runs()[0]
            (child,) = pages.flow_runs(str(parent["id"]))
            wait_until(lambda: at_intent(pages, child["id"]) == ["RUNNING"])  # the server hears of it a little later
            os.killpg(killed.pid, signal.SIGKILL)
        finally:
            end(killed)
        states = [pages.get(f"/flow_runs/{one['id']}")["state_type"] for one in (parent, child)]
        assert states == ["RUNNING", "RUNNING"]
        program = parent["context"]["program"]  # type: ignore[index]
        others = [
            waiting(url, program | {"host": "elsewhere"}),
            waiting(url, Program.this().to_json()),
            waiting(url, None),
        ]
        (data / "busy").unlink()
        run = fake_benchmark(data, ["put the ball on the slow table"])
        try:
            _, err = run.communicate(timeout=PATIENCE)
        finally:
            end(run)
        assert run.returncode == 0, err
        for one in (parent, child):
            state = pages.get(f"/flow_runs/{one['id']}")["state"]
            assert state["type"] == "CRASHED"  # type: ignore[index]
            assert state["message"] == f"its program, process {killed.pid} of {program['host']}, is gone"  # type: ignore[index]
        assert at_intent(pages, child["id"]) == ["CRASHED"]
        assert {pages.get(f"/flow_runs/{one}")["state_type"] for one in others} == {"RUNNING"}
        newest = pages.flow_runs()[0]
        assert newest["state_type"] == "COMPLETED"


def stage_states(pages: PrefectPages, flow_run: object) -> dict[str, object]:
    """How the stages of a sample stand, by their names."""
    return {str(one["name"]): one["state_type"] for one in pages.task_runs(flow_run)}


def at_intent(pages: PrefectPages, child: object) -> list[object]:
    """How the stage of a sample stands that was at work."""
    wanted = {"flow_runs": {"id": {"any_": [child]}}, "task_runs": {"name": {"any_": ["intent s0"]}}}
    return [run["state_type"] for run in pages.post("/task_runs/filter", **wanted)]


def waiting(url: str, program: object) -> str:
    """A flow run at work that belongs to a program, or that says nothing of one; its id."""
    flow = posted(f"{url}/flows/", {"name": "benchmark"})["id"]
    context = {} if program is None else {"program": program}
    run = posted(f"{url}/flow_runs/", {"flow_id": flow, "context": context, "state": {"type": "RUNNING"}})
    return str(run["id"])


def posted(url: str, tree: object, **headers: str) -> dict[str, object]:
    """What a server answers to a request that makes something."""
    request = Request(url, json.dumps(tree).encode(), {"content-type": "application/json", **headers})
    with urlopen(request, timeout=30) as answer:
        return dict(json.load(answer))


STARTING = """
from flows.server import prefect_server
with prefect_server():
    pass
"""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_server_does_not_outlive_who_was_killed_while_it_started(data: Path) -> None:
    """The program is killed as soon as the process of its server is there; that one ends itself."""
    program = subprocess.Popen([sys.executable, "-c", STARTING], cwd=PROJECT_ROOT)
    wait_until(lambda: is_server(known_pid(server_folder())))
    server = known_pid(server_folder())
    program.kill()
    program.wait()
    wait_until(lambda: not is_server(server))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_the_pages_are_on_the_promised_port(data: Path) -> None:
    """`dcap ui` joins the server of whoever runs, on the port that it was asked for; what the pages call is there too;
    in a folder of foreign files that bear our names, none is run."""
    port = free_port()
    with prefect_server() as url:
        folder = foreign_folder(data, OURS + LIBRARIES)
        with pages_on(port, folder) as said:
            assert said.startswith(f"http://127.0.0.1:{port} ")
            assert is_healthy(f"http://127.0.0.1:{port}/api")
            with urlopen(f"http://127.0.0.1:{port}/ui-settings", timeout=10) as answer:
                assert json.load(answer)["api_url"] == "/api"
            there, here = PrefectPages(url), PrefectPages(f"http://127.0.0.1:{port}/api")
            assert here.flow_runs() == there.flow_runs()
            second = subprocess.run(
                ui_command(port), cwd=folder, env=without_url(), capture_output=True, text=True, check=False
            )
            assert second.returncode == 2
            assert f"port {port} " in second.stderr
            assert "--port" in second.stderr
            assert len(second.stderr.splitlines()) == 1
    assert marks(folder) == ""


@pytest.mark.slow
def test_a_server_refuses_what_pages_of_others_ask(data: Path) -> None:
    """A name that leads to this machine is none of its own; its pages and programs are answered."""
    with prefect_server() as url:
        asked = f"{url}/flows/"
        assert posted(asked, {"name": "ours"}, Origin=url.removesuffix("/api"))["name"] == "ours"
        port = url.rpartition(":")[2]
        for headers in ({"Origin": "https://evil.example"}, {"Host": f"evil.example:{port}"}):
            with pytest.raises(HTTPError) as caught:
                posted(asked, {"name": "theirs"}, **headers)
            assert caught.value.code == 403
            assert "PREFECT_SERVER_CORS_ALLOWED_ORIGINS" in caught.value.read().decode()
        assert {one["name"] for one in PrefectPages(url).post("/flows/filter")} == {"ours"}


def test_a_server_for_others_asks_who_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """None is started without: the line names the setting."""
    for host in ("0.0.0.0", "::", "192.0.2.7"):
        monkeypatch.setenv("PREFECT_SERVER_API_HOST", host)
        with pytest.raises(
            InputError, match=rf"PREFECT_SERVER_API_HOST={host}: .* set PREFECT_SERVER_API_AUTH_STRING="
        ) as told:
            prefect_server().__enter__()
        assert "\n" not in str(told.value)
    for login in ("team", ":of-ours", "team:"):
        monkeypatch.setenv("PREFECT_SERVER_API_AUTH_STRING", login)
        with pytest.raises(InputError, match="PREFECT_SERVER_API_AUTH_STRING=NAME:PASSWORD"):
            server_host()
    monkeypatch.delenv("PREFECT_SERVER_API_AUTH_STRING")
    assert not server_folder().exists()
    for host in ("127.0.0.1", "localhost", ""):
        monkeypatch.setenv("PREFECT_SERVER_API_HOST", host)
        assert server_host() == (host or "127.0.0.1")


@pytest.mark.slow
@pytest.mark.long
def test_a_server_for_others_is_told_who_asks(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its own program says so by itself; who does not is refused."""
    monkeypatch.setenv("PREFECT_SERVER_API_HOST", "0.0.0.0")
    monkeypatch.setenv("PREFECT_SERVER_API_AUTH_STRING", "team:of-ours")
    monkeypatch.setenv("PREFECT_API_AUTH_STRING", "")
    monkeypatch.delenv("PREFECT_API_AUTH_STRING")
    with prefect_server() as url:
        assert url.startswith("http://127.0.0.1:")
        known = base64.b64encode(b"team:of-ours").decode()
        assert posted(f"{url}/flows/", {"name": "ours"}, Authorization=f"Basic {known}")["name"] == "ours"
        with pytest.raises(HTTPError) as caught:
            posted(f"{url}/flows/", {"name": "theirs"})
        assert caught.value.code == 401
        from flows.flow_runs import FlowRunNames, flow_run

        with flow_run(FlowRunNames("ours", "ours", (), {})) as engine:
            assert isinstance(signal.getsignal(signal.SIGTERM), PutOff)  # Prefect's own would raise within imports
        assert engine.state.is_completed()


def ui_command(port: int) -> list[str]:
    """`dcap ui` on a port."""
    return module_command("flows.cli", "ui", "--port", str(port))


def without_url() -> dict[str, str]:
    """The environment of somebody who knows no server."""
    return {name: value for name, value in os.environ.items() if name != "PREFECT_API_URL"}


@contextmanager
def pages_on(port: int, folder: Path) -> Iterator[str]:
    """`dcap ui` in a process of its own, and the line that it said."""
    process = subprocess.Popen(ui_command(port), cwd=folder, stdout=subprocess.PIPE, text=True, env=without_url())
    try:
        assert process.stdout is not None
        yield process.stdout.readline()
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=PATIENCE)
