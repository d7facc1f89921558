"""What an error of Prefect's client says of its server: that it is lost for now, or that it refuses; imports Prefect.

A lost server is waited for, or ends what asked it. What a server refuses concerns that one request.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import httpx
from prefect.exceptions import ObjectNotFound, PrefectException, PrefectHTTPStatusError

from dcap.scene.machine_errors import says_no_server
from dcap.scene.team_server import team_server
from flows.server_wait import server_is_gone

AWAY = (502, 503, 504)
"""What a web server answers that has no answer from the server behind it, or not now."""
BROKEN = 500
"""What Prefect's server answers without its database, and for its own mistakes; our own server has its database in a
file, and what is wrong with that is not waited for."""
MISSING = 404


def server_lost(error: Exception) -> bool:
    """Whether an error says that no server answers, or that a team's server may have lost its database."""
    if isinstance(error, httpx.TransportError) or says_no_server(error):
        return True
    return status_of(error) in AWAY or (status_of(error) == BROKEN and team_server() != "")


def is_missing(error: Exception) -> bool:
    """Whether an error says that the server has nothing of that name, or not any more."""
    return isinstance(error, ObjectNotFound) or status_of(error) == MISSING


def status_of(error: Exception) -> int:
    """The status of an answer that came to an error; 0 for an error without an answer."""
    return error.response.status_code if isinstance(error, httpx.HTTPStatusError) else 0


def of_server(error: Exception) -> bool:
    """Whether an error comes from a server or from the way to it."""
    return isinstance(error, httpx.HTTPError | PrefectException) or says_no_server(error)


@contextmanager
def refusals_passed() -> Iterator[None]:
    """Passes over what the server refuses, does not have any more, or breaks on; that it is away is raised."""
    try:
        yield
    except (PrefectHTTPStatusError, ObjectNotFound) as error:
        if status_of(error) in AWAY or (status_of(error) == BROKEN and server_is_gone()):
            raise


@contextmanager
def server_errors_passed() -> Iterator[None]:
    """Passes over all that a server comes to, where nothing depends on its answer."""
    try:
        yield
    except Exception as error:
        if not of_server(error):
            raise
