"""Light repairs: holes, solids under open surfaces, finer faces where they are needed, mass properties.

In: meshes as scanned or modelled, welded or not, closed or not. Out: meshes and numbers fit for simulation. Faces are
never moved. The boundary of a mesh is taken as the directed edges whose opposite is missing: exact for any set of
triangles.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.geometry.distance import MeshDistance, lattice
from dcap.geometry.pieces import WELD, boundary_edges, hole_loops, is_closed, signed_volume, welded
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh

LEAST_FILLED = 1e-6  # share of its box that a closed mesh fills at least; less is rounding of a sheet with two sides
FILL_SAMPLES = 72  # samples along the longest side when an open mesh is measured by filling: volume within about 1 %
RELIEF = 1.3e-3  # share of a surface's height differences that its shadow keeps
MOST_ROUNDS = 14  # halvings of an edge: a 10 m edge down to under a millimetre
MOST_ADDED = 400_000  # faces that refining adds, where no smaller budget is given


def small_holes_capped(mesh: Mesh, perimeter: float) -> Mesh:
    """The mesh with every hole of at most the given perimeter [m] closed by a fan around its middle."""
    vertices, faces, colors = [mesh.vertices], [mesh.faces], [mesh.colors]
    count = len(mesh.vertices)
    for loop in hole_loops(mesh):
        points = mesh.vertices[loop]
        if len(loop) < 3 or np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum() > perimeter:
            continue
        vertices.append(points.mean(axis=0)[None])
        colors.append(np.round(mesh.colors[loop].mean(axis=0)).astype(np.uint8)[None])
        # against the direction of the boundary, so that the fan continues the surface
        fan = np.stack([np.roll(loop, -1), loop, np.full(len(loop), count)], axis=1)
        faces.append(fan.astype(np.int32))
        count += 1
    return Mesh(np.concatenate(vertices), np.concatenate(faces), np.concatenate(colors))


def solid_under(mesh: Mesh, bottom: Array) -> Mesh:
    """The closed surface of everything that lies under the faces, down to `bottom` [m], one height per face, shape
    (m,).

    Each face is joined with its reversed shadow at its own bottom height, and the open edges with vertical walls. A
    face that looks down takes away what lies under it, so a closed mesh encloses what it did before; walls and
    shadows inside cancel in the winding number and `outer_faces` removes them. Shadows keep a thousandth of their
    faces' relief, so that no two coincide. The wall under an upright edge has no area; it stays, because without it the
    edges above and below would have no opposite.
    """
    pieces = [mesh]
    for height in np.unique(bottom):
        group = mesh.submesh(np.flatnonzero(bottom == height))
        shadow = group.vertices.copy()
        shadow[:, 2] = height + RELIEF * (group.vertices[:, 2] - group.vertices[:, 2].min())
        pieces.append(Mesh(shadow, group.faces[:, ::-1].copy(), group.colors))
        edge, _ = boundary_edges(group)
        top, low = group.vertices[edge], shadow[edge]
        # the wall passes the open edge against its direction
        corner = np.stack([top[:, 1], top[:, 0], low[:, 0], low[:, 1]], axis=1).reshape(-1, 3)
        quad = 4 * np.arange(len(edge))[:, None]
        faces = np.concatenate([quad + np.array(corners) for corners in ((0, 1, 2), (0, 2, 3))])
        pieces.append(Mesh.of(corner, faces, group.colors[edge[:, [1, 0, 0, 1]].reshape(-1)] if len(edge) else None))
    return Mesh.concatenate(pieces)


def outer_faces(mesh: Mesh, *, step: float = 2e-4) -> IntArray:
    """Faces with inside on one side and outside on the other somewhere: the surface of the union; `step` [m] off
    the face. Faces without area have no sides.
    """
    normal = mesh.face_normals
    length = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(length, np.finfo(float).tiny)[:, None]
    field = MeshDistance(mesh, sides=mesh)
    corner = mesh.triangles
    outer = np.zeros(len(mesh.faces), dtype=bool)
    # the middle, and points near the corners: a face may be covered in part
    for weight in ([1 / 3, 1 / 3, 1 / 3], [0.96, 0.02, 0.02], [0.02, 0.96, 0.02], [0.02, 0.02, 0.96]):
        asked = np.flatnonzero(~outer & (length > 0.0))
        point = np.einsum("k,nki->ni", np.array(weight), corner[asked])
        outer[asked] = field.inside(point + step * normal[asked]) != field.inside(point - step * normal[asked])
    return np.flatnonzero(outer)


def subdivide_near(mesh: Mesh, region: Array, edge: float, most_added: int = MOST_ADDED) -> Mesh:
    """Split faces that reach into a box until their edges are at most `edge` [m]; colours are interpolated.

    `region` is the box's lower and upper corner [m], shape (2, 3). Where that would take more than `most_added` new
    faces, the longest edges are split first, and those stay longer that the budget does not reach (`longest_near`).
    Conforming: an edge is split for all its faces or for none, also across duplicated vertices. Faces keep their plane.
    """
    most = len(mesh.faces) + most_added
    fine, whole = split_while_affordable(mesh, region, edge, most, least_share=0.0)
    return fine if whole else split_while_affordable(mesh, region, edge, most, least_share=0.5)[0]


def split_while_affordable(
    mesh: Mesh, region: Array, edge: float, most_faces: int, *, least_share: float
) -> tuple[Mesh, bool]:
    """Halve the edges near a box that are longer than `edge` [m], in each round those of at least `least_share` of the
    longest; and whether `most_faces` allowed all of it."""
    for _ in range(MOST_ROUNDS):
        length = edges_near(mesh, region)
        longest = float(length.max(initial=0.0))
        long = length > max(edge * (1.0 + 1e-9), least_share * longest)
        if not long.any():
            return mesh, True
        finer, _ = split_edges(mesh, long)
        if len(finer.faces) > most_faces:
            return mesh, False
        mesh = finer
    return mesh, True


def edges_near(mesh: Mesh, region: Array) -> Array:
    """Lengths of the edges of each face that reaches into a box (2, 3) [m], zero for the others, shape (m, 3)."""
    corner = mesh.triangles
    near = ((corner.max(axis=1) >= region[0]) & (corner.min(axis=1) <= region[1])).all(axis=1)
    return np.asarray(np.where(near[:, None], np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2), 0.0))


def longest_near(mesh: Mesh, region: Array) -> float:
    """Longest edge of the faces that reach into a box (2, 3) [m]."""
    return float(edges_near(mesh, region).max(initial=0.0))


def split_edges(mesh: Mesh, marked: NDArray[np.bool_]) -> tuple[Mesh, IntArray]:
    """Split the marked edges (m, 3) (edge k runs from corner k to k + 1) at their middles, and their faces with them.

    Returns the mesh and the face that each of its faces came from.
    """
    weld = welded(mesh.vertices)
    start, end = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
    count = len(mesh.vertices)
    place = np.minimum(weld[start], weld[end]) * count + np.maximum(weld[start], weld[end])
    marked = np.isin(place, place[marked])  # the same edge of every face that has it
    own = np.minimum(start, end) * count + np.maximum(start, end)
    made, middle = np.unique(own[marked], return_inverse=True)
    a, b = made // count, made % count
    vertices = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[a] + mesh.vertices[b])])
    mixed = (mesh.colors[a].astype(np.uint16) + mesh.colors[b] + 1) // 2
    colors = np.concatenate([mesh.colors, mixed.astype(np.uint8)])
    point = np.full(marked.shape, -1, dtype=np.int64)
    point[marked] = count + middle.reshape(-1)
    faces, origin = split_faces(mesh.faces, marked, point, vertices)
    return Mesh(vertices, faces, colors), origin


def split_faces(
    faces: NDArray[np.int32], marked: NDArray[np.bool_], point: IntArray, vertices: Array
) -> tuple[NDArray[np.int32], IntArray]:
    """Faces with 0 to 3 new points on their edges as 1 to 4 faces, in the order of the faces they come from; and
    those.
    """
    number = marked.sum(axis=1)
    # turn each face so that the odd edge comes first: the only split one, or the only whole one
    turn = np.where(number == 1, np.argmax(marked, axis=1), np.where(number == 2, np.argmin(marked, axis=1), 0))
    index = (turn[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces.astype(np.int64), index, axis=1).T
    ab, bc, ca = np.take_along_axis(point, index, axis=1).T
    one, two, three = (np.flatnonzero(number == n) for n in (1, 2, 3))
    rows = [(np.flatnonzero(number == 0), faces[number == 0].astype(np.int64))]
    rows += [(one, np.stack([a, ab, c], 1)[one]), (one, np.stack([ab, b, c], 1)[one])]
    rows += [(two, np.stack([bc, c, ca], 1)[two])]
    # the remaining quadrangle a, b, bc, ca along its shorter diagonal
    short = np.linalg.norm(vertices[a] - vertices[bc], axis=1) <= np.linalg.norm(vertices[b] - vertices[ca], axis=1)
    left, right = two[short[two]], two[~short[two]]
    rows += [(left, np.stack([a, b, bc], 1)[left]), (left, np.stack([a, bc, ca], 1)[left])]
    rows += [(right, np.stack([a, b, ca], 1)[right]), (right, np.stack([b, bc, ca], 1)[right])]
    for corners in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)):
        rows.append((three, np.stack(corners, 1)[three]))
    origin = np.concatenate([r[0] for r in rows])
    order = np.argsort(origin, kind="stable")
    return np.concatenate([r[1] for r in rows])[order].astype(np.int32), origin[order]


def mass_properties(mesh: Mesh, density: float) -> tuple[float, Array, Array]:
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2] of a solid of the given density [kg/m^3].

    Exact for a closed mesh; an open one is filled first where its winding number exceeds one half.
    """
    if not is_closed(mesh):
        volume, center, second = filled_moments(mesh)
        return density * volume, center, density * (np.trace(second) * np.eye(3) - second)
    enclosed = signed_volume(mesh.vertices, mesh.faces)
    if abs(enclosed) <= LEAST_FILLED * float(np.prod(np.ptp(mesh.bounds, axis=0))):
        raise GeometryError(f"a closed mesh of {len(mesh.faces)} faces encloses no volume: a sheet, not a solid")
    middle = mesh.bounds.mean(axis=0)  # about the origin digits would cancel
    import trimesh  # a quarter of a second, for which nobody waits whose results are cached

    found = trimesh.triangles.mass_properties(mesh.triangles - middle, density=density)
    sign = 1.0 if enclosed > 0.0 else -1.0  # wound inside out it is the same solid
    return sign * found.mass, middle + np.asarray(found.center_mass), sign * np.asarray(found.inertia)


def volume(mesh: Mesh) -> float:
    """Enclosed volume [m^3], of an open mesh by filling it."""
    return mass_properties(mesh, 1.0)[0]


def filled_moments(mesh: Mesh) -> tuple[float, Array, Array]:
    """Volume, centroid and second moments about it of an open mesh, from samples inside.

    Raises GeometryError for a sheet that encloses nothing.
    """
    low, high = mesh.bounds
    spacing = float((high - low).max()) / FILL_SAMPLES
    if spacing == 0.0:
        raise GeometryError(f"a mesh of {len(mesh.faces)} faces without extent has no volume")
    shape = np.ceil((high - low) / spacing).astype(int) + 2
    points = lattice(low - 0.5 * spacing, spacing, shape)
    distance = MeshDistance(mesh)(points)
    share = np.clip(0.5 - distance / spacing, 0.0, 1.0)
    # a sheet is within half a sample of itself everywhere: that is not an inside
    if not (distance < -0.25 * spacing).any():
        raise GeometryError(
            f"a mesh of {len(mesh.faces)} faces encloses no volume at {1e3 * spacing:.2g} mm: a sheet, not a solid"
        )
    total = float(share.sum())
    center = share @ points / total
    arm = points - center
    cell = spacing**3
    second = cell * (np.einsum("i,ij,ik->jk", share, arm, arm) + total * spacing**2 / 12.0 * np.eye(3))
    return cell * total, center, second


def simplified(mesh: Mesh, most_vertices: int) -> Mesh:
    """The mesh with about `most_vertices` vertices by quadric edge collapse, itself if it has no more."""
    import open3d

    if len(mesh.vertices) <= most_vertices:
        return mesh
    dense = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices), open3d.utility.Vector3iVector(mesh.faces)
    )
    dense.vertex_colors = open3d.utility.Vector3dVector(mesh.colors / 255.0)
    dense.merge_close_vertices(WELD)
    coarse = dense.simplify_quadric_decimation(2 * most_vertices)
    colors = np.round(255.0 * np.asarray(coarse.vertex_colors)).astype(np.uint8)
    return Mesh.of(np.asarray(coarse.vertices), np.asarray(coarse.triangles), colors)


def without_empty_faces(mesh: Mesh) -> Mesh:
    """The mesh without faces of zero area."""
    keep = mesh.face_areas > 0.0
    return mesh if keep.all() else replace(mesh, faces=mesh.faces[keep])
