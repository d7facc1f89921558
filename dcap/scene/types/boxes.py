"""Oriented boxes: a centre, a rotation and half extents; and the box of least area around the footprint of points.

Oriented boxes of point sets: the rectangle of least area around the footprint, turned about the vertical only.

The optimal rectangle shares a direction with an edge of the convex hull (Freeman and Shapira, 1975).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

TIE = 0.01
"""Least relative reduction of area for a turned rectangle to be preferred over the axis-aligned one [-]: round and
noisy footprints have no direction of their own, so an aligned box is more stable."""


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
        """Mask of the world points (n, 3) inside the box grown by `margin` [m], shape (n,)."""
        within = np.abs(self.to_local(points)) <= self.half_extents + margin
        inside: NDArray[np.bool_] = np.logical_and.reduce(within, axis=1)
        return inside


def min_area_box(points: NDArray[np.float64]) -> OrientedBox:
    """The box of points (n, 3), n >= 1; x is the direction nearest to world x."""
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    angle = _best_angle(points[:, :2])
    cos, sin = np.cos(angle), np.sin(angle)
    axes = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    local = points[:, :2] @ axes[:2, :2]
    least, most = local.min(axis=0), local.max(axis=0)
    center = np.array([*(axes[:2, :2] @ (0.5 * (least + most))), 0.5 * (low + high)])
    return OrientedBox(center, axes, np.array([*(0.5 * (most - least)), 0.5 * (high - low)]))


def _best_angle(flat: NDArray[np.float64]) -> float:
    """Direction of the rectangle of least area [rad], in (-pi/4, pi/4]."""
    try:
        hull = flat[ConvexHull(flat).vertices]
    except (QhullError, ValueError):
        return _line_angle(flat)
    edges = np.roll(hull, -1, axis=0) - hull
    angles = np.append(np.arctan2(edges[:, 1], edges[:, 0]), 0.0)
    angles = np.unique(np.round(angles - np.round(angles / (np.pi / 2)) * (np.pi / 2), 12))
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = hull[:, 0] * cos + hull[:, 1] * sin
    across = hull[:, 1] * cos - hull[:, 0] * sin
    area = np.ptp(along, axis=1) * np.ptp(across, axis=1)
    best = int(np.argmin(area))
    straight = int(np.argmin(np.abs(angles)))
    return float(angles[straight] if area[straight] <= (1.0 + TIE) * area[best] else angles[best])


def _line_angle(flat: NDArray[np.float64]) -> float:
    """Direction of points on a line (or at a single spot) [rad]."""
    spread = flat - flat.mean(axis=0)
    far = spread[int(np.argmax((spread**2).sum(axis=1)))]
    if not far.any():
        return 0.0
    angle = float(np.arctan2(far[1], far[0]))
    return angle - round(angle / (np.pi / 2)) * (np.pi / 2)
