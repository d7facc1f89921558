"""One rotation for the object, and the pictures it was chosen from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

POSE_OF_THE_FILE = "the pose of the file is kept"
"""The reason of a rotation that nobody chose."""


@dataclass(frozen=True, eq=False, slots=True)
class AskedPose:
    """What was asked of the orientation, as directions of the mesh, so that it can be compared with the rest state."""

    name: str
    """upright, on_back ... as in `OrientationRequest`; any: nothing said."""
    axis: NDArray[np.float64]
    """Direction in the mesh that the pose is about: its own upright axis, front or left, unit, shape (3,)."""
    from_vertical: float | None
    """Angle of that direction from the vertical that is asked [rad]; None: nobody can tell, the one before the drop."""
    up: NDArray[np.float64]
    """What is up in the mesh when it stands or lies as usual, unit, shape (3,)."""
    front: NDArray[np.float64]
    """Its front, unit, shape (3,)."""
    doubt: str = ""
    """Why the shape does not tell that pose; empty: it does."""
    facing_doubt: str = ""
    """Why the shape does not tell where its front is, where a facing is asked; empty: it does."""
    either_way: bool = False
    """Whether the axis has no direction: a book stands on both its ends."""
    looks: NDArray[np.float64] | None = None
    """Direction in the mesh that a facing or a turn is about, unit, shape (3,); None: not asked or not known."""
    ahead: NDArray[np.float64] | None = None
    """Where that shall look in the world, horizontal, unit, shape (3,); None as above."""


@dataclass(frozen=True, eq=False, slots=True)
class Rotation:
    """R*: object mesh frame (as read, z up) to world."""

    matrix: NDArray[np.float64]
    """Rotation, orthonormal, det +1, shape (3, 3)."""
    pictures: tuple[NDArray[np.uint8], ...]
    """The three flips about x, y, z as RGB images, each (h, w, 3); empty where nobody looked at any."""
    refined_prompt: str
    candidate: str
    """Which stable pose or flip was chosen."""
    reason: str
    pose: AskedPose | None = None
    """None where nothing was asked of the orientation."""
