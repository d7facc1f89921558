"""Where a mesh ends: edges without an opposite, the holes they surround, and whether there are any.

In: any set of triangles, welded or not. The boundary is taken as the directed edges whose opposite is missing: exact
also where more than two faces meet at an edge.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.mesh import Mesh

IntArray = NDArray[np.int64]

WELD = 1e-6  # vertices nearer than this [m] are one: duplicates at texture seams are exact, real detail is far larger


def welded(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number of the distinct position of each vertex, shape (n,): equal after rounding to WELD."""
    steps = np.round(vertices / WELD).astype(np.int64).astype(np.uint64)
    with np.errstate(over="ignore"):
        key = steps[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        key ^= (steps[:, 1] + np.uint64(0x7F4A7C15)) * np.uint64(0xC2B2AE3D27D4EB4F)
        key ^= (steps[:, 2] + np.uint64(0x165667B1)) * np.uint64(0x27D4EB2F165667C5)
        key ^= key >> np.uint64(29)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def boundary_edges(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Directed edges without their opposite, as vertex indices (n, 2), and the face each belongs to, shape (n,).

    An edge that n more faces pass in one direction than in the other appears n times.
    """
    weld = welded(mesh.vertices)
    edge = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    start, end = weld[edge].T
    count = int(weld.max(initial=0)) + 1
    key = np.minimum(start, end) * count + np.maximum(start, end)
    forward = np.where(start < end, 1, -1) * (start != end)
    order = np.lexsort((np.arange(len(key)), forward, key))
    group = np.concatenate([[0], np.cumsum(np.diff(key[order]) != 0)]) if len(key) else np.zeros(0, dtype=np.int64)
    surplus = np.bincount(group, weights=forward[order]).astype(int)[group] if len(key) else group
    # within a group the first -1s, then the +1s: keep as many of the majority as there are in excess
    size = np.bincount(group)[group] if len(key) else group
    first = np.cumsum(np.bincount(group))[group] - size if len(key) else group
    rank = np.arange(len(key)) - first
    keep = np.where(surplus > 0, rank >= size - surplus, rank < -surplus)
    chosen = np.sort(order[keep])
    return edge[chosen], chosen // 3


def is_closed(mesh: Mesh) -> bool:
    """Whether every edge is passed as often in one direction as in the other."""
    return len(boundary_edges(mesh)[0]) == 0


def hole_loops(mesh: Mesh) -> list[IntArray]:
    """Closed chains of boundary edges as vertex indices in the direction of the edges."""
    edge, _ = boundary_edges(mesh)
    weld = welded(mesh.vertices)
    leaving: dict[int, list[int]] = {}
    for index, start in enumerate(weld[edge[:, 0]].tolist()):
        leaving.setdefault(start, []).append(index)
    ends = weld[edge[:, 1]].tolist()
    loops: list[IntArray] = []
    used = np.zeros(len(edge), dtype=bool)
    for first in range(len(edge)):
        chain: list[int] = []
        at: dict[int, int] = {}
        index = first
        while not used[index]:
            used[index] = True
            at[int(weld[edge[index, 0]])] = len(chain)
            chain.append(index)
            if ends[index] in at:  # the chain met itself: that part is a loop
                begin = at[ends[index]]
                loops.append(edge[chain[begin:], 0])
                for gone in chain[begin:]:
                    at.pop(int(weld[edge[gone, 0]]), None)
                chain = chain[:begin]
                if not chain:
                    break
            following = [k for k in leaving.get(ends[index], []) if not used[k]]
            if not following:
                break
            index = following[0]
    return loops
