"""Colours of numbers: the dent, from deep to raised, and materials told apart."""

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array

DEEP, LEVEL, RAISED = (24, 62, 158), (236, 236, 236), (196, 52, 38)
"""Colours of the deepest dent, of unmoved points, and of an equally large bulge."""
LEAST_SPAN = 1e-4
"""Least span of the dent's colours [m]: smaller displacements are noise."""
DISTINCT = (
    (230, 120, 30), (40, 120, 190), (60, 160, 90), (150, 90, 180), (200, 60, 90), (120, 120, 60), (90, 180, 190),
    (140, 90, 60),
)  # fmt: skip
"""Colours of materials, repeated where there are more."""


def span_of(height: Array) -> float:
    """Displacement with the strongest colour [m]."""
    return float(max(np.abs(height).max(initial=0.0), LEAST_SPAN))


def heat_colors(height: Array, span: float) -> NDArray[np.uint8]:
    """sRGB colours of displacements along the outward normal (n,) [m], shape (n, 3)."""
    share = np.clip(height / span, -1.0, 1.0)[:, None]
    end = np.where(share < 0.0, np.array(DEEP, dtype=float), np.array(RAISED, dtype=float))
    middle = np.array(LEVEL, dtype=float)
    return np.asarray(np.round(middle + np.abs(share) * (end - middle)), dtype=np.uint8)


def css(color: tuple[int, int, int]) -> str:
    """A colour in CSS."""
    return "rgb({}, {}, {})".format(*color)
