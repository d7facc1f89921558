"""Programs that run at the same time share one server, the last one stops it, and it lets nobody wait."""

import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx
import pytest
from foreign_names import LIBRARIES, OURS, foreign_folder, marks

from dcap.scene.errors import DcapError, InputError, ServerGoneError
from dcap.scene.settings import PROJECT_ROOT, server_folder
from flows.display import Display
from flows.server import (
    DATABASES,
    LOG_END,
    START_SECONDS,
    check_port,
    free_port,
    is_healthy,
    is_server,
    launch,
    listened_to,
    prefect_server,
    say_whether,
    why_gone,
)
from flows.server_wait import wait_for_server
from flows.ui import serve_pages
from flows.worker import serve_pool
from perf.workflow import chain

OTHER = """
import sys
from flows.server import prefect_server
with prefect_server() as url:
    print(url, flush=True)
    sys.stdin.readline()
"""


@pytest.mark.slow
@pytest.mark.long
def test_the_last_user_stops_the_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second program uses the server of the first, keeps it when the first leaves, and stops it in the end."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    with prefect_server() as url:
        environment = {name: value for name, value in os.environ.items() if name != "PREFECT_API_URL"}
        other = subprocess.Popen(
            [sys.executable, "-c", OTHER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=PROJECT_ROOT,
            env=environment,
        )
        assert other.stdout is not None
        assert other.stdout.readline().strip() == url
        pid = int(json.loads((tmp_path / "cache" / "prefect" / "server.json").read_text())["pid"])
    assert is_healthy(url)
    other.communicate("\n", timeout=60)
    time.sleep(0.1)
    assert not is_healthy(url)
    assert not is_server(pid)
    assert not (tmp_path / "cache" / "prefect" / "server.json").exists()


@pytest.mark.slow
@pytest.mark.long
def test_a_server_takes_nothing_from_the_working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It starts in a folder with a prefect.py and others of such names, and runs none of them."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(foreign_folder(tmp_path, OURS + LIBRARIES))
    with prefect_server() as url:
        assert is_healthy(url)
    assert marks(tmp_path) == ""


@pytest.mark.slow
@pytest.mark.long
def test_a_program_turns_to_the_server_that_is_named_now(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a notebook whose first placement had a server of its own, and whose next one is to be on a team's."""
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with monkeypatch.context() as patch:
        patch.setenv("DCAP_DATA", str(tmp_path / "team"))
        with prefect_server() as named:
            from prefect.client.orchestration import get_client

            patch.delenv("PREFECT_API_URL")
            patch.setenv("DCAP_DATA", str(tmp_path / "own"))
            with prefect_server() as own, get_client(sync_client=True) as client:
                assert str(client.api_url).rstrip("/") == own != named
            patch.setenv("PREFECT_API_URL", named)
            with prefect_server() as url, get_client(sync_client=True) as client:
                assert str(client.api_url).rstrip("/") == url == named


@pytest.mark.slow
def test_nobody_is_told_to_ask_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A database that is locked would cost two seconds each time: while the events of earlier flow runs are being kept,
    and where a request reads something within what it writes, as of one that pauses a work queue."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    answers, send = list[int](), httpx.Client.send

    def noted(client: httpx.Client, request: httpx.Request, **how: Any) -> httpx.Response:
        response = send(client, request, **how)
        answers.append(response.status_code)
        return response

    monkeypatch.setattr(httpx.Client, "send", noted)
    with prefect_server() as url:
        from flows.flow_runs import FlowRunNames, flow_run

        with flow_run(FlowRunNames("all", "all", (), {})) as whole:
            assert whole.flow_run is not None
            for number in range(5):
                with flow_run(FlowRunNames("one", f"{number}", (), {}), whole.flow_run.id):
                    chain(number, 2)
        with httpx.Client(base_url=url, timeout=200.0) as client:
            client.post("/work_pools/", json={"name": "some", "type": "process"})
            queue = "/work_pools/some/queues/default"
            assert client.patch(queue, json={"is_paused": True}).status_code == 204
            assert client.get(queue).json()["status"] == "PAUSED"
    assert 201 in answers
    assert 503 not in answers


class SomePages(BaseHTTPRequestHandler):
    """Answers whatever is asked, as pages of an application do; like Prefect's server below /api, if that is wanted."""

    prefect = False

    def do_GET(self) -> None:
        """Any page."""
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"true" if self.prefect and self.path == "/api/health" else b"<html></html>")

    def log_message(self, *words: object) -> None:
        """Say nothing."""


@pytest.mark.parametrize(
    ("prefect", "said"),
    [(False, "no server of Prefect answers there"), (True, "the address of Prefect's server ends in /api: http://127")],
)
def test_an_address_that_is_no_servers(prefect: bool, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is refused in a line before anything is sent there, also where something else answers."""
    monkeypatch.setattr(SomePages, "prefect", prefect)
    with ThreadingHTTPServer(("127.0.0.1", 0), SomePages) as pages:
        threading.Thread(target=pages.serve_forever, daemon=True).start()
        monkeypatch.setenv("PREFECT_API_URL", f"http://127.0.0.1:{pages.server_port}")
        with pytest.raises(DcapError, match=said), prefect_server():
            raise AssertionError
        pages.shutdown()


@pytest.mark.parametrize(
    "url",
    [
        "http://team:of-ours@127.0.0.1/api",
        "http://team:a/of-ours@127.0.0.1/api",
        "http://team:9/of-ours@127.0.0.1/api",
        "team:of-ours@127.0.0.1/api",
        "http:/team:of-ours@127.0.0.1/api",
        "http://team:of-ours?x@127.0.0.1/api",
        "http://127.0.0.1:{port}/api",
        "127.0.0.1:{port}",
        "?",
        "http://[::1/api",
    ],
)
def test_what_speaks_otherwise_is_no_server(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An address that is none, or a port where another protocol is spoken: one line, which says no password."""
    with socket.create_server(("127.0.0.1", 0)) as other:

        def greet() -> None:
            with suppress(OSError):
                while True:
                    with other.accept()[0] as one:
                        one.sendall(b"SSH-2.0-Some\r\n")

        threading.Thread(target=greet, daemon=True).start()
        monkeypatch.setenv("PREFECT_API_URL", url.format(port=other.getsockname()[1]))
        with pytest.raises(DcapError) as told, prefect_server():
            raise AssertionError
        assert "\n" not in str(told.value)
        assert "of-ours" not in str(told.value)
        assert ("log-in" in str(told.value)) is ("@" in url)


def test_a_server_of_a_team_that_is_gone_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By its address, without who signs in there; our own log says nothing of it, nor need our own folder be there."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setenv("PREFECT_API_URL", "http://team:of-ours@127.0.0.1:1/api")
    monkeypatch.setattr("flows.server_wait.START_SECONDS", 0.0)
    monkeypatch.setattr("flows.server_wait.GIVEN_UP", {})
    with pytest.raises(DcapError) as told:
        wait_for_server()
    assert str(told.value) == (
        "the Prefect server http://***@127.0.0.1:1/api is gone; PREFECT_API_URL names it: see there, or unset the "
        "variable"
    )
    with pytest.raises(DcapError, match=r"^PREFECT_API_URL=http://\*\*\*@127\.0\.0\.1:1/api: .* log-in"):
        prefect_server().__enter__()


def test_nobody_is_shown_who_signs_in_at_a_server(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Neither by a benchmark, nor by the pages, nor by a worker."""
    url = "http://team:of-ours@127.0.0.1:1/api"
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    monkeypatch.setenv("PREFECT_API_URL", url)
    monkeypatch.setattr("flows.server.is_healthy", lambda asked: True)
    monkeypatch.setattr("flows.worker.module_command", lambda *words: ["sleep", "60"])
    monkeypatch.setattr("flows.work_pool.register", lambda: None)
    monkeypatch.setattr("signal.pause", lambda: None)
    Display([]).serving(url)
    told = [capsys.readouterr().err]
    with prefect_server():
        assert server_folder().is_dir()  # Prefect's home, of which it would warn
    serve_pages(4200, told.append)
    with pytest.raises(InterruptedError):
        serve_pool(1, lambda line: interrupted(told, line))
    assert len(told) == 3
    for line in told:
        assert "http://***@127.0.0.1:1" in line
        assert "of-ours" not in line


def interrupted(told: list[str], line: str) -> None:
    """Somebody ends the program as soon as a line is said."""
    told.append(line)
    raise InterruptedError


def test_why_a_server_is_gone_is_told_by_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last words, and the setting of its database where that is another's."""
    for one in ("PREFECT_API_URL", *DATABASES):
        monkeypatch.delenv(one, raising=False)
    log = tmp_path / "server.log"
    assert why_gone(tmp_path) == f"its log is {log}"
    log.write_text("Traceback (most recent call last):\n  File x\nArgumentError: no such database\n\nIt has stopped.\n")
    assert why_gone(tmp_path) == f"its last words are: ArgumentError: no such database; its log is {log}"
    monkeypatch.setenv(DATABASES[0], "nonsense")
    assert why_gone(tmp_path).startswith(f"its database is what {DATABASES[0]} names; its last words are: Arg")
    log.write_text("x" * 10_000)
    assert len(why_gone(tmp_path)) < 1000
    log.write_text(f"refused postgresql+asyncpg://team:of-ours-123@db.example/prefect {'x' * 265}")
    assert "123@" not in why_gone(tmp_path)
    log.write_text("x" * 99 + f" postgresql+asyncpg://team:of-ours-123@db.example/prefect {'x' * (LOG_END - 34)}")
    assert "123@" not in why_gone(tmp_path)


def test_an_address_of_another_machine_is_no_port(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another port would not help."""
    with pytest.raises(InputError, match=r"PREFECT_SERVER_API_HOST=192\.0\.2\.7: this machine has no such address"):
        check_port(free_port(), "192.0.2.7")


def test_a_server_of_a_team_that_is_away_is_told_once(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One look that is missed says nothing; nor does a server that is there."""
    looks, done = iter([False, True, False, False, False, True, True]), threading.Event()

    def ready(_: str) -> bool:
        found = next(looks, None)
        if found is None:
            done.set()
        return found is not False

    monkeypatch.setattr("flows.server.is_ready", ready)
    monkeypatch.setattr("flows.server.LISTEN_SECONDS", 0.001)
    url = "http://team:of-ours@127.0.0.1:1/api"
    with listened_to(url, partial(say_whether, url)):
        assert done.wait(60.0)
    assert capsys.readouterr().err.splitlines() == [
        "the Prefect server http://***@127.0.0.1:1/api does not answer; it is waited for",
        "the Prefect server http://***@127.0.0.1:1/api answers again",
    ]


def test_nobody_waits_soon_where_somebody_has_waited_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    """All threads of a benchmark end with the first; who comes later, or has nothing better to do, waits again."""
    clock = [1000.0]
    looks: list[bool] = []
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    monkeypatch.setattr("flows.server_wait.GIVEN_UP", {})
    monkeypatch.setattr("flows.server_wait.is_ready", lambda url: bool(looks) and looks.pop(0))
    clocks = SimpleNamespace(monotonic=lambda: clock[0], sleep=lambda _: clock.append(clock.pop() + 1.0))
    monkeypatch.setattr("flows.server_wait.time", clocks)

    def gives_up() -> float:
        begin = clock[0]
        with pytest.raises(ServerGoneError):
            wait_for_server()
        return clock[0] - begin

    assert gives_up() > START_SECONDS
    assert gives_up() == 0.0
    looks[:] = [False, True]
    wait_for_server(math.inf)
    looks[:] = [False, True]
    wait_for_server()  # it was there since
    assert gives_up() > START_SECONDS
    clock[0] += 2.0 * START_SECONDS
    assert gives_up() > START_SECONDS


@pytest.mark.parametrize("name", DATABASES)
def test_a_server_keeps_its_runs_where_it_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """By either name of Prefect's setting; a file in its folder is the database only where none is named."""
    given: list[dict[str, str]] = []
    monkeypatch.setattr("subprocess.Popen", lambda command, *, env, **_: given.append(env))
    for one in DATABASES:
        monkeypatch.delenv(one, raising=False)
    launch(tmp_path, "127.0.0.1", 1)
    monkeypatch.setenv(name, "postgresql+asyncpg://db.example/prefect")
    launch(tmp_path, "127.0.0.1", 1)
    files, named = ([env[one] for one in DATABASES if one in env] for env in given)
    assert files == [f"sqlite+aiosqlite:///{tmp_path / 'prefect.db'}"]
    assert named == ["postgresql+asyncpg://db.example/prefect"]
