"""How many cores there are for this program."""

import os

SHARE = "DCAP_WORKER_THREADS"
"""Environment variable with the cores that each flow run of a worker has, so that all together have its machine's."""


def available_cores() -> int:
    """How many cores this process may use."""
    share = os.environ.get(SHARE, "")
    if share.isdecimal() and int(share):
        return int(share)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
