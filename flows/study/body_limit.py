"""Requests with a large body are refused before they are read."""

from collections.abc import MutableMapping
from typing import Any

from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

MOST_BYTES = 4096
"""Of a body: an answer has about 150."""


class BodyTooLargeError(Exception):
    """More came than was announced or than is taken."""


class BodyLimit:
    """Answers 413 where a body is larger than MOST_BYTES, whatever its header says."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on as long as it is small."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        told = dict(scope["headers"]).get(b"content-length", b"0")
        if not told.isdigit() or int(told) > MOST_BYTES:
            await refusal(scope, receive, send)
            return
        taken = 0

        async def counted() -> MutableMapping[str, Any]:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > MOST_BYTES:
                raise BodyTooLargeError
            return message

        try:
            await self._app(scope, counted, send)
        except BodyTooLargeError:
            await refusal(scope, receive, send)


async def refusal(scope: Scope, receive: Receive, send: Send) -> None:
    """413 in words."""
    await PlainTextResponse(f"more than {MOST_BYTES} bytes", status_code=413)(scope, receive, send)
