"""The server of the viewer: on this machine only, on the first free port from the requested one."""

import logging
import os
import socket
import sys
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rich
import viser
from websockets.asyncio import server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from dcap.scene.errors import InputError
from flows.own_requests import FETCH, LOOPBACK, REFUSED, OwnRequests

PORTS = 20
"""Number of ports that are tried [-]."""
PANEL_WIDTH = 440
"""[pixel]."""


class LocalViewer(viser.ViserServer):
    """A server that cannot be reached from outside this machine: viser's public sharing is disabled, and requests from
    foreign pages are refused (`guarded`)."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Share nothing."""
        return None


def open_server(port: int) -> LocalViewer:
    """A server on the first free port from `port` on; its output is discarded."""
    rich.reconfigure(stderr=True, quiet=True)  # viser prints to standard output, which is for the URL alone
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # browsers open connections that they never use
    with guarded_servers(OwnRequests.to(LOOPBACK)):
        server = LocalViewer(host=LOOPBACK, port=free_port_from(port), label="dcap", verbose=False)
    arrange(server)
    return server


def arrange(server: viser.ViserServer) -> None:
    """Set up the panel at the right side of the page."""
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH)


def free_port_from(port: int) -> int:
    """The first port from `port` on which nobody listens."""
    for one in range(port, min(port + PORTS, 65536)):
        with socket.socket() as probe:
            if os.name == "posix":  # ports in TIME_WAIT count as free
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((LOOPBACK, one))
            except OSError:
                continue
            return one
    raise InputError(f"--port {port}: it and the {PORTS - 1} after it are taken or not allowed; give another")


def url_of(server: viser.ViserServer) -> str:
    """The page's address."""
    return f"http://{LOOPBACK}:{server.get_port()}"


def open_browser(url: str) -> None:
    """Open the page if there is a display."""
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)


ProcessRequest = Callable[[ServerConnection, Request], Response | None]


@contextmanager
def guarded_servers(own: OwnRequests) -> Iterator[None]:
    """Servers opened in this block answer requests from their own pages only."""
    usual = server.serve

    def serve(*where: Any, process_request: ProcessRequest, **how: Any) -> Any:
        return usual(*where, process_request=guarded(own, process_request), **how)

    server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = usual  # type: ignore[misc]


def guarded(own: OwnRequests, answer: ProcessRequest) -> ProcessRequest:
    """Refuses foreign requests, and answers the rest."""

    def process_request(connection: ServerConnection, request: Request) -> Response | None:
        said = request.headers
        fetch = ("".join(said.get_all(name.decode())[:1]) for name in FETCH)
        why = own.refusal(said.get_all("Host"), said.get_all("Origin"), *fetch)
        return connection.respond(REFUSED, f"refused: {why}\n") if why else answer(connection, request)

    return process_request
