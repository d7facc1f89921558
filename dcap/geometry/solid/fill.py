"""Particles for a background grid: quadrature points that carry the volume of a solid, also where it is thin.

In: node planes and a signed distance. Out: at most 2 x 2 x 2 particles per cell, one per octant, at the centroid of
the octant's share inside, with that share's volume. The share comes from sub-samples whose own cut is smooth, so that
volume varies smoothly with the surface.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance

SAMPLES = 4  # sub-samples per octant and axis in octants that the surface cuts
SMALLEST_SHARE = 1e-3  # octants with less than this share inside carry nothing worth a particle
BLOCK = 200_000  # sub-samples evaluated at once: bounds the memory


def fill(
    planes: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], distance: Distance
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Positions [m], shape (p, 3), and volumes [m^3], shape (p,), of the particles inside, in the order of the
    cells.
    """
    center, size = octants(planes)
    value = distance(center)
    half_diagonal = 0.5 * np.linalg.norm(size, axis=1)
    share = np.where(value < 0.0, 1.0, 0.0)
    position = center.copy()
    cut = np.flatnonzero(np.abs(value) < half_diagonal)
    for start in range(0, len(cut), BLOCK // SAMPLES**3):
        index = cut[start : start + BLOCK // SAMPLES**3]
        share[index], position[index] = cut_octants(center[index], size[index], distance)
    keep = share > SMALLEST_SHARE
    return position[keep], (share * size.prod(axis=1))[keep]


def octants(
    planes: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres and sizes [m] of the eight octants of each cell, cells in C order, each of shape (8 c, 3)."""
    middle, width = [], []
    for plane in planes:
        step = np.diff(plane)
        middle.append(np.stack([plane[:-1] + 0.25 * step, plane[:-1] + 0.75 * step], axis=1))
        width.append(0.5 * step)
    count = [len(w) for w in width]
    i, j, k, a, b, c = (m.ravel() for m in np.indices((*count, 2, 2, 2)))
    center = np.stack([middle[0][i, a], middle[1][j, b], middle[2][k, c]], axis=1)
    return center, np.stack([width[0][i], width[1][j], width[2][k]], axis=1)


def cut_octants(
    center: NDArray[np.float64], size: NDArray[np.float64], distance: Distance
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Share inside, shape (n,), and centroid of that share, shape (n, 3), of octants that the surface may cut."""
    offset = (np.indices((SAMPLES,) * 3).reshape(3, -1).T + 0.5) / SAMPLES - 0.5
    points = center[:, None] + offset * size[:, None]
    value = distance(points.reshape(-1, 3)).reshape(len(center), -1)
    # a sub-sample's extent along the normal decides how it is cut
    lattice = value.reshape(len(center), *(SAMPLES,) * 3)
    steps = [step.reshape(value.shape) for step in np.gradient(lattice, axis=(1, 2, 3))]
    length = np.sqrt(sum((SAMPLES / size[:, axis, None] * step) ** 2 for axis, step in enumerate(steps)))
    extent = sum(np.abs(step) for step in steps)
    width = np.divide(extent, length, out=np.full_like(value, size.min() / SAMPLES), where=length > 0.0)
    inside = np.clip(0.5 - value / width, 0.0, 1.0)
    total = inside.sum(axis=1)
    weight = np.divide(inside, total[:, None], out=np.zeros_like(inside), where=total[:, None] > 0.0)
    shift = weight @ offset
    return total / SAMPLES**3, center + np.where(total[:, None] > 0.0, shift * size, 0.0)
