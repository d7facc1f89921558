"""Frames of a motion, as values."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class BodyPath:
    """One body over the frames."""

    rotation: NDArray[np.float64]
    """World-from-start rotation, best fit for soft bodies, shape (f, 3, 3)."""
    translation: NDArray[np.float64]
    """World-from-start translation [m], shape (f, 3)."""
    moved: NDArray[np.int32]
    """Surface points that leave that motion, shape (k,)."""
    offset: NDArray[np.float32]
    """By how much they leave it, in the world frame [m], shape (f, k, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class DropFrames:
    """What happened, as far as it is kept."""

    time: NDArray[np.float64]
    """[s], shape (f,)."""
    bodies: tuple[BodyPath, ...]
    """In the order of the model."""
