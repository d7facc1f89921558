"""Surfaces that contact is evaluated on: given faces, subdivided where the predicted contact needs finer ones.

Every refinement has a budget of faces. Where the wanted edges do not fit, the faces of the predicted contact get them
first, and what may touch later gets edges as short as what is left of the budget allows.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.solid.repair import longest_near, subdivide_near
from dcap.scene.types.mesh import Mesh
from tasks.bodies.footprint import WIDER, Footprint, around

Array = NDArray[np.float64]

MOST_POINTS_ACROSS = 24.0  # edges across the shorter side of a rigid object's footprint
LEAST_EDGE = 2e-3  # contact points of a rigid object are never refined beyond this [m]
EDGES_ACROSS = 100.0  # edges along a soft object's longest side
OBSTACLE_EDGES = 8.0  # edges of an obstacle across the shorter side of the footprint
LEAST_OBSTACLE_EDGE = 0.01  # [m]
OBSTACLE_FACES = 60_000  # faces that refining adds to an obstacle at most
FAR_EDGE = 0.02  # least edge of a soft support away from the footprint [m]
PER_CELL = 2.0  # edges per fine cell of a soft support under the footprint


def rigid_object_surface(mesh: Mesh, foot: Footprint, edge: float, most_faces: int) -> Mesh:
    """Edges of about `edge` [m] where a rigid object will touch, as far as `most_faces` more allow."""
    margin = 0.3 * (foot.high - foot.low) + foot.depth
    first, later = (grown(part, margin) for part in (np.stack([foot.low, foot.high]), foot.wider))
    return refined(mesh, first, later, max(edge, foot.small_side / MOST_POINTS_ACROSS, LEAST_EDGE), most_faces)


def soft_object_surface(mesh: Mesh, bounds: Array, cell: float, most_faces: int) -> Mesh:
    """Edges as long as a cell [m] all over a soft object with the given bounds (2, 3), as far as `most_faces` more
    allow."""
    return subdivide_near(mesh, bounds, max(cell, float(np.ptp(bounds, axis=0).max()) / EDGES_ACROSS), most_faces)


def obstacle_surface(mesh: Mesh, foot: Footprint) -> Mesh:
    """Edges of a fixed rigid body, finer where the object will probably touch it."""
    edge = max(foot.small_side / OBSTACLE_EDGES, LEAST_OBSTACLE_EDGE)
    region = grown(around(np.stack([foot.low, foot.high]), foot.on_base[0]), np.full(3, foot.half_width + edge))
    return subdivide_near(mesh, region, edge, OBSTACLE_FACES)


def soft_support_surface(
    mesh: Mesh, foot: Footprint, crop: Array, box: Array, cell: float, most_faces: int
) -> tuple[Mesh, float]:
    """Visible soft faces within the box (2, 3), and the longest edge that is left where the object may touch [m].

    Under the footprint half a fine cell, as far as `most_faces` more allow; longer farther away in the crop and
    deeper than the object is expected to come. Faces as long as a cell cut the corners of the dent under an edge: they
    showed a dumbbell 1 mm deep in its bed.
    """
    margin = np.array([0.3, 0.3, 0.0]) * np.ptp(foot.on_base[0], axis=0) + 0.5 * foot.half_width
    first, later = (grown(part, margin) for part in foot.on_base)
    first[0, 2] -= foot.depth
    later[0, 2] -= WIDER * foot.depth
    mesh = subdivide_near(mesh, crop, max(4.0 * cell, FAR_EDGE), most_faces)
    mesh = refined(mesh, first, later, cell / PER_CELL, most_faces)
    longest = longest_near(mesh, later)
    inside = ((mesh.vertices >= box[0]) & (mesh.vertices <= box[1])).all(axis=1)
    return mesh.submesh(np.flatnonzero(inside[mesh.faces].all(axis=1))), longest


def refined(mesh: Mesh, first: Array, later: Array, edge: float, most_added: int) -> Mesh:
    """Edges of at most `edge` [m] in the box `later` (2, 3); where the budget does not reach so far, in its part
    `first` (2, 3), and in the rest as short as what is left of it allows."""
    fine = subdivide_near(mesh, later, edge, most_added)
    if longest_near(fine, later) <= edge * (1.0 + 1e-9):
        return fine
    fine = subdivide_near(mesh, first, edge, most_added)
    return subdivide_near(fine, later, edge, most_added - (len(fine.faces) - len(mesh.faces)))


def grown(box: Array, margin: Array) -> Array:
    """A box (2, 3) that is wider by a margin [m] on each side."""
    return np.stack([box[0] - margin, box[1] + margin])
