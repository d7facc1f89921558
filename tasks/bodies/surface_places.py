"""The places of a surface that points are nearest to, and which way it looks there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.sparse import csr_matrix

from dcap.geometry.boundary import welded
from dcap.geometry.pieces import cone_volumes, numbered_pieces, outward
from dcap.geometry.raycast import tensor
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

ON_AN_EDGE = 1e-3
"""A nearest place with a corner's weight below this lies on an edge of its triangle [-]."""
NO_VOLUME = 1e-6
"""A closed piece with less volume over the 3/2 power of its area is a sheet with two sides [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Nearest:
    """The places of a surface that k points are nearest to."""

    distance: Array
    """[m], shape (k,)."""
    place: Array
    """[m], shape (k, 3)."""
    side: Array
    """Longest sides of the triangles [m], shape (k,)."""
    face: NDArray[np.int64]
    """Indices of the triangles, shape (k,)."""
    weight: Array
    """Weights of their corners, shape (k, 3)."""


def nearest(mesh: Mesh, points: Array) -> Nearest:
    """Where points (k, 3) are nearest to a surface."""
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

    Inside a triangle there is one. At an edge or a corner any direction between the normals of the faces that meet is
    one, so the part is the length of the force's projection onto their cone. Where the outside is not known, either
    direction of a face counts as inward.
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
    """Which way m faces look."""

    normal: Array
    """Unit normals, out of closed pieces, as wound elsewhere, shape (m, 3)."""
    known: NDArray[np.bool_]
    """Whether the outside is: by the volume that a closed piece encloses, shape (m,)."""
    corner: NDArray[np.int64]
    """Distinct corners, shape (m, 3)."""


def sides_of(start: Mesh, end: Mesh) -> Sides:
    """The sides of a surface with the faces of `start`, which tells inside and outside, and the corners of `end`."""
    piece, is_open = numbered_pieces(start)
    volume = np.bincount(piece, cone_volumes(start.vertices, start.faces), minlength=len(is_open))
    area = np.bincount(piece, start.face_areas, minlength=len(is_open))
    known = (~is_open & (np.abs(volume) > NO_VOLUME * area**1.5))[piece]
    turned = (outward(start).faces != start.faces).any(axis=1) & known
    a, b, c = end.triangles.transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    corner = welded(start.vertices)[start.faces]
    return Sides(np.where(turned[:, None], -normal, normal), known, corner)
