"""Oriented boxes of point sets: the rectangle of least area around the footprint, turned about the vertical only.

The optimal rectangle shares a direction with an edge of the convex hull (Freeman and Shapira, 1975).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dcap.scene.types.box import OrientedBox

TIE = 0.01
"""Reduction of area from which a turned rectangle is preferred to the axis-aligned one [-]: round and noisy footprints
have no direction of their own, for which an aligned box is more stable."""


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
    """Direction of points on a line (or on one spot) [rad]."""
    spread = flat - flat.mean(axis=0)
    far = spread[int(np.argmax((spread**2).sum(axis=1)))]
    if not far.any():
        return 0.0
    angle = float(np.arctan2(far[1], far[0]))
    return angle - round(angle / (np.pi / 2)) * (np.pi / 2)
