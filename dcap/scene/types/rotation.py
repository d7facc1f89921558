"""One rotation for the object, and the pictures it was chosen from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

POSE_OF_THE_FILE = "the pose of the file is kept"
"""The reason of a rotation that was not chosen."""


@dataclass(frozen=True, eq=False, slots=True)
class AskedPose:
    """Requested orientation, as directions of the mesh, for comparison with the rest state."""

    name: str
    """upright, on_back ... as in `OrientationRequest`; any: none."""
    axis: NDArray[np.float64]
    """Direction in the mesh that defines the pose: its own upright axis, front or left, unit, shape (3,)."""
    from_vertical: float | None
    """Requested angle of that direction from the vertical [rad]; None: unknown, use the one before the drop."""
    up: NDArray[np.float64]
    """Upward direction in the mesh in its usual pose, unit, shape (3,)."""
    front: NDArray[np.float64]
    """Its front, unit, shape (3,)."""
    doubt: str = ""
    """Why the shape does not determine that pose; empty: it does."""
    facing_doubt: str = ""
    """Why the shape does not determine its front, if a facing is requested; empty: it does."""
    either_way: bool = False
    """Whether the axis has no direction: a book stands on both its ends."""
    looks: NDArray[np.float64] | None = None
    """Direction in the mesh that a facing or a turn refers to, unit, shape (3,); None: not requested or unknown."""
    ahead: NDArray[np.float64] | None = None
    """Requested direction of it in the world, horizontal, unit, shape (3,); None as above."""


@dataclass(frozen=True, eq=False, slots=True)
class Rotation:
    """R*: object mesh frame (as read, z up) to world."""

    matrix: NDArray[np.float64]
    """Rotation, orthonormal, det +1, shape (3, 3)."""
    pictures: tuple[NDArray[np.uint8], ...]
    """The three flips about x, y, z as RGB images, each (h, w, 3); empty if none were used."""
    refined_prompt: str
    candidate: str
    """Id of the chosen stable pose or flip."""
    reason: str
    pose: AskedPose | None = None
    """None without a requested orientation."""
