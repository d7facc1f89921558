"""Pinhole cameras in the OpenCV convention: x to the right, y down, z forward; pixel (0, 0) reaches from 0 to 1."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.scene.errors import GeometryError

FIELD_OF_VIEW_DEG = 55.0
"""Default field of view across the picture [degrees]."""
UP = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False, slots=True)
class Camera:
    """A pinhole camera: its pose and its intrinsic parameters."""

    position: Array
    """Centre of projection [m], shape (3,)."""
    target: Array
    """Point in the middle of the picture [m], shape (3,)."""
    world_from_camera: Array
    """Rotation; its columns are the camera's right, down and forward axes, shape (3, 3)."""
    width: int
    """Width of the picture [pixel]."""
    height: int
    focal: float
    """Focal length along the rows [pixel]."""
    middle: tuple[float, float] | None = None
    """Principal point (column, row) [pixel]; None: the middle of the picture."""
    stretch: float = 1.0
    """Focal length along the columns over that along the rows [-]."""

    @property
    def principal(self) -> Array:
        """Principal point (column, row) [pixel], shape (2,)."""
        return np.array(self.middle or (0.5 * self.width, 0.5 * self.height))

    @property
    def focals(self) -> Array:
        """Focal lengths (along rows, along columns) [pixel], shape (2,)."""
        return np.array([self.focal, self.focal * self.stretch])

    @property
    def pixel_centers(self) -> Array:
        """Image points of all pixels, row by row, shape (height * width, 2)."""
        center = np.empty((self.height, self.width, 2))
        center[..., 0] = np.arange(self.width) + 0.5
        center[..., 1] = np.arange(self.height)[:, None] + 0.5
        return center.reshape(-1, 2)

    def scaled(self, factor: int) -> Self:
        """The same view with `factor` times as many pixels along each side."""
        column, row = self.principal
        return replace(
            self, width=factor * self.width, height=factor * self.height, focal=factor * self.focal,
            middle=(factor * column, factor * row),
        )  # fmt: skip

    def directions(self, points: NDArray[np.floating]) -> Array:
        """Unit world directions of rays through image points (n, 2) = (column, row) [pixel], shape (n, 3)."""
        x, y = ((points - self.principal) / self.focals).T
        length = np.sqrt(1.0 + x * x + y * y)
        # one component at a time: three times as fast as vectors of three
        return np.stack([(x * a + y * b + c) / length for a, b, c in self.world_from_camera]).T

    def project(self, points: Array) -> Array:
        """Image points (column, row) [pixel] and depth [m] of world points (n, 3) in front of the camera, shape (n,
        3)."""
        local = (points - self.position) @ self.world_from_camera
        image = local[:, :2] / local[:, 2:] * self.focals + self.principal
        return np.concatenate([image, local[:, 2:]], axis=1)


def looking_at(
    position: Array,
    target: Array,
    width: int,
    height: int,
    *,
    fov_deg: float = FIELD_OF_VIEW_DEG,
    up: tuple[float, float, float] = UP,
) -> Camera:
    """A camera at a position that looks at a target, with `up` upwards in the picture; horizontal field of view
    [degrees].

    Raises GeometryError if both are the same point.
    """
    forward = np.asarray(target, dtype=np.float64) - position
    distance = np.linalg.norm(forward)
    if distance == 0.0:
        raise GeometryError(f"camera position and target are the same point: {np.asarray(target).tolist()}")
    forward = forward / distance
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-6:  # looking along `up`: any side direction will do
        right = np.cross(forward, (0.0, 1.0, 0.0) if abs(forward[1]) < 0.9 else (1.0, 0.0, 0.0))
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    focal = float(0.5 * width / np.tan(0.5 * np.radians(fov_deg)))
    return Camera(np.asarray(position), np.asarray(target), axes, width, height, focal)
