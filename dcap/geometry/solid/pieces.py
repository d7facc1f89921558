"""The connected pieces of a mesh."""

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from dcap.geometry.boundary import welded
from dcap.scene.types.mesh import Mesh

BITS, BIT = 50, 0.2  # more pieces than that, none with more than this share of the area, are a soup [-]


def components(mesh: Mesh) -> NDArray[np.int64]:
    """Number of the connected piece of each face, shape (m,); faces that share a vertex position are connected."""
    return _connected(welded(mesh.vertices)[mesh.faces])


def index_components(mesh: Mesh) -> NDArray[np.int64]:
    """The same, connected by vertex index alone, numbered 0, 1, 2 ..."""
    own = _connected(mesh.faces)
    return np.asarray(np.unique(own, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def _connected(corner: NDArray[np.integer]) -> NDArray[np.int64]:
    """Number of the piece of each triangle (m, 3) of numbered corners, shape (m,)."""
    count = int(corner.max(initial=0)) + 1
    start, end = corner[:, [0, 1]].ravel(), corner[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1][corner[:, 0]], dtype=np.int64)


def pieces_of(mesh: Mesh) -> list[Mesh]:
    """The pieces connected by edges, in the order of their first faces; vertices must be shared already."""
    if len(mesh.faces) == 0:
        return []
    piece = np.asarray(igl.facet_components(mesh.faces.astype(np.int64))[1]).reshape(-1)
    order = np.argsort(piece, kind="stable")
    ends = np.flatnonzero(np.diff(piece[order])) + 1
    groups = sorted(np.split(order, ends), key=lambda group: int(group[0]))
    return [mesh.submesh(group) for group in groups]


def own_shells(mesh: Mesh) -> list[Mesh]:
    """Pieces that share no vertex with others, have no border and no face in common with another one, and the rest.

    Sewn together by position, two such shells that touch along edges could not be told apart again.
    """
    piece = index_components(mesh)
    place = welded(mesh.vertices)[mesh.faces]
    _, stack, size = np.unique(np.sort(place, axis=1), axis=0, return_inverse=True, return_counts=True)
    mixed = np.bincount(piece, weights=(size[stack.reshape(-1)] > 1) | uneven(mesh.faces)) > 0.0
    rest = np.flatnonzero(mixed[piece])
    apart = [mesh.submesh(np.flatnonzero(piece == one)) for one in np.flatnonzero(~mixed)]
    return [*apart, mesh.submesh(rest)] if len(rest) or not apart else apart


def uneven(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Faces with an edge that is not passed once in each direction, shape (m,)."""
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    key = np.minimum(start, end) * (1 << 31) + np.maximum(start, end)
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    balance = np.bincount(number, weights=np.sign(end - start).reshape(-1))
    return np.asarray(((count != 2) | (balance != 0.0))[number].reshape(-1, 3).any(axis=1))


def is_soup(mesh: Mesh) -> bool:
    """Whether a surface is in so many bits that none of them shows its shape."""
    area = np.bincount(components(mesh), weights=mesh.face_areas)
    return int((area > 0.0).sum()) > BITS and float(area.max()) < BIT * float(area.sum())
