"""Programs that run at the same time share one server, which the last one stops; a named one is used and left alone."""

import base64
import os
import socket
import subprocess
import sys
import threading
from contextlib import suppress
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import patience
import psutil
import pytest
from foreign_names import LIBRARIES, OURS, foreign_folder, marks
from ports import free_port

from dcap.packages import module_command
from dcap.scene.errors import DcapError, InputError
from dcap.scene.settings import PROJECT_ROOT, server_folder
from flows.cli.app import main
from flows.server import is_healthy, pages_of, prefect_server

PROGRAM = """
import sys
from flows.server import prefect_server
with prefect_server(int(sys.argv[1])) as url:
    print(url, flush=True)
    sys.stdin.readline()
"""
LOGIN = "team:of-ours"
wait_until = partial(patience.wait_until, seconds=60.0)


def program(folder: Path, data: Path, port: int) -> "subprocess.Popen[str]":
    """A program that uses a server until it is told to end; the first line it says is the server's address."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    return subprocess.Popen(
        [sys.executable, "-P", "-c", PROGRAM, str(port)],
        cwd=folder,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=plain | {"DCAP_DATA": str(data), "PYTHONPATH": str(PROJECT_ROOT)},
    )


def said(process: "subprocess.Popen[str]") -> str:
    """Its first line."""
    assert process.stdout is not None
    return process.stdout.readline().strip()


def posted(url: str, **headers: str) -> int:
    """How a server answers to a request of a page or program."""
    try:
        with urlopen(Request(f"{url}/flows/filter", b"{}", {"content-type": "application/json", **headers})) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code


@pytest.mark.slow
@pytest.mark.long
def test_the_last_user_stops_the_server(tmp_path: Path) -> None:
    """A second program uses the server of the first, keeps it when the first is killed, and stops it in the end. It
    takes nothing from the working directory."""
    folder, data = foreign_folder(tmp_path / "foreign", OURS + LIBRARIES), tmp_path / "data"
    port = free_port()  # servers of other tests may take the usual one once it is free again
    first = program(folder, data, port)
    url = said(first)
    second = program(folder, data, port)
    assert said(second) == url
    family = psutil.Process(first.pid).children(recursive=True)
    servers = [one for one in family if one.status() != psutil.STATUS_ZOMBIE and "server" in str(one.cmdline())]
    assert len(servers) == 2  # and its keeper
    first.kill()
    first.communicate()
    assert is_healthy(url)
    second.communicate("\n", timeout=60)
    wait_until(lambda: not is_healthy(url) and not any(one.is_running() for one in servers))
    assert marks(folder) == ""


@pytest.mark.slow
@pytest.mark.long
def test_the_pages_are_on_the_promised_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of `dcap ui`, which asks others who they are where they can reach it; a port that is taken is one line."""
    port = free_port()
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_SERVER_API_AUTH_STRING", LOGIN)
    monkeypatch.setenv("PREFECT_SERVER_API_HOST", "0.0.0.0")
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    with subprocess.Popen(
        module_command("flows.cli", "ui", "--port", str(port)), stdout=subprocess.PIPE, text=True
    ) as pages:
        try:
            assert f":{port} " in said(pages)
            known = {"Authorization": f"Basic {base64.b64encode(LOGIN.encode()).decode()}"}
            url = f"http://127.0.0.1:{port}/api"
            assert posted(url, **known) == 200
            assert posted(url) == 401
        finally:
            pages.terminate()
    wait_until(lambda: not is_healthy(f"http://127.0.0.1:{port}/api"))
    with socket.create_server(("0.0.0.0", port)):
        assert main(["ui", "--port", str(port)]) == 2
    assert f"port {port} " in capsys.readouterr().err


def test_a_server_for_others_asks_who_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """None is started without: the line names the setting."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    for host, login in (("0.0.0.0", ""), ("::", ""), ("192.0.2.7", "team"), ("192.0.2.7", ":x"), ("192.0.2.7", "x:")):
        monkeypatch.setenv("PREFECT_SERVER_API_HOST", host)
        monkeypatch.setenv("PREFECT_SERVER_API_AUTH_STRING", login)
        with pytest.raises(InputError, match="PREFECT_SERVER_API_AUTH_STRING=NAME:PASSWORD") as told:
            prefect_server().__enter__()
        assert "\n" not in str(told.value)


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


def refusal(url: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """The line that says why a server that is named cannot be used."""
    monkeypatch.setenv("PREFECT_API_URL", url)
    with pytest.raises(DcapError) as told:
        prefect_server().__enter__()
    assert "\n" not in str(told.value)
    assert "of-ours" not in str(told.value)
    return str(told.value)


def test_an_address_that_is_no_servers(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is refused in a line before anything is sent there, also where something else answers; no line says a
    password."""
    with ThreadingHTTPServer(("127.0.0.1", 0), SomePages) as pages:
        threading.Thread(target=pages.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{pages.server_port}"
        for prefect in (False, True):
            monkeypatch.setattr(SomePages, "prefect", prefect)
            assert (f"{url}/api" in refusal(url, monkeypatch)) is prefect
        pages.shutdown()
    with socket.create_server(("127.0.0.1", 0)) as other:

        def greet() -> None:
            with suppress(OSError):
                while True:
                    with other.accept()[0] as one:
                        one.sendall(b"SSH-2.0-Some\r\n")

        threading.Thread(target=greet, daemon=True).start()
        port = other.getsockname()[1]
        for url in (f"http://127.0.0.1:{port}/api", f"127.0.0.1:{port}", "?", "http://[::1/api"):
            assert "PREFECT_API_URL=" in refusal(url, monkeypatch)
    for url in (
        "http://team:of-ours@127.0.0.1/api", "http://team:a/of-ours@127.0.0.1/api", "team:of-ours@127.0.0.1/api",
        "http:/team:of-ours@127.0.0.1/api", "http://team:of-ours?x@127.0.0.1/api",
    ):  # fmt: skip
        assert "PREFECT_API_AUTH_STRING" in refusal(url, monkeypatch)
    assert pages_of("http://team:of-ours@127.0.0.1:1/api") == "http://***@127.0.0.1:1"


@pytest.mark.slow
def test_prefect_reads_no_settings_of_a_working_directory(server: str, tmp_path: Path) -> None:
    """A data set may come with an `.env` or `prefect.toml`, which could have it run a file; ours are in force, and what
    a person has set wins."""
    folder = foreign_folder(tmp_path, ())
    code = (
        "from flows.server import prefect_server\nwith prefect_server():\n    import prefect\n"
        "    from prefect.settings import get_current_settings as now\n    @prefect.flow\n    def one(): return 1\n"
        "    assert one() == 1\n    print(now().client.max_retries, now().server.analytics_enabled)\n"
    )
    own = {"DCAP_DATA": str(tmp_path / "data"), "PYTHONPATH": str(PROJECT_ROOT)}
    for given, told in (({}, "3 False\n"), ({"PREFECT_CLIENT_MAX_RETRIES": "2"}, "2 False\n")):
        done = subprocess.run(
            [sys.executable, "-P", "-c", code], cwd=folder, env=os.environ | own | given, capture_output=True, text=True
        )
        assert (done.returncode, done.stdout) == (0, told), done.stderr
    assert marks(folder) == ""


def test_a_proxy_is_not_asked_for_a_server_of_this_machine(server: str) -> None:
    """Many a company names one for everything else."""
    program = "from flows.server import prefect_server\nwith prefect_server(): import os; print(os.environ['no_proxy'])"
    others = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"}
    environment = others | {"PREFECT_API_URL": server, "http_proxy": "http://127.0.0.1:9", "NO_PROXY": "example.org"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, cwd=PROJECT_ROOT, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("example.org,localhost,127.0.0.1\n", "")


def test_a_program_turns_to_the_server_that_is_named_now(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a notebook that has used another one before; the environment is as before in the end."""
    from prefect.client.orchestration import get_client

    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    with prefect_server() as url, get_client(sync_client=True) as client:
        assert str(client.api_url).rstrip("/") == url == server
    assert os.environ["PREFECT_API_URL"] == server
    assert not (server_folder() / "server.json").exists()
