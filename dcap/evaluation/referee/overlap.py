"""Depth of the overlap between an object and a scene, only by Open3D's signed distances.

In: both surfaces. Out: the largest distance of a point of one inside the other from the other's surface: of the scene
inside the object, and of the object inside each closed piece of the scene. A scan, which is open, has no inside: there
only the scene's points in the object count.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.referee.prisms import within
from dcap.geometry.pieces import numbered_pieces
from dcap.geometry.raycast import tensor
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh

FINE, LEAST_EDGE = 1.0 / 64.0, 1e-3
"""Longest edge of the faces that are sampled over the object's size [-], and at least [m]."""
VOTES = 11
"""Number of rays whose majority decides whether a point is inside: one may graze an edge."""


def overlap_depth(thing: Mesh, scene: Mesh, owner: NDArray[np.int64]) -> float:
    """Depth of their overlap [m], 0 without one."""
    box = thing.bounds
    edge = max(FINE * float(np.ptp(box, axis=0).max()), LEAST_EDGE)
    met = within(scene.triangles, box[0], box[1])
    depth = depth_in(thing, samples(scene.submesh(np.flatnonzero(met)), box, edge)) if met.any() else 0.0
    points = samples(thing, box, edge)
    for index in np.unique(owner):  # a solid may hold all of the object without a face near it
        whole = scene.submesh(np.flatnonzero(owner == index))
        if within(whole.bounds[None], box[0], box[1]).any():
            depth = max([depth, *(depth_in(piece, points) for piece in closed_pieces(whole))])
    return depth


def samples(mesh: Mesh, box: Array, edge: float) -> Array:
    """Corners and middles of the faces, those in a box cut to edges of at most `edge` [m], shape (n, 3)."""
    fine = subdivide_near(mesh, box, edge)
    return np.concatenate([fine.vertices, fine.triangles.mean(axis=1)])


def depth_in(solid: Mesh, points: Array) -> float:
    """Largest depth of points (n, 3) inside a surface [m], 0 if none is inside."""
    import open3d

    low, high = solid.bounds
    points = points[((points > low) & (points < high)).all(axis=1)]
    if not len(points):
        return 0.0
    middle = solid.bounds.mean(axis=0)  # Open3D computes in single precision
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(solid.vertices - middle), tensor(solid.faces, np.uint32))
    signed = scene.compute_signed_distance(tensor(points - middle), nsamples=VOTES).numpy()
    return float(max(0.0, -signed.min()))


def closed_pieces(mesh: Mesh) -> list[Mesh]:
    """The closed connected pieces of a surface."""
    piece, is_open = numbered_pieces(mesh)
    return [mesh.submesh(np.flatnonzero(piece == one)) for one in np.flatnonzero(~is_open)]
