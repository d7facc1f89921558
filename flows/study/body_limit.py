"""Requests with a large body are refused before anything is done with them."""

from collections.abc import MutableMapping
from typing import Any

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

MOST_BYTES = 4096
"""Of a body: an answer has about 150."""
REQUEST = "http.request"


class BodyLimit:
    """Takes in a request's body and passes it on, or answers 413 where it is larger than MOST_BYTES, whatever its
    header says."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on as long as it is small."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        told = dict(scope["headers"]).get(b"content-length", b"0")
        body = await body_of(receive) if told.isdigit() and int(told) <= MOST_BYTES else None
        if body is None:
            await PlainTextResponse(f"more than {MOST_BYTES} bytes", status_code=413)(scope, receive, send)
            return
        waiting: list[MutableMapping[str, Any]] = [{"type": REQUEST, "body": body, "more_body": False}]

        async def again() -> MutableMapping[str, Any]:
            return waiting.pop() if waiting else await receive()

        await self._app(scope, again, send)


async def body_of(receive: Receive) -> bytes | None:
    """The body of a request; None where it is too large."""
    body, more = b"", True
    while more and len(body) <= MOST_BYTES:
        message = await receive()
        body += message.get("body", b"")
        more = message["type"] == REQUEST and message.get("more_body", False)
    return body if len(body) <= MOST_BYTES else None
