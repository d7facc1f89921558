"""How many stages of a kind compute at a time on all machines of one Prefect server.

A limit is one of Prefect's global concurrency limits, held inside the body of a stage: a cached stage waits for
nothing. A process that is killed gives its slot back when its lease ends, after a minute or two.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from tasks.runner.context import current_context

SIMULATIONS, MODEL_CALLS = "dcap-simulations", "dcap-model-calls"
"""Stages that simulate; stages that ask a model."""
LEASE_SECONDS = 60.0
"""Who lives renews it in time; Prefect allows no less."""


def set_limits(limits: Mapping[str, int]) -> None:
    """Tell the server of a run its limits by name; other runs on the same server have them, too."""
    from prefect.client.orchestration import get_client

    if limits:
        with get_client(sync_client=True) as client:
            for name, most in limits.items():
                client.upsert_global_concurrency_limit_by_name(name, most)


@contextmanager
def slot_of(name: str) -> Iterator[None]:
    """A slot of a limit, waited for; nothing if the run has no such limit."""
    if name not in current_context().limits:
        yield
        return
    from prefect.concurrency.sync import concurrency

    # a lease that could not be renewed, as of a machine that slept, may let one more begin; it ends nothing
    with concurrency(name, strict=True, lease_duration=LEASE_SECONDS, raise_on_lease_renewal_failure=False):
        yield
