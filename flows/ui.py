"""Serves Prefect's pages over all runs on a promised port, whichever port the server listens on."""

import os
import signal
from collections.abc import Callable
from urllib.parse import urlsplit

from dcap.scene.settings import server_folder
from dcap.scene.team_server import API_URL
from flows.own_requests import LOOPBACK
from flows.prefect_settings import apply_settings
from flows.relay import relay
from flows.server import (
    check_port,
    pages_of,
    port_of,
    prefect_server,
    running_url,
    server_host,
)


def serve_pages(port: int, announce: Callable[[str], None]) -> None:
    """Serve until interrupted; `announce` is given the address.

    The server of a benchmark that runs is joined, else one is started on the port itself. A server that
    $PREFECT_API_URL names has an address of its own.
    """
    apply_settings()
    own = not os.environ.get(API_URL)
    there = running_url(server_folder())
    if own and not (there and port_of(there) == port):
        check_port(port, LOOPBACK if there else server_host())
    with prefect_server(port) as url:
        if own and port_of(url) != port:
            host = urlsplit(url).hostname or LOOPBACK
            relay(port, port_of(url), lambda: announce(f"http://{LOOPBACK}:{port}"), host)
        else:
            announce(pages_of(url))
            signal.pause()
