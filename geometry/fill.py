"""Fill a solid with particles: two per axis and grid cell, each with the share of its octant that lies inside.

In: node planes of a background grid and a signed distance. Out: positions and volumes. The sum of the volumes is the solid's
volume up to the sub-sampling error (about 1 % of a cut cell), a cell outside of the solid gets no particle.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Distance = Callable[[FloatArray], FloatArray]
"""Signed distance [m] of points (n, 3), negative inside."""

SUBSAMPLES = 4  # per axis and octant of a cut cell
LEAST_SHARE = 0.02  # octants with less material than this are left out: below the sub-sampling error


def fill(planes: Sequence[FloatArray], distance: Distance) -> tuple[FloatArray, FloatArray]:
    """Particles of the solid where `distance` is negative: positions [m] (p, 3) and volumes [m^3] (p,), in cell order."""
    low = np.stack(np.meshgrid(*[p[:-1] for p in planes], indexing="ij"), axis=-1).reshape(-1, 3)
    size = np.stack(np.meshgrid(*[np.diff(p) for p in planes], indexing="ij"), axis=-1).reshape(-1, 3)
    middle = distance(low + 0.5 * size)
    half_diagonal = 0.5 * np.linalg.norm(size, axis=1)
    whole = np.flatnonzero(middle <= -half_diagonal)
    cut = np.flatnonzero(np.abs(middle) < half_diagonal)
    corner = np.array(list(np.ndindex(2, 2, 2)), dtype=np.float64)
    full_position = low[whole, None] + (0.25 + 0.5 * corner) * size[whole, None]
    full_volume = np.repeat(size[whole].prod(axis=1) / 8.0, 8).reshape(-1, 8)
    cut_position, cut_volume = _cut(low[cut], size[cut], corner, distance)
    order = np.argsort(np.concatenate([whole, cut]), kind="stable")
    position = np.concatenate([full_position, cut_position])[order].reshape(-1, 3)
    volume = np.concatenate([full_volume, cut_volume])[order].reshape(-1)
    kept = volume > 0.0
    return position[kept], volume[kept]


def _cut(low: FloatArray, size: FloatArray, corner: FloatArray, distance: Distance) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 8, 3) at the centroids and volumes (k, 8) of the inside shares of the octants."""
    ticks = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES
    sub = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    local = 0.5 * (corner[:, None] + sub)  # (8, s, 3) in 0..1
    position, volume = np.empty((len(low), 8, 3)), np.empty((len(low), 8))
    for begin in range(0, len(low), CHUNK):
        at = slice(begin, begin + CHUNK)
        points = low[at, None, None] + local * size[at, None, None]
        step = 0.5 * size[at].max(axis=1) / SUBSAMPLES
        inside = np.clip(0.5 - distance(points.reshape(-1, 3)).reshape(points.shape[:3]) / step[:, None, None], 0.0, 1.0)
        share = inside.mean(axis=2)
        centroid = (inside[..., None] * points).sum(axis=2) / np.maximum(inside.sum(axis=2), 1e-12)[..., None]
        position[at] = centroid
        volume[at] = np.where(share > LEAST_SHARE, share, 0.0) * (size[at].prod(axis=1) / 8.0)[:, None]
    return position, volume


CHUNK = 500  # cut cells at a time: 500 x 8 x 64 points keep the memory of a distance query small
