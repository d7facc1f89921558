"""Frames of a motion and the state of material, as values."""

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
    """Surface points that deviate from that motion, shape (k,)."""
    offset: NDArray[np.float32]
    """Their deviation in the world frame [m], shape (f, k, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class DropFrames:
    """The recorded history."""

    time: NDArray[np.float64]
    """Times of the frames [s], shape (f,)."""
    bodies: tuple[BodyPath, ...]
    """Paths of the bodies in the order of the model."""


@dataclass(frozen=True, eq=False, slots=True)
class MaterialState:
    """The material of a soft body at the end, at its material points."""

    start: NDArray[np.float64]
    """Positions in the start pose [m], shape (p, 3)."""
    displacement: NDArray[np.float64]
    """Displacements [m], shape (p, 3)."""
    volume: NDArray[np.float64]
    """Volume represented by each point in the start pose [m^3], shape (p,)."""
    volume_ratio: NDArray[np.float64]
    """Ratio of the volume at the end to that at the start [-], shape (p,)."""
    stress: NDArray[np.float64]
    """Cauchy stress xx, yy, zz, yz, xz, xy [Pa], shape (p, 6); for a loaded body in addition to the stress of its own
    weight."""
