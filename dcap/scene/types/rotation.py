"""One rotation for the object, and the three pictures it was chosen from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, slots=True)
class Rotation:
    """R*: object mesh frame (as read, z up) to world."""

    matrix: NDArray[np.float64]
    """Rotation, orthonormal, det +1, shape (3, 3)."""
    pictures: tuple[NDArray[np.uint8], ...]
    """The three flips about x, y, z as RGB images, each (h, w, 3)."""
    refined_prompt: str
    candidate: str
    """Which stable pose or flip was chosen."""
    reason: str
