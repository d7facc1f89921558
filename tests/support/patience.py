"""Waiting for what other processes and threads do."""

import time
from collections.abc import Callable


def wait_until(true: Callable[[], object], seconds: float, every: float = 0.05) -> None:
    """Wait for something that comes true, looked for every so many seconds; fail if it never does."""
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(every)
