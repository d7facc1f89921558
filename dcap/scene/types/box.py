"""Oriented boxes: a centre, a rotation and half extents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array


@dataclass(frozen=True, eq=False, slots=True)
class OrientedBox:
    """A box turned about the vertical only: `axes[:, 2]` is world z."""

    center: NDArray[np.float64]
    """Centre [m], shape (3,)."""
    axes: NDArray[np.float64]
    """World-from-box rotation, columns are the box axes, shape (3, 3)."""
    half_extents: NDArray[np.float64]
    """Half side lengths along the axes [m], shape (3,)."""

    def __post_init__(self) -> None:
        check_array("center of a box", self.center, 3)
        check_array("axes of a box", self.axes, 3, 3)
        check_array("half_extents of a box", self.half_extents, 3)
        if (self.half_extents < 0).any():
            raise GeometryError(f"half_extents of a box are {self.half_extents.tolist()}, expected none below 0")

    @property
    def corners(self) -> NDArray[np.float64]:
        """The 8 corners [m], shape (8, 3): bottom ring then top ring, counter-clockwise seen from above."""
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=float)
        signs = np.vstack([np.c_[ring, -np.ones(4)], np.c_[ring, np.ones(4)]])
        return self.center + (signs * self.half_extents) @ self.axes.T

    @property
    def diagonal(self) -> float:
        """Length of the space diagonal [m]."""
        return float(2.0 * np.linalg.norm(self.half_extents))

    @property
    def top(self) -> float:
        """Height of the upper face [m]."""
        return float(self.center[2] + self.half_extents[2])

    @property
    def bottom(self) -> float:
        """Height of the lower face [m]."""
        return float(self.center[2] - self.half_extents[2])

    def down_to(self, height: float) -> "OrientedBox":
        """The box with its lower face at `height` [m], if that is lower."""
        more = max(self.bottom - height, 0.0)
        lower = np.array([0.0, 0.0, 0.5 * more])
        return OrientedBox(self.center - lower, self.axes, self.half_extents + lower)

    def to_local(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """World points (n, 3) in box coordinates [m], origin at the centre."""
        return (points - self.center) @ self.axes

    def to_world(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Box points (n, 3) in world coordinates [m]."""
        return points @ self.axes.T + self.center

    def contains(self, points: NDArray[np.float64], *, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether world points (n, 3) lie inside the box grown by `margin` [m], shape (n,)."""
        within = np.abs(self.to_local(points)) <= self.half_extents + margin
        inside: NDArray[np.bool_] = np.logical_and.reduce(within, axis=1)
        return inside
