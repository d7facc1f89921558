"""Serves the pages of a running server on another port of this machine, byte by byte.

A benchmark's server listens on a port that was free; who watches gets the promised one. The pages ask the address that
they came from, so nothing of a connection has to be changed.
"""

import asyncio
from asyncio import StreamReader, StreamWriter
from collections.abc import Callable
from contextlib import suppress
from functools import partial

from flows.own_requests import LOOPBACK

PIECE = 1 << 16
"""Bytes that are handed on at a time."""


def relay(port: int, to_port: int, listening: Callable[[], None], to_host: str = LOOPBACK) -> None:
    """Hand every connection to `port` on to `to_port`, for ever; `listening` is called once it does."""
    asyncio.run(_relay(port, (to_host, to_port), listening))


async def _relay(port: int, to: tuple[str, int], listening: Callable[[], None]) -> None:
    server = await asyncio.start_server(partial(_connect, to), LOOPBACK, port)
    listening()
    async with server:
        await server.serve_forever()


async def _connect(to: tuple[str, int], reader: StreamReader, writer: StreamWriter) -> None:
    """One connection, in both directions; it is closed where no server answers."""
    try:
        answers, questions = await asyncio.open_connection(*to)
        await asyncio.gather(_hand_on(reader, questions), _hand_on(answers, writer))
    except OSError:
        pass
    finally:
        writer.close()


async def _hand_on(reader: StreamReader, writer: StreamWriter) -> None:
    """All bytes of one direction."""
    with suppress(ConnectionError):
        while piece := await reader.read(PIECE):
            writer.write(piece)
            await writer.drain()
    with suppress(OSError):
        writer.close()
