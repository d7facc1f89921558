"""Convex collision shapes of a surface: its hull, or several hulls that leave its hollows open (CoACD).

In: triangles. Out: closed convex meshes wound outwards. The same input gives the same pieces.
Source: Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree search",
ACM Transactions on Graphics 41(4), 2022.
"""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from dcap.arrays import Array
from dcap.geometry.pieces import is_closed, signed_volume
from dcap.geometry.solid.repair import simplified, subdivide_near
from dcap.scene.types.mesh import Mesh

MOST_VERTICES = 500  # of a surface that is decomposed: that takes seconds, a million faces would take many minutes
CONCAVITY = 0.05  # of a piece at most [-], the library's own measure and its default
MOST_PIECES = 48  # of one surface
NEARLY_CONVEX = 0.01  # share of its hull that a surface may leave open and still be one piece [-]
FLAT = 1e-5  # a solid thinner than this [m] is a sheet, and is given this thickness
OUTSIDE = 1e-5  # a vertex this far out of its piece [m] was lost as the surface was simplified
VOXELS = 30  # along the longest side of a surface that is made a solid for the decomposition
SEED = 0
AT_A_TIME = 20000  # points compared with all planes of a piece: a bounded table


def convex_hull(points: Array) -> Mesh | None:
    """The hull of points (n, 3) [m]; None where they lie in a plane or there are less than four."""
    if len(points) < 4:
        return None
    shift = points.mean(axis=0)
    try:
        hull = ConvexHull(points - shift)
    except QhullError:
        return None
    if hull.volume < FLAT * hull.area / 2.0:
        return None
    faces = hull.simplices.astype(np.int64)
    corner = hull.points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    turned = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0.0
    faces[turned] = faces[turned, ::-1]
    used, inverse = np.unique(faces, return_inverse=True)
    return Mesh.of(hull.points[used] + shift, inverse.reshape(-1, 3))


def slab_hull(mesh: Mesh) -> Mesh | None:
    """The hull of a surface, of a plane one with a little thickness below it; None where it is a line or a point."""
    hull = convex_hull(mesh.vertices)
    if hull is not None or len(mesh.vertices) < 3:
        return hull
    _, _, axes = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), full_matrices=True)
    down = axes[2] * (-1.0 if axes[2, 2] > 0.0 else 1.0)
    return convex_hull(np.concatenate([mesh.vertices, mesh.vertices + 10.0 * FLAT * down]))


def convex_pieces(mesh: Mesh, *, concavity: float = CONCAVITY, most: int = MOST_PIECES) -> list[Mesh]:
    """Convex pieces that cover a surface, hull of all if that is nearly it; empty where it has no extent.

    Args:
        mesh: triangles. One that bounds a solid is decomposed as it is, any other as the solid around it.
        concavity: how much of a hollow a piece may fill [-].
        most: pieces.

    A surface is simplified before it is decomposed: the pieces may miss it by that much (`around_vertices` mends it).
    """
    hull = slab_hull(mesh)
    if hull is None:
        return []
    closed = is_closed(mesh)
    if closed and signed_volume(mesh.vertices, mesh.faces) > (1.0 - NEARLY_CONVEX) * volume_of(hull):
        return [hull]
    return decomposed(simplified(mesh, MOST_VERTICES), concavity, most) or [hull]


def bounds_a_solid(mesh: Mesh) -> bool:
    """Whether a surface is closed, every edge of two faces, and none goes through another: on surfaces that do, the
    library's cuts multiply until no memory is left."""
    import open3d

    if not is_closed(mesh):
        return False
    surface = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.faces)
    )
    surface.merge_close_vertices(1e-9)
    return bool(surface.is_edge_manifold(allow_boundary_edges=False) and not surface.is_self_intersecting())


def decomposed(mesh: Mesh, concavity: float, most: int) -> list[Mesh]:
    """Hulls of the pieces into which the library cuts a surface; empty where it finds none."""
    import coacd  # slow to load, and only after Open3D, which this module's imports have loaded by now

    coacd.set_log_level("error")
    shift = mesh.bounds.mean(axis=0)
    found = coacd.run_coacd(
        coacd.Mesh(mesh.vertices - shift, mesh.faces),
        threshold=concavity,
        max_convex_hull=most,
        preprocess_mode="off" if bounds_a_solid(mesh) else "on",
        preprocess_resolution=VOXELS,
        resolution=1000,
        mcts_nodes=10,
        mcts_iterations=60,
        mcts_max_depth=2,
        seed=SEED,
    )
    hulls = [convex_hull(np.asarray(points, dtype=np.float64) + shift) for points, _ in found]
    return sorted((one for one in hulls if one is not None), key=lambda one: one.vertices.min(axis=0).tolist())


def around_vertices(pieces: list[Mesh], mesh: Mesh) -> list[Mesh]:
    """The pieces fitted to the vertices of the surface: each is the hull of those in it and of those that are nearest
    to it and were left outside. Of a surface that bounds no solid nothing else is kept: that around it was wider."""
    if not pieces:
        return []
    solid = bounds_a_solid(simplified(mesh, MOST_VERTICES))
    fine = mesh if solid else subdivide_near(mesh, mesh.bounds, float(np.ptp(mesh.vertices, axis=0).max()) / VOXELS)
    points = fine.vertices
    away = np.stack([outside(one, points) for one in pieces])
    owner, least = away.argmin(axis=0), away.min(axis=0)
    fitted = []
    for index, one in enumerate(pieces):
        mine = (away[index] <= OUTSIDE) | (owner == index) & (least > OUTSIDE)
        hull = convex_hull(np.concatenate([points[mine], one.vertices if solid else one.vertices[:0]]))
        fitted += [hull] if hull is not None else []
    return fitted


def planes_of(hull: Mesh) -> Array:
    """Outward unit normals and offsets of the faces of a convex mesh, n x = d, shape (m, 4)."""
    normal = hull.face_normals
    length = np.linalg.norm(normal, axis=1)
    keep = length > 1e-12
    unit = normal[keep] / length[keep, None]
    return np.column_stack([unit, np.einsum("ij,ij->i", unit, hull.vertices[hull.faces[keep, 0]])])


def outside(hull: Mesh, points: Array) -> Array:
    """How far points (n, 3) are out of a convex mesh, by its planes, negative inside [m], shape (n,)."""
    planes = planes_of(hull)
    count = max(1, -(-len(points) // AT_A_TIME))
    return np.concatenate(
        [(some @ planes[:, :3].T - planes[:, 3]).max(axis=1) for some in np.array_split(points, count)]
    )


def volume_of(hull: Mesh) -> float:
    """[m^3], of a closed mesh wound outwards."""
    return float(signed_volume(hull.vertices, hull.faces))


def without_box(piece: Mesh, low: Array, high: Array) -> list[Mesh]:
    """A convex piece less a box with corners `low` and `high` (3,) [m]: itself, or at most six convex pieces."""
    bounds = piece.bounds
    if (bounds[0] >= high).any() or (bounds[1] <= low).any():
        return [piece]
    result, rest = [], piece
    for axis in (2, 0, 1):  # what is below and above stays in one piece
        for side, bound in ((1.0, low[axis]), (-1.0, high[axis])):
            plane = side * np.eye(3)[axis]
            cut = half(rest, plane, side * bound)
            if cut is not None:
                result.append(cut)
            kept = half(rest, -plane, -side * bound)
            if kept is None:
                return result
            rest = kept
    return result


def half(piece: Mesh, normal: Array, offset: float) -> Mesh | None:
    """The part of a convex piece where normal . x <= offset; None where that has no volume."""
    height = piece.vertices @ normal - offset
    if (height <= 0.0).all():
        return piece
    start, end = piece.faces[:, [0, 1, 2]].ravel(), piece.faces[:, [1, 2, 0]].ravel()
    crossing = (height[start] < 0.0) & (height[end] > 0.0)
    a, b = start[crossing], end[crossing]
    share = height[a] / (height[a] - height[b])
    points = piece.vertices[a] + share[:, None] * (piece.vertices[b] - piece.vertices[a])
    return convex_hull(np.concatenate([piece.vertices[height <= 0.0], points]))
