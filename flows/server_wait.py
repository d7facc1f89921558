"""Waits for a server of Prefect that is lost."""

import math
import os
import time

from dcap.scene.errors import ServerGoneError
from dcap.scene.redaction import redacted_url
from dcap.scene.settings import server_folder
from dcap.scene.team_server import API_URL, team_server
from flows.server import START_SECONDS, is_healthy, is_ready, why_gone

LOOK_SECONDS = 0.2
GIVEN_UP: dict[str, float] = {}
"""Addresses of servers that somebody in this program has waited for in vain, and when: nobody else does so soon."""


def wait_for_server(patience: float | None = None) -> None:
    """Wait until the server of this run answers again; ServerGoneError if it does not within `patience` [s], as long as
    a start may take where none is given."""
    url = os.environ.get(API_URL, "")
    if not url:  # Prefect has it from elsewhere
        return
    patience = START_SECONDS if patience is None else patience
    deadline = time.monotonic() + patience
    while not is_ready(url):
        now = time.monotonic()
        if now > deadline:
            GIVEN_UP[url] = now
        if now > deadline or (now - GIVEN_UP.get(url, -math.inf) < START_SECONDS and patience < math.inf):
            raise ServerGoneError(f"the Prefect server {redacted_url(url)} is gone; {why_gone(server_folder())}")
        time.sleep(LOOK_SECONDS)
    GIVEN_UP.pop(url, None)


def server_is_gone() -> bool:
    """Whether the server of this run does not answer now, or a team's has no database: who ends does not wait for what
    it would be told."""
    url = os.environ.get(API_URL, "")
    return url != "" and not (is_ready(url) if team_server() else is_healthy(url))
