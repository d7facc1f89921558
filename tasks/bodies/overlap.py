"""How deep bodies have gone into each other, measured on their surfaces at the start and at the end."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.deform import in_box
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import numbered_pieces
from dcap.scene.types.mesh import Mesh
from solver.model.bodies import Model

Array = NDArray[np.float64]

SPACING_M, SHARE = 3e-3, 1.0 / 60.0
"""How far apart points of a surface are that are looked for in another body: so far [m], or so much of the region in
which both lie [-]."""


def largest_overlap(model: Model, surfaces: Sequence[Mesh]) -> float:
    """How much deeper than at the start a surface lies in a closed piece of another one [m].

    Pairs of which nothing can move do not count, nor do bonded ones, which may lie in each other.
    """
    bonded = {frozenset(pair) for pair in model.bonds}
    largest = 0.0
    for other, end in zip(model.bodies, surfaces, strict=True):
        closed = closed_pieces(end)
        if len(closed.faces) == 0:
            continue
        now, before = MeshDistance(closed), MeshDistance(Mesh.of(other.vertices, closed.faces))
        for body, surface in zip(model.bodies, surfaces, strict=True):
            if body is other or (body.fixed and other.fixed) or frozenset((body.name, other.name)) in bonded:
                continue
            place, start = points_in(surface, body.vertices, closed.triangles)
            deeper = np.maximum(-now(place), 0.0) - np.maximum(-before(start), 0.0)
            largest = max(largest, float(deeper.max(initial=0.0)))
    return largest


def closed_pieces(surface: Mesh) -> Mesh:
    """The closed pieces of a surface, with all its vertices."""
    piece, is_open = numbered_pieces(surface)
    return Mesh.of(surface.vertices, surface.faces[~is_open[piece]])


def points_in(surface: Mesh, start: Array, triangles: Array) -> tuple[Array, Array]:
    """Points of a surface in the box of other triangles (m, 3, 3), close together, and where they were when its
    vertices (n, 3) were at `start`, shape (k, 3) each [m]."""
    from trimesh.remesh import subdivide_to_size

    low = np.maximum(triangles.min(axis=(0, 1)), surface.triangles.min(axis=(0, 1)))
    high = np.minimum(triangles.max(axis=(0, 1)), surface.triangles.max(axis=(0, 1)))
    if (low > high).any():
        return np.zeros((0, 3)), np.zeros((0, 3))
    both, faces = np.hstack([surface.vertices, start]), surface.faces
    step = max(SPACING_M, SHARE * float(np.linalg.norm(high - low)))
    while True:  # halve edges, and forget at once what lies beside the box
        corner = both[faces, :3]
        faces = faces[in_box(corner, low, high)]
        edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(initial=0.0)
        if edge <= step:
            break
        both, faces = subdivide_to_size(both, faces, max(0.5 * edge, step))  # type: ignore[no-untyped-call]
    points = both[np.unique(faces)]
    return points[:, :3], points[:, 3:]
