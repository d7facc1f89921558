"""Waits for a server of Prefect that is lost, and says so."""

import math
import os
import threading
import time
from typing import Self

from dcap.scene.errors import ServerGoneError
from dcap.scene.redaction import redacted_url
from dcap.scene.settings import server_folder
from dcap.scene.team_server import API_URL, team_server
from flows.interrupts import say
from flows.server import START_SECONDS, is_ready, why_gone

SILENT_SECONDS = 5.0
"""A server that is away for no longer is waited for without a word."""
LOOK_SECONDS = 0.2
GIVEN_UP: dict[str, float] = {}
"""Addresses of servers that somebody in this program has waited for in vain, and when: nobody else does so soon."""


class Waiting:
    """Says that a server is waited for, once for all threads that do so, and where it is long."""

    _lock = threading.Lock()
    _waiting = 0
    _said = False

    def __init__(self, url: str) -> None:
        self._line = f"the Prefect server {redacted_url(url)} does not answer; it is waited for"
        self._since = time.monotonic()

    def __enter__(self) -> Self:
        with Waiting._lock:
            Waiting._waiting += 1
        return self

    def __exit__(self, *_: object) -> None:
        with Waiting._lock:
            Waiting._waiting -= 1
            Waiting._said &= Waiting._waiting > 0

    def goes_on(self) -> None:
        """Still nothing."""
        with Waiting._lock:
            if Waiting._said or time.monotonic() - self._since < SILENT_SECONDS:
                return
            Waiting._said = True
        say(self._line)


def wait_for_server(patience: float | None = None) -> None:
    """Wait until the server of this run answers again; ServerGoneError if it does not within `patience` [s], as long as
    a start may take where none is given."""
    url = os.environ.get(API_URL, "")
    if not url:  # Prefect has it from elsewhere
        return
    patience = START_SECONDS if patience is None else patience
    deadline = time.monotonic() + patience
    with Waiting(url) as waiting:
        while not is_ready(url):
            now = time.monotonic()
            if now > deadline:
                GIVEN_UP[url] = now
            if now > deadline or (now - GIVEN_UP.get(url, -math.inf) < START_SECONDS and patience < math.inf):
                raise ServerGoneError(f"the Prefect server {redacted_url(url)} is gone; {why_gone(server_folder())}")
            waiting.goes_on()
            time.sleep(LOOK_SECONDS)
    GIVEN_UP.pop(url, None)


def team_server_is_gone() -> bool:
    """Whether a server of others is named that does not answer now: what it would be told of an end is not waited
    for."""
    return team_server() != "" and not is_ready(os.environ[API_URL])
