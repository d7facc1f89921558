"""Background grids of soft bodies: cell sizes from thickness and contact, within a budget.

In: signed distances and boxes. Out: node planes. Cells are uniform per axis for free bodies, graded for supports.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import Distance
from dcap.scene.types.particles import DistanceGrid

Planes = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]

THIN_SHARE = 0.2  # chords shorter than all but this share count as the thinnest: rims and tips are always shorter
MOST_ASPECT = 3.0  # longest over shortest cell edge: beyond it trilinear cells lock
COARSENING = 1.06  # factor per round when a grid exceeds its budget
MOST_LOOKED_AT = 4_000_000  # cells of a grid that are looked at one by one: half a gigabyte while it lasts
PADDING = 2  # cells beyond the surface of a free body, so that its displacement extends past it


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """A chosen grid."""

    planes: Planes
    size: float
    """Cell size at the contact, or the smallest of a uniform grid [m]."""
    count: int
    """Cells with material."""


def thickness(grid: DistanceGrid) -> NDArray[np.float64]:
    """Typical small thickness of a solid along x, y and z [m]: a low quantile of its chords, shape (3,)."""
    inside = grid.values < 0.0
    result = np.empty(3)
    for axis in range(3):
        lines = np.moveaxis(inside, axis, -1).reshape(-1, inside.shape[axis])
        step = np.diff(np.pad(lines, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        start, end = np.nonzero(step == 1)[1], np.nonzero(step == -1)[1]
        chords = (end - start) * grid.spacing
        result[axis] = np.quantile(chords, THIN_SHARE) if len(chords) else grid.spacing
    return result


def uniform_cells(
    distance: Distance,
    bounds: NDArray[np.float64],
    thin: NDArray[np.float64],
    contact: float,
    through: int,
    budget: int,
) -> Cells:
    """A uniform grid around a free body: `through` cells along the thin chords (3,), at most `contact` [m], at most
    `budget`.
    """
    wanted = np.minimum(thin / through, contact)
    wanted = np.minimum(wanted, MOST_ASPECT * wanted.min())
    scale = 1.0
    while True:
        planes = uniform_planes(bounds, scale * wanted)
        count = occupied(planes, distance)
        if count <= budget:
            return Cells(planes, float(scale * wanted.min()), count)
        scale *= max(COARSENING, min((count / budget) ** (1 / 3), 1.5))


def uniform_planes(bounds: NDArray[np.float64], cell: NDArray[np.float64]) -> Planes:
    """Planes of uniform cells (3,) centred on a box, PADDING cells wider on each side."""
    planes = []
    for axis in range(3):
        low, high = bounds[:, axis]
        count = int(np.ceil((high - low) / cell[axis] - 1e-9)) + 2 * PADDING
        middle = 0.5 * (low + high)
        planes.append(middle + cell[axis] * (np.arange(count + 1) - 0.5 * count))
    return planes[0], planes[1], planes[2]


def occupied(planes: Planes, distance: Distance) -> int:
    """Number of cells that may hold material: whose middle is inside or nearer to the surface than half their
    diagonal; of a grid beyond all budgets the number of all cells, without looking at any.
    """
    total = int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))
    if total > MOST_LOOKED_AT:
        return total
    middle = np.stack(np.meshgrid(*[0.5 * (p[:-1] + p[1:]) for p in planes], indexing="ij"), axis=-1).reshape(-1, 3)
    half = 0.5 * np.linalg.norm(
        np.stack(np.meshgrid(*[np.diff(p) for p in planes], indexing="ij"), axis=-1).reshape(-1, 3), axis=1
    )
    return int((distance(middle) < half).sum())


def nodes(planes: Planes) -> NDArray[np.float64]:
    """Node positions [m], shape (kx ky kz, 3)."""
    return np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1).reshape(-1, 3)
