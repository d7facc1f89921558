"""Signed distances as the drop reads them: sampled around a body, within a budget."""

from math import cbrt, inf

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance, sampled
from dcap.scene.types.particles import DistanceGrid


def distance_samples(
    distance: Distance, box: NDArray[np.float64], spacing: float, *, margin: float, most: float = inf
) -> DistanceGrid:
    """Samples over a box (2, 3) and a margin [m] around it, as far apart as `affordable_spacing` says.

    `distance` is what is known of the solid: exact where it is a primitive, else that to its mesh.
    """
    return sampled(distance, box[0] - margin, box[1] + margin, affordable_spacing(box, spacing, margin, most))


def affordable_spacing(box: NDArray[np.float64], spacing: float, margin: float, most: float) -> float:
    """Distance of samples over a box (2, 3) and a margin [m] around it: `spacing` [m], or more where that would take
    more than `most` of them."""
    volume = float(np.prod(np.ptp(box, axis=0) + 2.0 * margin))
    return max(spacing, cbrt(volume / most))
