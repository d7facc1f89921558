"""How deep bodies have gone into each other, measured on their surfaces at the start and at the end."""

from collections.abc import Sequence
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.deform import in_box
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import numbered_pieces
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from solver.certificate import CertificateRow
from solver.model.bodies import Model
from tasks.bodies.surface_places import nearest

Array = NDArray[np.float64]

SPACING = 0.01
"""Distance between the points of a surface that are sought in another body, over the size of the region in which both
lie [-]."""
LEAST_M = 1e-6
"""Bodies whose boxes have less in common than this do not overlap [m]."""
THICKNESS_SHARE = 0.25
"""How deep a surface may lie in something thin, over the thickness of that [-]."""
STEP_U, STEP_V = 0.7548776662466927, 0.5698402909980532
"""Steps of the additive recurrence with the lowest discrepancy in a square [-]."""


def overlap_row(model: Model, surfaces: Sequence[Mesh], least: float, most: float) -> CertificateRow:
    """How much deeper than at the start a surface lies in a closed piece of another one, where that is largest over its
    bound [m]: a quarter of the thickness there, but at least `least` and at most `most`.

    Pairs of which nothing can move do not count, nor do bonded ones, which may lie in each other.
    """
    bonded = {frozenset(pair) for pair in model.bonds}
    rows = [CertificateRow.at_most(0.0, most)]
    for other, end in zip(model.bodies, surfaces, strict=True):
        closed = closed_pieces(end)
        if len(closed.faces) == 0:
            continue
        found = [
            points_in(surface, body.vertices, closed)
            for body, surface in zip(model.bodies, surfaces, strict=True)
            if body is not other
            and not (body.fixed and other.fixed)
            and frozenset((body.name, other.name)) not in bonded
        ]
        points = np.concatenate([np.zeros((0, 6)), *found])
        if len(points):
            rows.append(deepest(closed, Mesh.of(other.vertices, closed.faces), points, least, most))
    return min(rows, key=attrgetter("margin"))


def deepest(closed: Mesh, before: Mesh, points: Array, least: float, most: float) -> CertificateRow:
    """The overlap of points (k, 6), where they are and where they were, with a closed surface that was `before`, where
    it is largest over its bound [m]."""
    deep = -MeshDistance(closed)(points[:, :3])
    inside = deep > least
    if not inside.any():
        return CertificateRow.at_most(max(float(deep.max()), 0.0), most)
    deeper = deep[inside] - np.maximum(-MeshDistance(before)(points[inside, 3:]), 0.0)
    allowed = np.clip(THICKNESS_SHARE * thickness(closed, points[inside, :3]), least, most)
    largest = int(np.argmax(deeper / allowed))
    return CertificateRow.at_most(float(deeper[largest]), float(allowed[largest]))


def closed_pieces(surface: Mesh) -> Mesh:
    """The closed pieces of a surface, with all its vertices."""
    piece, is_open = numbered_pieces(surface)
    return Mesh.of(surface.vertices, surface.faces[~is_open[piece]])


def thickness(closed: Mesh, inside: Array) -> Array:
    """How thick a solid is at points (k, 3) inside it, across the nearest place of its surface [m], shape (k,)."""
    near = nearest(closed, inside)
    inward = (inside - near.place) / near.distance[:, None]
    return near.distance + Raycaster(closed).cast(inside, inward).distance


def points_in(surface: Mesh, start: Array, closed: Mesh) -> Array:
    """Points of a surface in the box of a closed one, close together, each with its place when the vertices (n, 3) were
    at `start` [m], shape (k, 6)."""
    from trimesh.remesh import subdivide_to_size

    low = np.maximum(closed.triangles.min(axis=(0, 1)), surface.triangles.min(axis=(0, 1)))
    high = np.minimum(closed.triangles.max(axis=(0, 1)), surface.triangles.max(axis=(0, 1)))
    across = float(np.linalg.norm(high - low))
    if (low > high).any() or across < LEAST_M:
        return np.zeros((0, 6))
    both, faces, step = np.hstack([surface.vertices, start]), surface.faces, SPACING * across
    while True:  # halve edges that are longer than the box, and drop triangles outside of it at once
        faces = faces[in_box(both[faces, :3], low, high)]
        corner = both[faces, :3]
        edge = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(initial=0.0)
        if edge <= across:
            break
        both, faces = subdivide_to_size(both, faces, max(0.5 * edge, across))  # type: ignore[no-untyped-call]
    a, b, c = both[faces].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross((b - a)[:, :3], (c - a)[:, :3]), axis=1)
    face = np.repeat(np.arange(len(faces)), np.ceil(area / step**2).astype(int))
    number = np.arange(len(face))
    u, v = (STEP_U * number) % 1.0, (STEP_V * number) % 1.0
    u, v = np.where(u + v > 1.0, [1.0 - u, 1.0 - v], [u, v])
    within = a[face] + u[:, None] * (b - a)[face] + v[:, None] * (c - a)[face]
    points: Array = np.concatenate([both[np.unique(faces)], within])
    points = points[((points[:, :3] >= low) & (points[:, :3] <= high)).all(axis=1)]
    _, first = np.unique(np.floor((points[:, :3] - low) / step), axis=0, return_index=True)
    return np.asarray(points[first])
