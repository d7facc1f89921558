"""Faces as they come into faces that can be closed: welded, without empty and double ones, one way round, no crumbs.

In: any triangles. Out: the same surface with shared vertices, and a count of what was done. No vertex moves
by more than the weld distance.
"""

from itertools import pairwise

import igl
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from dcap.arrays import Array, IntArray
from dcap.geometry.pieces import WELD, boundary_edges, is_closed, welded
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.scene.types.mesh import Mesh

THIN = 0.5 * WELD  # a face whose smallest height is below this [m] is a line: rounding decides its normal
SEAM = 5.0 * WELD  # a border vertex this near to another border edge [m] lies on it: a T-junction
ROUNDS = 4  # a face has three edges to split, one a round, and new edges may need it again
STRAY = 2e-3  # share of the surface below which an open piece of its own is a scrap


def cleaned(mesh: Mesh, log: RepairLog) -> Mesh:
    """The faces welded, without degenerate and duplicate ones, split at T-junctions and wound one way round.

    What was done is counted in `log`.
    """
    mesh = one_vertex_each(mesh, log)
    mesh = without_lines(mesh, log)
    mesh = without_doubles(mesh, log)
    mesh = without_junctions(mesh, log)
    return one_way_round(mesh, log)


def one_vertex_each(mesh: Mesh, log: RepairLog) -> Mesh:
    """Vertices at one place made one; those along open edges also where rounding told them apart."""
    given = len(np.unique(mesh.faces))
    mesh = renumbered(mesh, welded(mesh.vertices))
    rim = np.unique(boundary_edges(mesh)[0])
    pairs = cKDTree(mesh.vertices[rim]).query_pairs(WELD, output_type="ndarray") if len(rim) else np.zeros((0, 2), int)
    if len(pairs):
        count = len(mesh.vertices)
        link = coo_matrix((np.ones(len(pairs)), (rim[pairs[:, 0]], rim[pairs[:, 1]])), shape=(count, count))
        mesh = renumbered(mesh, connected_components(link, directed=False)[1].astype(np.int64))
    log.add(RepairKind.WELDED, times=given - len(mesh.vertices))
    return mesh


def renumbered(mesh: Mesh, number: IntArray) -> Mesh:
    """The mesh with one vertex per number (n,), the first of each."""
    _, first, inverse = np.unique(number, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[mesh.faces].astype(np.int32)
    return Mesh(mesh.vertices[first], faces, mesh.colors[first]).submesh(np.arange(len(faces)))


def without_lines(mesh: Mesh, log: RepairLog) -> Mesh:
    """The mesh without faces that have no area, only length."""
    keep = heights(mesh) > THIN
    log.add(RepairKind.DEGENERATE, times=int((~keep).sum()))
    return mesh if keep.all() else mesh.submesh(np.flatnonzero(keep))


def heights(mesh: Mesh) -> Array:
    """Smallest height of each face [m], shape (m,); 0 of a face with two equal corners."""
    corner = mesh.triangles
    longest = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2).max(axis=1, initial=0.0)
    return np.asarray(2.0 * mesh.face_areas / np.maximum(longest, 1e-300))


def without_doubles(mesh: Mesh, log: RepairLog) -> Mesh:
    """The mesh with one face per three vertices at most.

    Two that face each other are a wall between two solids, and go, if two others meet at the wall's rim; else one
    of them is a mistake, or the two sides of a sheet, and one stays.
    """
    key, net, first = face_stacks(mesh.faces)
    size = np.bincount(key)
    if size.max(initial=0) < 2:
        return mesh
    keep = np.ones(len(size), dtype=bool)
    facing = np.flatnonzero((size > 1) & (net == 0))
    keep[facing] = ~inner_walls(mesh.faces, key, first, facing)
    turned = net * cyclic_sense(mesh.faces)[first] < 0  # the first of the stack is outvoted by the others
    faces = mesh.faces[first]
    faces[turned] = faces[turned][:, ::-1]
    kept = np.sort(first[keep])
    log.add(RepairKind.DUPLICATE, times=len(mesh.faces) - len(kept))
    order = np.argsort(first[keep], kind="stable")
    return Mesh(mesh.vertices, faces[keep][order], mesh.colors).submesh(np.arange(len(kept)))


def cyclic_sense(faces: NDArray[np.integer]) -> IntArray:
    """1 where the vertices of a face run upwards in cyclic order, else -1, shape (m,)."""
    a, b, c = np.sign(np.roll(faces, -1, axis=1).astype(np.int64) - faces).T
    return np.where(a + b + c > 0, 1, -1)


def face_stacks(faces: NDArray[np.int32]) -> tuple[IntArray, IntArray, IntArray]:
    """Number of the vertex triple of each face (m,); per triple the faces one way less the other, and the first."""
    _, first, key = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    key = key.reshape(-1).astype(np.int64)
    net = np.round(np.bincount(key, weights=cyclic_sense(faces))).astype(np.int64)
    return key, net, first.astype(np.int64)


def inner_walls(faces: NDArray[np.int32], key: IntArray, first: IntArray, facing: IntArray) -> NDArray[np.bool_]:
    """Which of the stacks of two faces that face each other are walls inside, shape (k,), patch by patch."""
    single = np.setdiff1d(np.arange(len(first)), facing)
    wall, rest = edge_keys(faces[first[facing]]), edge_keys(faces[first[single]])
    edges, place = np.unique(wall, return_inverse=True)
    place = place.reshape(wall.shape)
    owner = np.repeat(np.arange(len(facing)), 3)
    table = coo_matrix((np.ones(len(owner)), (owner, place.reshape(-1))), shape=(len(facing), len(edges)))
    patch = connected_components(table @ table.T, directed=False)[1]
    sorted_rest = np.sort(rest.reshape(-1))
    others = np.searchsorted(sorted_rest, edges, "right") - np.searchsorted(sorted_rest, edges, "left")
    met = np.bincount(patch, weights=(others[place] >= 2).sum(axis=1))
    lone = np.bincount(patch, weights=(others[place] == 1).sum(axis=1))
    return np.asarray((met > lone)[patch])


def edge_keys(faces: NDArray[np.integer]) -> IntArray:
    """One number for each undirected edge of faces (m, 3), shape (m, 3)."""
    start, end = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    return np.asarray(np.minimum(start, end) * (1 << 31) + np.maximum(start, end))


def without_junctions(mesh: Mesh, log: RepairLog) -> Mesh:
    """The mesh with faces split where a vertex of another border lies on their open edge."""
    for _ in range(ROUNDS):
        split, number = split_at_junctions(mesh)
        if number == 0:
            break
        log.add(RepairKind.JUNCTION, times=number)
        mesh = without_lines(split, RepairLog())
    return mesh


def split_at_junctions(mesh: Mesh) -> tuple[Mesh, int]:
    """The mesh with one open edge of each face split at the border vertices on it, and how many faces that were."""
    edge, face = boundary_edges(mesh)
    if len(edge) == 0:
        return mesh, 0
    rim = np.unique(edge)
    a, b = mesh.vertices[edge[:, 0]], mesh.vertices[edge[:, 1]]
    length = np.linalg.norm(b - a, axis=1)
    near = cKDTree(mesh.vertices[rim]).query_ball_point(0.5 * (a + b), 0.5 * length + SEAM)
    faces: list[tuple[int, int, int]] = []
    gone: set[int] = set()
    for index in np.flatnonzero([len(n) > 2 for n in near]):
        inner = between(mesh.vertices, rim[near[index]], a[index], b[index])
        if len(inner) == 0 or int(face[index]) in gone:
            continue
        start, end = edge[index]
        apex = int(np.setdiff1d(mesh.faces[face[index]], edge[index])[0])
        chain = [int(start), *inner.tolist(), int(end)]
        faces += [(apex, p, q) for p, q in pairwise(chain) if apex not in (p, q)]
        gone.add(int(face[index]))
    if not gone:
        return mesh, 0
    kept = np.delete(mesh.faces, sorted(gone), axis=0)
    return Mesh(
        mesh.vertices, np.concatenate([kept, np.array(faces, dtype=np.int32).reshape(-1, 3)]), mesh.colors
    ), len(gone)


def between(vertices: Array, candidate: IntArray, a: Array, b: Array) -> IntArray:
    """Those candidates that lie on the segment from a to b, in that order, without its ends."""
    way = b - a
    length = float(np.linalg.norm(way))
    along = (vertices[candidate] - a) @ way / length
    off = np.linalg.norm(vertices[candidate] - a - along[:, None] * way / length, axis=1)
    on = (off < SEAM) & (along > SEAM) & (along < length - SEAM)
    return np.asarray(candidate[on][np.argsort(along[on], kind="stable")])


def one_way_round(mesh: Mesh, log: RepairLog) -> Mesh:
    """The mesh with neighbours wound alike: each patch as most of its area was."""
    if len(mesh.faces) == 0:
        return mesh
    faces, patch = igl.bfs_orient(np.ascontiguousarray(mesh.faces, dtype=np.int64))
    faces = np.asarray(faces, dtype=np.int32)
    same = (faces == mesh.faces).all(axis=1)
    # the library may begin a face at another corner: what counts is the cyclic order
    same |= cyclic_sense(faces) == cyclic_sense(mesh.faces)
    area = mesh.face_areas
    patch = np.asarray(patch, dtype=np.int64)
    outvoted = np.bincount(patch, weights=area * np.where(same, 1.0, -1.0)) < 0.0
    turned = same == outvoted[patch]
    log.add(RepairKind.TURNED, times=int(turned.sum()))
    result = mesh.faces.copy()
    result[turned] = result[turned][:, ::-1]
    return Mesh(mesh.vertices, result, mesh.colors)


def without_scraps(pieces: list[Mesh], log: RepairLog) -> list[int]:
    """Which pieces are kept: not the open ones of next to no area."""
    area = np.array([float(p.face_areas.sum()) for p in pieces])
    kept = [i for i, p in enumerate(pieces) if area[i] > STRAY * area.sum() or (len(p.faces) and is_closed(p))]
    if not kept:  # a soup: nothing but scraps is what there is
        return [i for i, a in enumerate(area) if a > 0.0]
    for one in np.setdiff1d(np.arange(len(pieces)), kept):
        log.add(RepairKind.STRAY, float(area[one]))
    return kept
