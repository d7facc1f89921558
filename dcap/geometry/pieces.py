"""The connected pieces of a mesh, their boundaries, and the orientation of the faces of closed pieces.

Boundaries of a mesh: edges without an opposite, and the holes that they surround.

In: any set of triangles, welded or not. The boundary consists of the directed edges whose opposite is missing, which is
exact even if more than two faces meet at an edge.
"""

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from dcap.arrays import Array, IntArray
from dcap.scene.types.mesh import Mesh

WELD = 1e-6  # vertices nearer than this [m] are one: duplicates at texture seams are exact, real detail is far larger

INSIDE = 0.5  # winding number above which a point is inside: halfway between the 0 and 1 of a closed surface
BITS, BIT = 50, 0.2  # more pieces than this, none with more than this share of the area, are a soup [-]


def welded(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the distinct position of each vertex, shape (n,): equal after rounding to WELD."""
    steps = np.round(vertices / WELD).astype(np.int64).astype(np.uint64)
    with np.errstate(over="ignore"):
        key = steps[:, 0] * np.uint64(0x9E3779B97F4A7C15)
        key ^= (steps[:, 1] + np.uint64(0x7F4A7C15)) * np.uint64(0xC2B2AE3D27D4EB4F)
        key ^= (steps[:, 2] + np.uint64(0x165667B1)) * np.uint64(0x27D4EB2F165667C5)
        key ^= key >> np.uint64(29)
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def boundary_edges(mesh: Mesh) -> tuple[IntArray, IntArray]:
    """Directed edges without their opposite, as vertex indices (n, 2), and the face of each edge, shape (n,).

    An edge that is used by n more faces in one direction than in the other appears n times.
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
    # within a group first the -1s, then the +1s: keep the excess of the majority
    size = np.bincount(group)[group] if len(key) else group
    first = np.cumsum(np.bincount(group))[group] - size if len(key) else group
    rank = np.arange(len(key)) - first
    keep = np.where(surplus > 0, rank >= size - surplus, rank < -surplus)
    chosen = np.sort(order[keep])
    return edge[chosen], chosen // 3


def is_closed(mesh: Mesh) -> bool:
    """Return whether every edge is used equally often in both directions."""
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


def components(mesh: Mesh) -> NDArray[np.int64]:
    """Index of the connected piece of each face, shape (m,); faces that share a vertex position are connected."""
    return _connected(welded(mesh.vertices)[mesh.faces])


def index_components(mesh: Mesh) -> NDArray[np.int64]:
    """The same, connected only by vertex index, numbered 0, 1, 2 ..."""
    own = _connected(mesh.faces)
    return np.asarray(np.unique(own, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def _connected(corner: NDArray[np.integer]) -> NDArray[np.int64]:
    """Index of the piece of each triangle (m, 3) of numbered corners, shape (m,)."""
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
    """Pieces that share no vertex with others, have no border and no face in common with another piece, and the rest.

    If sewn together by position, two such shells that touch along edges could not be separated again.
    """
    piece = index_components(mesh)
    place = welded(mesh.vertices)[mesh.faces]
    _, stack, size = np.unique(np.sort(place, axis=1), axis=0, return_inverse=True, return_counts=True)
    mixed = np.bincount(piece, weights=(size[stack.reshape(-1)] > 1) | uneven(mesh.faces)) > 0.0
    rest = np.flatnonzero(mixed[piece])
    apart = [mesh.submesh(np.flatnonzero(piece == one)) for one in np.flatnonzero(~mixed)]
    return [*apart, mesh.submesh(rest)] if len(rest) or not apart else apart


def uneven(faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Mask of the faces with an edge that is not used exactly once in each direction, shape (m,)."""
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    key = np.minimum(start, end) * (1 << 31) + np.maximum(start, end)
    _, number, count = np.unique(key, return_inverse=True, return_counts=True)
    number = number.reshape(-1)
    balance = np.bincount(number, weights=np.sign(end - start).reshape(-1))
    return np.asarray(((count != 2) | (balance != 0.0))[number].reshape(-1, 3).any(axis=1))


def is_soup(mesh: Mesh) -> bool:
    """Return whether a surface consists of so many fragments that none of them shows its shape."""
    area = np.bincount(components(mesh), weights=mesh.face_areas)
    return int((area > 0.0).sum()) > BITS and float(area.max()) < BIT * float(area.sum())


def outward(mesh: Mesh) -> Mesh:
    """The mesh with each closed piece wound outwards.

    A piece inside another one with the opposite orientation is a hollow of it, and keeps its orientation. The open
    pieces are reversed together if they enclose a negative volume.
    """
    piece, is_open = numbered_pieces(mesh)
    volume = np.bincount(piece, weights=cone_volumes(mesh.vertices, mesh.faces), minlength=len(is_open))
    turned = is_open & (volume[is_open].sum() < 0.0)
    if (volume[~is_open] < 0.0).any():
        closed = np.flatnonzero(~is_open)
        turned[closed] = inside_out_shells([mesh.submesh(np.flatnonzero(piece == one)) for one in closed])
    if not turned.any():
        return mesh
    faces = np.where(turned[piece][:, None], mesh.faces[:, ::-1], mesh.faces)
    return Mesh(mesh.vertices, faces, mesh.colors)


def inside_out_shells(shells: list[Mesh]) -> NDArray[np.bool_]:
    """Mask of the closed pieces that have to be reversed, shape (n,): those that lie in no other piece and are wound
    inwards, together with all pieces inside them."""
    volume = np.array([signed_volume(shell.vertices, shell.faces) for shell in shells])
    turned = np.zeros(len(shells), dtype=bool)
    larger: list[int] = []
    for one in np.argsort(-np.abs(volume), kind="stable").tolist():
        around = next((outer for outer in reversed(larger) if _contains(shells[outer], shells[one])), None)
        turned[one] = volume[one] < 0.0 if around is None else turned[around]
        larger.append(one)
    return turned


def _contains(outer: Mesh, inner: Mesh) -> bool:
    """Return whether all vertices of one closed piece lie inside another one."""
    low, high = outer.bounds
    if not ((inner.bounds[0] >= low).all() and (inner.bounds[1] <= high).all()):
        return False
    faces = np.ascontiguousarray(outer.faces, dtype=np.int64)
    number = igl.fast_winding_number(outer.vertices, faces, np.ascontiguousarray(inner.vertices))
    return bool((np.abs(number) > INSIDE).all())


def numbered_pieces(mesh: Mesh) -> tuple[IntArray, NDArray[np.bool_]]:
    """Index of the connected piece of each face, 0, 1, 2 ..., shape (m,), and the mask of open pieces, shape (pieces,).

    Connected by vertex index if all pieces are closed that way, which separates touching shells; otherwise by position.
    """
    own = components(mesh) if uneven(mesh.faces).any() else index_components(mesh)
    piece = np.unique(own, return_inverse=True)[1].reshape(-1).astype(np.int64)
    is_open = np.zeros(int(piece.max(initial=-1)) + 1, dtype=bool)
    is_open[piece[boundary_edges(mesh)[1]]] = True
    return piece, is_open


def cone_volumes(vertices: Array, faces: NDArray[np.integer]) -> Array:
    """Signed volume between each face and the middle of all vertices [m^3], shape (m,)."""
    if len(faces) == 0:
        return np.zeros(0)
    center = vertices[np.unique(faces)].mean(axis=0)
    a, b, c = (vertices[faces] - center).transpose(1, 0, 2)
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


def signed_volume(vertices: Array, faces: NDArray[np.integer]) -> float:
    """Volume enclosed by consistently wound faces [m^3], negative if they are wound inside out."""
    return float(cone_volumes(vertices, faces).sum())
