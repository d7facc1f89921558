"""Depth of the overlap between bodies, and the nearest places and sides of their surfaces."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.sparse import csr_matrix

from dcap.arrays import Array
from dcap.geometry.deform import in_box
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import cone_volumes, numbered_pieces, outward, welded
from dcap.geometry.raycast import Raycaster, tensor
from dcap.scene.types.mesh import Mesh
from solver.certificate import CertificateRow
from solver.model.bodies import Model, SignedDistance

ON_AN_EDGE = 1e-3
"""A nearest place with a weight of a corner below this lies on an edge of its triangle [-]."""
NO_VOLUME = 1e-6
"""A closed piece with less volume over the 3/2 power of its area is a sheet with two sides [-]."""
SPACING = 0.01
"""Spacing of the points of a surface that are tested against another body, over the size of the region in which both
lie [-]."""
LEAST_M = 1e-6
"""Bodies whose boxes overlap by less than this do not overlap [m]."""
THICKNESS_SHARE = 0.25
"""Maximum depth of a surface in a thin body, over the thickness of that body [-]."""
CLEAR_RISE = 0.5
"""Least slope of a signed distance along a normal that tells the outside [-]; 1 at a solid, 0 at a sheet."""
STEP_U, STEP_V = 0.7548776662466927, 0.5698402909980532
"""Steps of the additive recurrence with the lowest discrepancy in a square [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Nearest:
    """The places of a surface nearest to k points."""

    distance: Array
    """Distance to the surface [m], shape (k,)."""
    place: Array
    """Nearest place [m], shape (k, 3)."""
    side: Array
    """Longest sides of the triangles [m], shape (k,)."""
    face: NDArray[np.int64]
    """Indices of the triangles, shape (k,)."""
    weight: Array
    """Weights of their corners, shape (k, 3)."""


def nearest(mesh: Mesh, points: Array) -> Nearest:
    """Nearest places of a surface to points (k, 3)."""
    import open3d

    middle = points.mean(axis=0)  # single precision is finest around the origin
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices - middle, np.float32), tensor(mesh.faces, np.uint32))
    found = scene.compute_closest_points(tensor(points - middle, np.float32), nthreads=1)
    place = found["points"].numpy().astype(np.float64) + middle
    face = found["primitive_ids"].numpy().astype(np.int64)
    corner = mesh.vertices[mesh.faces[face]]
    side = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    u, v = found["primitive_uvs"].numpy().astype(np.float64).T
    weight = np.column_stack([1.0 - u - v, u, v])
    return Nearest(np.linalg.norm(place - points, axis=1), place, side, face, weight)


def largest_push(sides: "Sides", near: Nearest, force: Array) -> Array:
    """The largest part of forces (k, 3) along an inward normal at the nearest places, shape (k,).

    Inside a triangle there is a single normal. At an edge or a corner any direction between the normals of the adjacent
    faces counts as a normal, so the part is the length of the force's projection onto their cone. Where the outside is
    not known, either direction of a face counts as inward.
    """
    corner = sides.corner
    count, faces = int(corner.max()) + 1, len(corner)
    around = csr_matrix((np.ones(3 * faces), (corner.ravel(), np.repeat(np.arange(faces), 3))), shape=(count, faces))
    on = near.weight > ON_AN_EDGE
    point = np.repeat(np.arange(len(on)), on.sum(axis=1))
    corners = csr_matrix((np.ones(len(point)), (point, corner[near.face][on])), shape=(len(on), count))
    shared = (corners @ around).tocoo()
    meets = shared.data > on.sum(axis=1)[shared.row] - 0.5
    order = np.argsort(shared.row[meets], kind="stable")
    point, face = shared.row[meets][order], shared.col[meets][order]
    along = -np.einsum("ki,ki->k", force[point], sides.normal[face])
    inward = np.where((sides.known[face] | (along > 0.0))[:, None], -1.0, 1.0) * sides.normal[face]
    along = np.where(sides.known[face], along, np.abs(along))
    push = np.full(len(on), -np.inf)
    np.maximum.at(push, point, along)
    first = np.searchsorted(point, np.arange(len(on) + 1))
    for index in np.flatnonzero((np.diff(first) > 1) & (push > 0.0)):
        normals = inward[first[index] : first[index + 1]]
        push[index] = np.linalg.norm(normals.T @ nnls(normals.T, force[index])[0])
    return push


@dataclass(frozen=True, eq=False, slots=True)
class Sides:
    """Normals of m faces, and on which of them the outside is known."""

    normal: Array
    """Unit normals, outward where the outside is known, otherwise as wound, shape (m, 3)."""
    known: NDArray[np.bool_]
    """Whether the outside is known: from the volume that a closed piece encloses, or from the signed distance to the
    solid to which an open piece belongs; shape (m,)."""
    corner: NDArray[np.int64]
    """Distinct corners, shape (m, 3)."""


def sides_of(start: Mesh, end: Mesh, distance: SignedDistance, near: Nearest) -> Sides:
    """The sides of a surface with the faces of `start`, which defines inside and outside, and the corners of `end`.

    The signed distance of the start pose tells the outside of open pieces, except for sheets thinner than its samples:
    at `near` on the faces there, at their middles on the others.
    """
    piece, is_open = numbered_pieces(start)
    volume = np.bincount(piece, cone_volumes(start.vertices, start.faces), minlength=len(is_open))
    area = np.bincount(piece, start.face_areas, minlength=len(is_open))
    known = (~is_open & (np.abs(volume) > NO_VOLUME * area**1.5))[piece]
    turned = (outward(start).faces != start.faces).any(axis=1) & known
    if is_open.any():
        rise = rise_along_normals(start, distance, near)
        told = is_open[piece] & (np.abs(rise) > CLEAR_RISE)
        turned, known = np.where(told, rise < 0.0, turned), known | told
    corner = welded(start.vertices)[start.faces]
    normal = unit_normals(end)
    return Sides(np.where(turned[:, None], -normal, normal), known, corner)


def unit_normals(mesh: Mesh) -> Array:
    """Unit normals of faces as wound, shape (m, 3); zero for a face without area."""
    return mesh.face_normals / np.maximum(2.0 * mesh.face_areas, np.finfo(float).tiny)[:, None]


def rise_along_normals(mesh: Mesh, distance: SignedDistance, near: Nearest) -> Array:
    """Slope of a signed distance along the normals of faces [-], shape (m,): 1 outward, -1 inward.

    It is taken at a place of `near` on each face that has one, because large faces reach beyond the samples, and at the
    middles of the others.
    """
    step, place = distance.spacing * unit_normals(mesh), mesh.triangles.mean(axis=1)
    place[near.face] = np.einsum("kc,kci->ki", near.weight, mesh.triangles[near.face])
    return np.asarray((distance.at(place + step) - distance.at(place - step)) / (2.0 * distance.spacing))


def worst_row(rows: Sequence[CertificateRow]) -> CertificateRow:
    """The row with the least margin; one without a number comes first."""
    return rows[int(np.argmin([row.margin if np.isfinite(row.margin) else -np.inf for row in rows]))]


def overlap_row(model: Model, surfaces: Sequence[Mesh], least: float, most: float) -> CertificateRow:
    """Row for the largest increase since the start in the depth of a surface inside a closed piece of another body,
    relative to its bound [m]: a quarter of the thickness there, but at least `least` and at most `most`.

    Pairs of bodies that cannot move are ignored, and so are bonded pairs, which may overlap.
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
    return worst_row(rows)


def deepest(closed: Mesh, before: Mesh, points: Array, least: float, most: float) -> CertificateRow:
    """The overlap of points (k, 6), given by their places at the end and at the start, with a closed surface that was
    `before`, where it is largest over its bound [m]."""
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
    """Thickness of a solid at points (k, 3) inside it, measured across the nearest place of its surface [m], shape
    (k,)."""
    near = nearest(closed, inside)
    inward = (inside - near.place) / near.distance[:, None]
    return near.distance + Raycaster(closed).cast(inside, inward).distance


def points_in(surface: Mesh, start: Array, closed: Mesh) -> Array:
    """Closely spaced points of a surface in the box of a closed surface, each with its place when the vertices (n, 3)
    were at `start` [m], shape (k, 6)."""
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
