"""Points on a surface from scanners and depth cameras, with local tangent planes."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

NEIGHBOURS = 24
"""Number of points per fitted plane [-]."""
AT_ONCE = 100_000
"""Number of planes per batch [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class PointCloud:
    """n points; at least one, all finite."""

    position: Array
    """Positions [m], or in the file's unit before its frame is known, shape (n, 3)."""
    color: NDArray[np.uint8]
    """sRGB colours, shape (n, 3)."""
    normal: Array | None = None
    """Unit normals, shape (n, 3); None if the source has none."""

    def __post_init__(self) -> None:
        check_array("positions of points", self.position, None, 3)
        if self.color.shape != self.position.shape:
            raise GeometryError(f"colours of points have shape {self.color.shape}, expected {self.position.shape}")
        if self.normal is not None:
            check_array("normals of points", self.normal, len(self.position), 3)

    def __len__(self) -> int:
        return len(self.position)

    def subset(self, index: NDArray[np.integer] | NDArray[np.bool_]) -> Self:
        """A copy with only the given points."""
        normal = None if self.normal is None else self.normal[index]
        return replace(self, position=self.position[index], color=self.color[index], normal=normal)

    def transformed(self, world_from_file: Array) -> Self:
        """A copy moved, turned and scaled by a similarity (4, 4)."""
        linear, shift = world_from_file[:3, :3], world_from_file[:3, 3]
        turn = linear / np.cbrt(np.linalg.det(linear))
        normal = None if self.normal is None else self.normal @ turn.T
        return replace(self, position=self.position @ linear.T + shift, normal=normal)


@dataclass(frozen=True, eq=False, slots=True)
class LocalPlanes:
    """The planes that fit the neighbourhoods of n points."""

    near: NDArray[np.int64]
    """Indices of the neighbours, the nearest first, including the point itself, shape (n, k)."""
    gap: Array
    """Spacing of the points around each point, as if they filled a disc evenly [m], shape (n,)."""
    normal: Array
    """Unit normals of either sign, shape (n, 3)."""
    scatter: Array
    """Root mean square distance of the neighbours from the plane [m], shape (n,)."""


def local_planes(position: Array, threads: int = 1) -> LocalPlanes:
    """Planes fitted by least squares to the nearest NEIGHBOURS points of each point (n, 3)."""
    count = min(NEIGHBOURS, len(position))
    distance, near = cKDTree(position).query(position, k=count, workers=threads)
    distance, near = distance.reshape(-1, count), near.reshape(-1, count)
    normal, scatter = np.empty_like(position), np.empty(len(position))
    for first in range(0, len(position), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        offset = position[near[some]]
        offset -= offset.mean(axis=1, keepdims=True)
        value, vector = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset) / count)
        normal[some], scatter[some] = vector[:, :, 0], np.sqrt(value[:, 0].clip(0.0))
    return LocalPlanes(near, distance[:, -1] * np.sqrt(np.pi / count), normal, scatter)
