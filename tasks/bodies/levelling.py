"""How an object lies once it has tilted onto what it comes down on: contact is predicted for that pose, not for the one
in which one end hangs higher than the other.

The gap along gravity, as a surface over the plan, rests on its lower convex hull: the facet under the centre of mass
holds the points that a rigid thing ends up on. The object turns by the facet's slope.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from tasks.bodies.plan_contact import Heights, gap_map

Array = NDArray[np.float64]

TURNS = 3  # the facet of a turned object is another one where it is not flat
STEEP = 0.5  # slope [-] from which an object falls over or slides rather than lie down
LEVEL = 1e-3  # slope that changes no patch [-]


def levelling(item: Mesh, center: Array, heights_of: Callable[[Mesh], Heights]) -> Array:
    """The turn about the centre of mass [m] after which the object lies, as a matrix (4, 4); none where it would fall
    over. `heights_of` tells the gap under the object as it is turned."""
    turn = Rotation.identity()
    for _ in range(TURNS):
        turned = item.transformed(about(center, turn))
        x, y, gap, _ = gap_map(heights_of(turned), turned.bounds[:, :2])
        slope = slope_below(x, y, gap, center[:2])
        if slope is None or np.linalg.norm(slope) > STEEP:
            return np.eye(4)
        steepness = float(np.linalg.norm(slope))
        if steepness < LEVEL:
            break
        axis = np.array([-slope[1], slope[0], 0.0]) / steepness
        turn = Rotation.from_rotvec(np.arctan(steepness) * axis) * turn
    return about(center, turn)


def about(center: Array, turn: Rotation) -> Array:
    """A turn about a point as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = turn.as_matrix()
    matrix[:3, 3] = center - turn.apply(center)
    return matrix


def slope_below(x: Array, y: Array, gap: Array, center: Array) -> Array | None:
    """Slope along x and y of the facet of the gap's lower hull that a point in plan lies over, shape (2,); None where
    it lies beside all of them. `gap` [m] is known at some of x (k,) and y (m,), shape (k, m)."""
    point = np.stack([*np.meshgrid(x, y, indexing="ij"), gap], axis=-1).reshape(-1, 3)
    point = point[np.isfinite(point[:, 2])]
    if len(point) < 4 or np.linalg.matrix_rank(point[:, :2] - point[:, :2].mean(axis=0), tol=1e-9) < 2:
        return None
    try:
        hull = ConvexHull(point, qhull_options="QJ")  # flat gaps span no volume
    except QhullError:
        return None
    normal = hull.equations[:, :3]
    below = normal[:, 2] < -1e-9
    corner = point[hull.simplices[below]][:, :, :2] - center
    after = np.roll(corner, -1, axis=1)
    area = corner[:, :, 0] * after[:, :, 1] - corner[:, :, 1] * after[:, :, 0]
    around = np.flatnonzero((area >= 0.0).all(axis=1) | (area <= 0.0).all(axis=1))
    if len(around) == 0:
        return None
    facet = normal[below][around[0]]
    return np.asarray(-facet[:2] / facet[2])
