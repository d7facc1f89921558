"""Work on many pixels in bands: small enough to stay in a core's cache, several at a time.

Where a band ends depends on the number of pixels alone, so results do not depend on the number of cores.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

from dcap.cores import available_cores

BAND = 16384
"""Pixels in a band: an array of vectors takes 200 KB, so that half a dozen fit into the second-level cache."""


def in_bands(action: Callable[[slice], None], count: int, band: int = BAND) -> None:
    """Call `action` with slices that cut range(count) into bands, on all cores; it must write its own band only."""
    cuts = [slice(first, min(first + band, count)) for first in range(0, count, band)]
    workers = min(available_cores(), len(cuts))
    if workers < 2:
        for cut in cuts:
            action(cut)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(action, cuts):  # raises what a band raised
            pass
