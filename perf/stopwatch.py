"""Measures time: the shortest of a few runs, which other work on the machine disturbs least."""

import time
from collections.abc import Callable

REPEATS = 5


def best(action: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest of a few runs [s]."""
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)
