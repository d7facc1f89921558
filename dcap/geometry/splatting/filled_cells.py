"""Coarse occupancy of opaque Gaussians: cells of a grid, free distances between them and distances to the nearest one.

For choosing cameras before anything is drawn; independent of Taichi.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.splatting.viewpoints import OPAQUE, bulk
from dcap.scene.types.gaussians import Gaussians

CELL = 0.05
"""Side of a cell, unless the scene is too large [m]."""
MOST_CELLS = 16_000_000
"""Maximum number of cells of a grid [-]; larger scenes get larger cells."""
MARGIN = 0.3
"""Distance by which the grid extends beyond the bulk of the Gaussians [m]: walls lie at its border."""
EXTENT = 1.5
"""Number of deviations from its centre up to which a Gaussian fills cells [-]."""
MOST_STEPS = 8
"""Maximum number of cells that one Gaussian fills to either side of its own [-]."""
HEADROOM = 1.5
"""Least height of a gap in which people can stand [m]."""
STRIDE = 0.5
"""Step along a ray over a cell's side [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class FilledCells:
    """A grid along the world's axes."""

    filled: NDArray[np.bool_]
    """Mask of the filled cells, shape (nx, ny, nz)."""
    low: Array
    """Lowest corner of the first cell [m], shape (3,)."""
    size: float
    """Side of a cell [m]."""

    def at(self, points: Array) -> NDArray[np.bool_]:
        """Mask of the points (n, 3) in filled cells, shape (n,)."""
        index, there = self._index(points)
        out = np.zeros(len(points), dtype=bool)
        out[there] = self.filled[tuple(index[there].T)]
        return out

    def clearance(self, points: Array) -> Array:
        """Distance of points (n, 3) from the middle of the nearest filled cell [m], inf if there is none."""
        middles = self.low + (np.argwhere(self.filled) + 0.5) * self.size
        if not len(middles):
            return np.full(len(points), np.inf)
        return np.asarray(cKDTree(middles).query(points)[0], dtype=np.float64)

    def cast(self, origins: Array, directions: Array, reach: float | Array = np.inf) -> Array:
        """Distance along rays with unit directions (n, 3) to the first filled cell [m], to within a stride, shape (n,);
        inf if there is none within `reach` [m] (a number or shape (n,))."""
        out = np.full(len(origins), np.inf)
        active = np.arange(len(origins))
        # from outside, a ray may need as many steps to reach the grid as to cross it
        extent = self.size * np.array(self.filled.shape)
        far = np.linalg.norm(np.maximum(np.abs(origins - self.low), np.abs(origins - self.low - extent)), axis=1)
        far = np.minimum(far, reach)
        for distance in np.arange(0.0, far.max(initial=0.0) + self.size, STRIDE * self.size):
            hit = self.at(origins[active] + distance * directions[active])
            out[active[hit]] = distance
            active = active[~hit & (far[active] > distance)]
            if not len(active):
                break
        return out

    def floor(self, points: Array) -> float | None:
        """Median height of the floor at points (n, 2 or more) [m]: the lower end of the highest gap with headroom, or
        the lowest thing if there is no ceiling; None if there is nothing.

        The lowest thing itself may be a reflection in a shiny floor, which splats show as a room below.
        """
        index, there = self._index(np.c_[points[:, :2], np.full(len(points), self.low[2])])
        columns = self.filled[index[there, 0], index[there, 1]]
        columns = columns[columns.any(axis=1)]
        if not len(columns):
            return None
        level, last = columns.argmax(axis=1), columns.argmax(axis=1)
        for k in range(columns.shape[1]):
            hit = columns[:, k]
            roomy = hit & (k - last > HEADROOM / self.size)
            level[roomy] = last[roomy]
            last[hit] = k
        return float(self.low[2] + self.size * (np.median(level) + 0.5))

    def _index(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """The cell of each point (n, 3), and the mask of points inside the grid."""
        index = np.floor((points - self.low) / self.size).astype(np.int64)
        return index, np.asarray(((index >= 0) & (index < self.filled.shape)).all(axis=1))


def filled_cells(splats: Gaussians) -> FilledCells:
    """The cells that the larger two axes of opaque Gaussians reach into."""
    low, high = bulk(splats)
    low, high = low - MARGIN, high + MARGIN
    size = max(CELL, float(np.cbrt(np.prod(high - low) / MOST_CELLS)))
    out = FilledCells(np.zeros(np.ceil((high - low) / size).astype(int), dtype=bool), low, size)
    opaque = splats.subset(splats.opacity > OPAQUE)
    rows = np.arange(len(opaque))
    wide = np.argsort(opaque.log_scale, axis=1)[:, :0:-1]
    axes, scale = opaque.axes, opaque.scale
    across = np.stack([axes[rows, :, wide[:, k]] * scale[rows, wide[:, k]][:, None] for k in range(2)], axis=1)
    steps = np.minimum(np.rint(EXTENT * np.take_along_axis(scale, wide, axis=1) / size), MOST_STEPS).astype(int)
    for pair in np.unique(steps, axis=0):
        some = (steps == pair).all(axis=1)
        for a in offsets(pair[0]):
            for b in offsets(pair[1]):
                points = opaque.position[some] + a * across[some, 0] + b * across[some, 1]
                index, there = out._index(points.astype(np.float64))
                out.filled[tuple(index[there].T)] = True
    return out


def offsets(steps: int) -> Array:
    """Positions along an axis of a Gaussian, in deviations [-]."""
    return np.linspace(-EXTENT, EXTENT, 2 * steps + 1) if steps else np.zeros(1)
