"""The connected pieces of a mesh."""

import igl
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
    """The pieces connected by edges, in the order of their first faces; vertices must be shared already."""
    if len(mesh.faces) == 0:
        return []
    piece = np.asarray(igl.facet_components(mesh.faces.astype(np.int64))[1]).reshape(-1)
    order = np.argsort(piece, kind="stable")
    ends = np.flatnonzero(np.diff(piece[order])) + 1
    groups = sorted(np.split(order, ends), key=lambda group: int(group[0]))
    return [mesh.submesh(group) for group in groups]
