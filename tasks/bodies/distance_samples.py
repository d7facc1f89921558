"""Signed distances as the drop reads them: sampled around a body, within a budget."""

from math import inf

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance, sampled
from dcap.scene.types.particles import DistanceGrid


def distance_samples(
    distance: Distance, box: NDArray[np.float64], spacing: float, *, margin: float, most: float = inf
) -> DistanceGrid:
    """Samples over a box (2, 3) and a margin [m] around it, coarser than `spacing` [m] where more than `most` would be
    needed.

    `distance` is what is known of the solid: exact where it is a primitive, else that to its mesh.
    """
    low, high = box[0] - margin, box[1] + margin
    least = float(np.prod(high - low) / most) ** (1.0 / 3.0)
    return sampled(distance, low, high, max(spacing, least))
