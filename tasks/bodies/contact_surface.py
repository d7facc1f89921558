"""Surfaces that contact is evaluated on: given faces, subdivided where the predicted contact needs finer ones."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh
from tasks.bodies.footprint import Footprint

Array = NDArray[np.float64]

MOST_POINTS_ACROSS = 24.0  # edges across the shorter side of a rigid object's footprint
LEAST_EDGE = 2e-3  # contact points of a rigid object are never refined beyond this [m]
EDGES_ACROSS = 100.0  # edges along a soft object's longest side
OBSTACLE_EDGES = 8.0  # edges of an obstacle across the shorter side of the footprint
LEAST_OBSTACLE_EDGE = 0.01  # [m]
FAR_EDGE = 0.02  # least edge of a soft support away from the footprint [m]
PER_CELL = 3.0  # edges per fine cell of a soft support under the footprint


def rigid_object_surface(mesh: Mesh, foot: Footprint, edge: float) -> Mesh:
    """Edges of about `edge` [m] where a rigid object will touch."""
    margin = 0.3 * (foot.high - foot.low) + foot.depth
    region = foot.wider + np.stack([-margin, margin])
    return subdivide_near(mesh, region, max(edge, foot.small_side / MOST_POINTS_ACROSS, LEAST_EDGE))


def soft_object_surface(mesh: Mesh, bounds: Array, cell: float) -> Mesh:
    """Edges as long as a cell [m] all over a soft object with the given bounds (2, 3)."""
    return subdivide_near(mesh, bounds, max(cell, float(np.ptp(bounds, axis=0).max()) / EDGES_ACROSS))


def obstacle_surface(mesh: Mesh, foot: Footprint) -> Mesh:
    """Edges of a fixed rigid body, finer where the object will probably touch it."""
    edge = max(foot.small_side / OBSTACLE_EDGES, LEAST_OBSTACLE_EDGE)
    return subdivide_near(mesh, np.stack([foot.low - foot.radius - edge, foot.high + foot.radius + edge]), edge)


def soft_support_surface(
    mesh: Mesh, foot: Footprint, crop: Array, box: Array, cell: float, most_faces: int
) -> tuple[Mesh, float]:
    """Visible soft faces within the box (2, 3), and the length of their edges under the footprint [m].

    That is a third of a fine cell, or as short as `most_faces` allow; edges are longer farther away. Faces as long as a
    cell cut the corners of the dent under an edge: they showed a dumbbell 1 mm deep in its bed.
    """
    margin = np.array([0.3, 0.3, 0.0]) * (foot.high - foot.low) + 0.5 * foot.radius
    low, high = foot.wider[0] - margin, foot.wider[1] + margin
    low[2] = -np.inf
    mesh = subdivide_near(mesh, crop, max(4.0 * cell, FAR_EDGE))
    size = np.maximum(np.minimum(high, box[1]) - np.maximum(low, box[0]), 0.0)[:2]
    edge = max(cell / PER_CELL, float(np.sqrt(2.0 * size.prod() / most_faces)))
    mesh = subdivide_near(mesh, np.stack([low, high]), edge)
    inside = ((mesh.vertices[:, :2] >= box[0, :2]) & (mesh.vertices[:, :2] <= box[1, :2])).all(axis=1)
    inside &= (mesh.vertices[:, 2] >= box[0, 2]) & (mesh.vertices[:, 2] <= box[1, 2])
    return mesh.submesh(np.flatnonzero(inside[mesh.faces].all(axis=1))), edge
