"""Background grids: graded node planes.

A grid is the tensor product of three increasing lists of node planes. Grading keeps cells small under the contact and
lets them grow geometrically away from it, so that the far field costs little.
"""

import numpy as np
from numpy.typing import NDArray

from solver.errors import ModelError

PLACES = 2000  # number of places along an axis at which the wanted spacing is evaluated


def graded_planes(
    low: float, high: float, fine_low: float, fine_high: float, cell: float, growth: float = 1.3
) -> NDArray[np.float64]:
    """Node planes that cover [low, high] exactly: spacing about `cell` inside [fine_low, fine_high], growing outwards.

    All lengths in metres; `growth` is the largest ratio of neighbouring spacings. The fine interval is clipped to
    [low, high].
    Returns increasing coordinates, shape (k,), k >= 2, first = low, last = high. Raises ModelError for an empty
    interval.
    """
    if not (high > low and cell > 0.0 and growth >= 1.0):
        raise ModelError(
            f"grid planes need high > low, cell > 0 and growth >= 1; got [{low}, {high}], {cell}, {growth}"
        )
    inner_low, inner_high = np.clip([fine_low, fine_high], low, high)
    if inner_high - inner_low < cell:
        middle = np.clip(0.5 * (inner_low + inner_high), low + 0.5 * cell, max(high - 0.5 * cell, low + 0.5 * cell))
        inner_low, inner_high = max(low, middle - 0.5 * cell), min(high, middle + 0.5 * cell)
    count = max(1, int(np.ceil((inner_high - inner_low) / cell - 1e-9)))
    inner = np.linspace(inner_low, inner_high, count + 1)
    fine = float(inner[1] - inner[0])
    below = _outward(float(inner_low - low), fine, growth)
    above = _outward(float(high - inner_high), fine, growth)
    return np.concatenate([inner_low - below[::-1], inner, inner_high + above])


def sized_planes(
    low: float,
    high: float,
    begin: NDArray[np.float64],
    end: NDArray[np.float64],
    size: NDArray[np.float64],
    growth: float,
) -> NDArray[np.float64]:
    """Node planes that cover [low, high] exactly, with the wanted spacing in some intervals and growing away from them.

    `size` [m] is the largest spacing between `begin` and `end` [m], all of shape (k,); away from these intervals the
    spacing grows by the ratio `growth` from cell to cell. Returns increasing coordinates, first = low, last = high.
    Raises ModelError for an empty range.
    """
    if not (high > low and growth > 1.0 and (size > 0.0).all()):
        raise ModelError(f"grid planes need high > low, growth > 1 and sizes > 0; got [{low}, {high}], {growth}")
    places = np.unique(np.clip(np.concatenate([np.linspace(low, high, PLACES), begin, end]), low, high))
    away = np.maximum(np.maximum(begin - places[:, None], places[:, None] - end), 0.0)
    wanted = (size + np.log(growth) * away).min(axis=1, initial=high - low)
    cells = np.concatenate([[0.0], np.cumsum(np.diff(places) * 0.5 * (1.0 / wanted[1:] + 1.0 / wanted[:-1]))])
    count = max(1, int(np.ceil(cells[-1] - 1e-9)))
    planes = np.interp(np.linspace(0.0, cells[-1], count + 1), cells, places)
    planes[0], planes[-1] = low, high
    return np.asarray(planes)


def _outward(length: float, cell: float, growth: float) -> NDArray[np.float64]:
    """Cumulative distances of planes that fill `length` with spacings that start near `cell` and grow by at most
    `growth`."""
    if length <= 1e-9 * cell:
        return np.zeros(0)
    if growth == 1.0:
        count = max(1, int(np.ceil(length / cell - 1e-9)))
    else:
        count = max(1, int(np.ceil(np.log1p(length * (growth - 1.0) / (cell * growth)) / np.log(growth) - 1e-9)))
    spacings = cell * growth ** np.arange(1, count + 1)
    cumulative = np.cumsum(spacings)
    return np.asarray(cumulative * (length / cumulative[-1]))
