"""Normals of the layers of cloth: the direction across the thin dimension, place by place.

In: a signed distance of the body in its rest shape. Out: a unit vector for each point. A stack of cloth, a pillow or a
duvet lies in layers along its two large faces, so the normal is the direction that the distance to the surface grows
in: it points up below the one face and down below the other, which is one axis. The axis is the first principal
direction of g g^T, the products of that gradient, averaged over about half the body's thickness [B87]: what a rim or a
crease of the surface turns there does not turn the layers beside it.

[B87] Bigun, Granlund: Optimal orientation detection of linear symmetry. ICCV 1987.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from dcap.scene.types.particles import DistanceGrid

Array = NDArray[np.float64]

DEPTHS = 2.0  # of the mean depth, a quarter of a sheet's thickness, that the average reaches [-]
SAMPLES = 4.0  # of the gradient within that reach
CLIPPED = 3.0  # reaches at which the weights end: e^-4.5
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def layer_normals(grid: DistanceGrid, points: Array) -> Array:
    """Unit normals, of either sign, at points (n, 3) of the solid that `grid` samples, shape (n, 3)."""
    reach = DEPTHS * mean_depth(grid)
    stride = max(1, int(reach / SAMPLES / grid.spacing))
    values = grid.values[::stride, ::stride, ::stride].astype(np.float64)
    spacing = stride * grid.spacing
    if min(values.shape) < 2:
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    gradient = np.gradient(values, spacing) * (values < 0.0)
    at = ((points - grid.origin) / spacing).T
    tensor = np.empty((len(points), 3, 3))
    for i, j in UPPER:
        mean = gaussian_filter(gradient[i] * gradient[j], reach / spacing, mode="constant", truncate=CLIPPED)
        tensor[:, i, j] = tensor[:, j, i] = map_coordinates(mean, at, order=1, mode="nearest")
    return np.asarray(np.linalg.eigh(tensor)[1][:, :, 2])


def mean_depth(grid: DistanceGrid) -> float:
    """Mean distance of the solid's points to its surface [m], at least a sample's."""
    inside = grid.values[grid.values < 0.0]
    return max(float(-inside.mean()) if len(inside) else 0.0, 0.5 * grid.spacing)
