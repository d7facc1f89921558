"""Depth of an object in its support: the least way out, up or sideways.

Along each vertical line on which the object is sunk, the part below the surface has to be lifted out. If the object
continues next to the line, half as deep and in the open, it may come out sideways instead: a cupboard's edge that is
two centimetres inside a ball's side has a depth of two centimetres, though the ball reaches far below the cupboard's
top.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from dcap.arrays import Array
from dcap.evaluation.metrics.columns import DOWN, LINES, Columns
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster

NEIGHBOURS = np.ones((3, 3), dtype=int)
"""Lines that touch at a corner are neighbours."""


def sunk_depth(solid: MeshDistance, lines: Columns) -> float:
    """Largest of the least ways out over all sunk lines [m], 0 without any; `solid` is the object."""
    ways = lifts(solid, lines)
    sunk = np.flatnonzero(ways > 0.0)
    if not len(sunk):
        return 0.0
    place = np.zeros((LINES, LINES), dtype=bool)
    place[tuple(lines.index[sunk].T)] = True
    group = label(place, NEIGHBOURS)[0][tuple(lines.index[sunk].T)]
    deepest = np.zeros(group.max() + 1)
    np.maximum.at(deepest, group, ways[sunk])
    found = 0.0
    for one in np.argsort(-deepest):
        if deepest[one] <= found:  # the rest are less deep, whatever is next to them
            break
        own = sunk[group == one]
        first = own[ways[own].argmax()]
        aside = ways_aside(lines, own, float(lines.top[first] - 0.5 * ways[first]))
        found = max(found, float(np.minimum(ways[own], aside).max()))
    return found


def lifts(solid: MeshDistance, lines: Columns) -> Array:
    """Lift of each line that brings the object on it above the surface [m], 0 if it is above, shape (k,).

    The surface faces up and lies inside the object, or above an object that is entirely inside a solid.
    """
    ways = np.zeros(len(lines.plan))
    over = lines.upward & (lines.gap < 0.0)
    drowned = over & lines.drowned
    ways[drowned] = -lines.gap[drowned]
    cut = np.flatnonzero(over & ~drowned)
    points = np.column_stack([lines.plan[cut], lines.top[cut]])
    inside = solid.inside(points)
    cut, points = cut[inside], points[inside]
    down = Raycaster(solid.mesh).cast(points, np.tile(DOWN, (len(points), 1))).distance
    ways[cut] = np.where(np.isfinite(down), down, 0.0)
    return ways


def ways_aside(lines: Columns, own: NDArray[np.int64], level: float) -> Array:
    """Distance from lines (m,) to the nearest line on which the object is in the open at a height [m], inf without one,
    (m,)."""
    free = np.flatnonzero(~lines.drowned & (np.maximum(lines.under, lines.top) < level) & (level < lines.high))
    if not len(free):
        return np.full(len(own), np.inf)
    taken = np.ones((LINES, LINES), dtype=bool)
    taken[tuple(lines.index[free].T)] = False
    away = distance_transform_edt(taken, sampling=lines.step)
    return np.asarray(away[tuple(lines.index[own].T)])
