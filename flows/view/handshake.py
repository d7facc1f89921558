"""Lets the viewer's server refuse what pages of other origins ask of it: viser has no option for that.

viser opens its server with `websockets.asyncio.server.serve`, whose `process_request` sees every request, also one that
is to become a WebSocket, before anything of it is answered.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from websockets.asyncio import server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from flows.own_requests import FETCH, REFUSED, OwnRequests

ProcessRequest = Callable[[ServerConnection, Request], Response | None]


@contextmanager
def guarded_servers(own: OwnRequests) -> Iterator[None]:
    """Servers that are opened in this block answer their own requests only."""
    usual = server.serve

    def serve(*where: Any, process_request: ProcessRequest, **how: Any) -> Any:
        return usual(*where, process_request=guarded(own, process_request), **how)

    server.serve = serve  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        server.serve = usual  # type: ignore[misc]


def guarded(own: OwnRequests, answer: ProcessRequest) -> ProcessRequest:
    """Refuses requests of others, and answers the rest."""

    def process_request(connection: ServerConnection, request: Request) -> Response | None:
        said = request.headers
        fetch = ("".join(said.get_all(name.decode())[:1]) for name in FETCH)
        why = own.refusal(said.get_all("Host"), said.get_all("Origin"), *fetch)
        return connection.respond(REFUSED, f"refused: {why}\n") if why else answer(connection, request)

    return process_request
