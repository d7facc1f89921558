"""The server of the viewer: on this machine alone, on the first free port from the one that was asked."""

import logging
import os
import socket
import sys
import webbrowser

import rich
import viser

from dcap.scene.errors import InputError
from flows.own_requests import LOOPBACK, OwnRequests
from flows.view.handshake import guarded_servers

PORTS = 20
"""Ports that are tried [-]."""
PANEL_WIDTH = 440
"""[pixel]."""


class LocalViewer(viser.ViserServer):
    """A server that nobody outside of this machine reaches: the page's way to a public address is closed, and pages of
    others are refused (handshake.py)."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Nothing is shared."""
        return None


def open_server(port: int) -> LocalViewer:
    """A server on `port`, or on the next free one; what viser prints is dropped."""
    rich.reconfigure(stderr=True, quiet=True)  # viser prints to standard output, which is the URL's
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # browsers open connections that they never use
    with guarded_servers(OwnRequests.to(LOOPBACK)):
        server = LocalViewer(host=LOOPBACK, port=free_port_from(port), label="dcap", verbose=False)
    arrange(server)
    return server


def arrange(server: viser.ViserServer) -> None:
    """The panel at the right side of the page."""
    server.gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(PANEL_WIDTH)


def free_port_from(port: int) -> int:
    """The first port from this one that nobody listens on."""
    for one in range(port, min(port + PORTS, 65536)):
        with socket.socket() as probe:
            if os.name == "posix":  # what waits for its last packets is free
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


def has_display() -> bool:
    """Whether a browser window can be seen."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_browser(url: str) -> None:
    """Open the page where there is a display."""
    if has_display():
        webbrowser.open(url)
