"""A server of ours answers requests that name it, from its own pages."""

import socket

import pytest
from starlette.applications import Starlette
from starlette.routing import WebSocketRoute
from starlette.testclient import TestClient
from starlette.websockets import WebSocket, WebSocketDisconnect

from flows.own_requests import LOOPBACK, POLICY, OwnRequests, OwnRequestsOnly

LOCAL = OwnRequests.to(LOOPBACK)


@pytest.mark.parametrize(
    ("host", "origins"),
    [
        ("127.0.0.1:8080", []),
        ("localhost:8080", ["http://localhost:8080"]),
        ("LOCALHOST:8080", ["http://localhost:8080"]),
        ("[::1]:8080", ["http://[::1]:8080"]),
        ("localhost:9000", ["http://localhost:9000"]),  # another port that leads here, as those of ssh -L
        ("127.0.0.1", ["http://127.0.0.1"]),
    ],
)
def test_its_own_pages_are_answered(host: str, origins: list[str]) -> None:
    """By any name of the loopback; programs that are no browsers say no origin."""
    assert LOCAL.refusal([host], origins) == ""


@pytest.mark.parametrize(
    ("hosts", "origins"),
    [
        (["localhost:8080"], ["http://evil.example"]),
        (["localhost:8080"], ["http://localhost:3000"]),  # another page of this machine
        (["localhost:8080"], ["http://127.0.0.1:8080"]),
        (["localhost:8080"], ["null"]),
        (["localhost:8080"], [""]),
        (["localhost:8080"], ["http://localhost:8080", "http://evil.example"]),
        (["evil.example:8080"], ["http://evil.example:8080"]),  # a name that leads here
        (["evil.example"], []),
        (["127.0.0.1:8080.evil.example"], []),
        (["localhost.evil.example"], []),
        (["localhost:8080", "evil.example"], []),
        (["[::1"], []),
        ([""], []),
        ([], []),
    ],
)
def test_others_are_refused(hosts: list[str], origins: list[str]) -> None:
    """Pages of other origins, and names that are not the server's."""
    assert LOCAL.refusal(hosts, origins) != ""


@pytest.mark.parametrize(
    ("site", "destination", "refused"),
    [
        ("cross-site", "image", True),
        ("same-site", "iframe", True),  # another port of this machine
        ("cross-site", "document", False),  # a link that somebody follows
        ("same-origin", "image", False),
        ("none", "document", False),
        ("", "", False),  # no browser
    ],
)
def test_what_pages_of_others_load_is_refused(site: str, destination: str, refused: bool) -> None:
    """Also where a browser says no origin of it."""
    assert bool(LOCAL.refusal(["localhost:8080"], [], site, destination)) == refused


def test_where_it_listens_for_others() -> None:
    """By the address that it was given or its machine's name; by any name where it listens everywhere, but for pages
    of other origins."""
    own = OwnRequests.to("192.0.2.7")
    assert own.refusal(["192.0.2.7:8090"], ["http://192.0.2.7:8090"]) == ""
    assert own.refusal([f"{socket.gethostname()}:8090"], []) == ""
    assert own.refusal(["evil.example:8090"], []) != ""
    everywhere = OwnRequests.to("0.0.0.0")
    assert everywhere.refusal(["any.example:8090"], ["http://any.example:8090"]) == ""
    assert everywhere.refusal(["any.example:8090"], ["http://evil.example"]) != ""


@pytest.mark.parametrize("host", ["127.0.0.1:8090", "study.example.org"])
def test_behind_another_server(host: str) -> None:
    """Which passes the name on that it was asked by, or says its own; its pages are the study's."""
    own = OwnRequests.to(LOOPBACK, ["https://study.example.org/"])
    assert own.refusal([host], ["https://study.example.org"]) == ""
    assert own.refusal([host], []) == ""
    assert own.refusal([host], ["https://evil.example"]) != ""
    assert own.refusal(["evil.example"], ["https://study.example.org"]) != ""


@pytest.mark.parametrize(
    "url", ["https://study.example.org:443", "HTTPS://Study.Example.Org", "http://study.example.org:80/"]
)
def test_a_port_that_goes_without_saying(url: str) -> None:
    """A browser does not name it, whether or not the address does."""
    own, origin = OwnRequests.to(LOOPBACK, [url]), url.lower().partition(":")[0] + "://study.example.org"
    assert own.refusal(["study.example.org"], [origin]) == ""
    assert own.refusal(["study.example.org"], [f"{origin}:8443"]) != ""


async def hello(socket: WebSocket) -> None:
    """Says hello to whoever gets in."""
    await socket.accept()
    await socket.send_text("hello")
    await socket.close()


def test_a_websocket_is_refused_before_it_is_open() -> None:
    """To pages of other origins; the server's own get in."""
    app = OwnRequestsOnly(Starlette(routes=[WebSocketRoute("/ws", hello)]), LOCAL, "--host")
    client, address = TestClient(app), "ws://localhost:8080/ws"
    with client.websocket_connect(address, headers={"origin": "http://localhost:8080"}) as own:
        assert own.receive_text() == "hello"
    with (
        pytest.raises(WebSocketDisconnect) as refused,
        client.websocket_connect(address, headers={"origin": "http://evil.example"}),
    ):
        pass
    assert refused.value.code == POLICY
