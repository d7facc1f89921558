"""The connected pieces of a mesh."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geometry.boundary import welded
from scene.mesh import Mesh


def components(mesh: Mesh) -> NDArray[np.int64]:
    """Number of the connected piece of each face, shape (m,); faces that share a vertex position are connected."""
    corner = welded(mesh.vertices)[mesh.faces]
    count = int(corner.max(initial=0)) + 1
    start, end = corner[:, [0, 1]].ravel(), corner[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(start), dtype=np.int8), (start, end)), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1][corner[:, 0]], dtype=np.int64)


def pieces_of(mesh: Mesh) -> list[Mesh]:
    """The connected pieces in the order of their numbers; faces keep their order."""
    piece = components(mesh)
    return [mesh.submesh(np.flatnonzero(piece == one)) for one in np.unique(piece)]
