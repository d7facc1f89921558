"""How many stages of a kind compute at a time on all machines of one Prefect server.

A limit is one of Prefect's global concurrency limits, held inside the body of a stage: a cached stage waits for
nothing. It bounds every run on the server that has it, whoever asked for it. A process that is killed gives its slot
back when its lease ends, after a minute or two.
"""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from dcap.scene.team_server import API_URL

if TYPE_CHECKING:
    from prefect.client.orchestration import SyncPrefectClient

SIMULATIONS, MODEL_CALLS = "dcap-simulations", "dcap-model-calls"
"""Stages that simulate; stages that ask a model."""
LIMITS = (SIMULATIONS, MODEL_CALLS)
UNTOLD = (403, 404)
"""What a server answers that does not let us see its limits, or knows of none."""
LEASE_SECONDS = 60.0
"""Who lives renews it in time; Prefect allows no less."""


def set_limits(limits: Mapping[str, int]) -> dict[str, int]:
    """Tell the server of a run its limits by name; others that the server has already are returned. They stay, since
    others may compute by them."""
    from prefect.client.orchestration import get_client

    left: dict[str, int] = {}
    with get_client(sync_client=True) as client:
        for name in LIMITS:
            if name in limits:
                client.upsert_global_concurrency_limit_by_name(name, limits[name])
                continue
            if (found := limit_on(client, name)) is not None:
                left[name] = found
    return left


@contextmanager
def slot_of(name: str) -> Iterator[None]:
    """A slot of a limit, waited for; nothing where the server has no such limit."""
    if not name or not is_limited(name):
        yield
        return
    from prefect.concurrency.sync import concurrency

    # a lease that could not be renewed, as of a machine that slept, may let one more begin; it ends nothing
    with concurrency(name, lease_duration=LEASE_SECONDS, raise_on_lease_renewal_failure=False):
        yield


def is_limited(name: str) -> bool:
    """Whether the server of this run has a limit."""
    from prefect.client.orchestration import get_client

    if not os.environ.get(API_URL):
        return False
    with get_client(sync_client=True) as client:
        return limit_on(client, name) is not None


def limit_on(client: "SyncPrefectClient", name: str) -> int | None:
    """A limit of a server; None where it has none, or tells us nothing of limits."""
    from prefect.exceptions import ObjectNotFound, PrefectHTTPStatusError

    try:
        found = client.read_global_concurrency_limit_by_name(name)
    except ObjectNotFound:
        return None
    except PrefectHTTPStatusError as error:
        if error.response.status_code in UNTOLD:
            return None
        raise
    return found.limit if found.active else None
