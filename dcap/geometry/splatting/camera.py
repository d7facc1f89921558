"""Pinhole cameras: x to the right, y down, z forward, principal point in the middle, as COLMAP and SuGaR have them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class Camera:
    """Where a picture is taken from, and how."""

    position: Array
    """Centre of projection [m], shape (3,)."""
    world_from_camera: Array
    """Columns are the camera's right, down and forward axes, shape (3, 3)."""
    width: int
    """[pixel]."""
    height: int
    focal: float
    """Focal length [pixel], the same along both axes."""

    def directions(self, rows: NDArray[np.integer], columns: NDArray[np.integer]) -> Array:
        """Unit vectors through the middles of pixels, shape (n, 3)."""
        x = (columns + 0.5 - 0.5 * self.width) / self.focal
        y = (rows + 0.5 - 0.5 * self.height) / self.focal
        rays = np.stack([x, y, np.ones(len(x))], axis=1) @ self.world_from_camera.T
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def project(self, points: Array) -> Array:
        """Columns and rows [pixel] of points (n, 3) before the camera, shape (n, 2)."""
        local = (points - self.position) @ self.world_from_camera
        return np.asarray(local[:, :2] / local[:, 2:] * self.focal + (0.5 * self.width, 0.5 * self.height))


def looking(position: Array, target: Array, width: int, height: int, field_of_view: float) -> Camera:
    """A camera at a place that looks at another, upright; horizontal field of view [rad]."""
    forward = (target - position) / np.linalg.norm(target - position)
    up = np.array([0.0, 0.0, 1.0]) if abs(forward[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    return Camera(position, axes, width, height, 0.5 * width / float(np.tan(0.5 * field_of_view)))
