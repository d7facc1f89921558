"""Gaussian splats on the surface of a mesh: as a good scan would have them, or dense and opaque.

`splats_on_mesh` imitates a scan, as ground truth for reconstructions. The opaque discs of an object are all alike and
so dense that nothing shows through.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.raycast import tensor
from dcap.scene.errors import GeometryError
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh

OVERLAP = 0.8
"""Standard deviation along the surface over the distance of neighbours [-]: discs add up to an even, opaque surface."""
FLATNESS = 0.1
"""Standard deviation along the normal over that along the surface [-]."""
JITTER = 0.3
"""Standard deviation of the logarithms of a splat's sizes [-]: in scans no two are equal."""
OPACITY = 0.95
R2 = np.array([0.7548776662466927, 0.5698402909980532])
"""1 / p and 1 / p^2 of the plastic number p (p^3 = p + 1)."""
MOST = 4_000_000
"""Maximum number of splats made at once [-]."""
FaceColors = Callable[[NDArray[np.int64], Array], Array]
"""sRGB colours 0 to 1 (n, 3) at faces (n,) and barycentric weights (n, 3)."""
DISC_OPACITY = 0.99
"""Largest opacity that renderers accept from one Gaussian [-]."""
ROUNDS, NEAR_BY = 6, 8
"""Number of rounds in which discs are pushed apart, and of neighbours that push each [-]."""
PUSH, RADIUS = 0.15, 1.2
"""Share of the overlap removed in a round, and distance below which discs push, in spacings [-]: 1.07 in a regular
lattice."""
DETAIL = 400.0
"""The object's diagonal over the spacing of discs [-]: two pixels of the close-up, which shows the whole object."""
MAX_DISCS = 300_000
"""Maximum number of discs of one object [-]; on a larger surface the discs are larger."""


def splats_on_mesh(mesh: Mesh, spacing: float, seed: int, scatter: float = 0.0) -> Gaussians:
    """One splat per `spacing`^2 [m^2] of surface, spread evenly; same input, same splats. As in a scan they are
    scattered off the surface with the standard deviation `scatter` [m].

    Raises GeometryError for a spacing that would need more than MOST.
    """
    areas = mesh.face_areas
    count = round(float(areas.sum()) / spacing**2)
    if not 0 < count <= MOST:
        raise GeometryError(f"a spacing of {spacing} m makes {count} splats, expected 1 to {MOST}")
    random = np.random.default_rng(seed)
    face, weight = even_points(areas, count, random)
    corners = mesh.corners(face)
    colors = mesh.colors[mesh.faces[face]].astype(np.float64)
    size = np.log(spacing * OVERLAP) + JITTER * random.standard_normal((count, 3))
    size[:, 2] += np.log(FLATNESS)
    color = np.einsum("nk,nkc->nc", weight, colors) / 255.0
    spin = random.uniform(0.0, 2.0 * np.pi, count)
    normal = mesh.face_normals[face] / np.maximum(np.linalg.norm(mesh.face_normals[face], axis=1, keepdims=True), 1e-30)
    off = scatter * random.standard_normal((count, 1))
    return Gaussians(
        (np.einsum("nk,nki->ni", weight, corners) + off * normal).astype(np.float32),
        size.astype(np.float32),
        quaternions_along(normal, spin).astype(np.float32),
        np.full(count, np.log(OPACITY / (1.0 - OPACITY)), dtype=np.float32),
        ((color - 0.5) / DC).astype(np.float32),
        np.zeros((count, 3, 0), dtype=np.float32),
    )


def even_points(areas: Array, count: int, random: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
    """Faces (n,) and barycentric weights (n, 3): one point in each of `count` equal shares of the area, in order of the
    faces, so that no face has more than one point too many."""
    ends = np.cumsum(areas)
    place = (np.arange(count) + random.uniform(0.0, 1.0, count)) / count * ends[-1]
    face = np.minimum(np.searchsorted(ends, place, side="right"), len(areas) - 1)
    # the R2 sequence: consecutive points, which share a face, keep away from each other
    u, v = (random.uniform() + np.arange(count)[:, None] * R2).T % 1.0
    root = np.sqrt(u)
    return face, np.stack([1.0 - root, root * (1.0 - v), root * v], axis=1)


def quaternions_along(normals: Array, spin: Array) -> Array:
    """(w, x, y, z) that turn e_z to each unit normal n (n, 3), after a turn by `spin` [rad] about e_z."""
    n = normals
    # the shortest turn from e_z to n is about e_z x n = (-ny, nx, 0); opposite normals turn about e_x
    q = np.stack([1.0 + n[:, 2], -n[:, 1], n[:, 0], np.zeros(len(n))], axis=1)
    opposite = q[:, 0] < 1e-9
    q[opposite] = [0.0, 1.0, 0.0, 0.0]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    c, s = np.cos(0.5 * spin), np.sin(0.5 * spin)
    w, x, y, z = q.T
    return np.stack([w * c - z * s, x * c + y * s, y * c - x * s, w * s + z * c], axis=1)


def disc_spacing(mesh: Mesh) -> float:
    """Spacing of discs [m] from the object's size, for at most MAX_DISCS discs."""
    size = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    return max(size / DETAIL, float(np.sqrt(mesh.face_areas.sum() / MAX_DISCS)))


def discs_on(mesh: Mesh, spacing: float, colors: FaceColors | None = None) -> Gaussians:
    """Discs about `spacing` [m] apart on a mesh, in its vertices' colours or others; same input, same bytes."""
    area = mesh.face_areas
    count = max(round(float(area.sum()) / spacing**2), 1)
    face, weight = relaxed(mesh, *even_points(area, count, np.random.default_rng(0)), spacing)
    color = (colors or vertex_colors(mesh))(face, weight)
    normal = mesh.face_normals[face] / np.maximum(2.0 * area[face], 1e-30)[:, None]
    size = np.log(spacing * OVERLAP * np.array([1.0, 1.0, FLATNESS]))
    return Gaussians(
        np.einsum("nk,nki->ni", weight, mesh.corners(face)).astype(np.float32),
        np.tile(size.astype(np.float32), (count, 1)),
        quaternions_along(normal, np.zeros(count)).astype(np.float32),
        np.full(count, np.log(DISC_OPACITY / (1.0 - DISC_OPACITY)), dtype=np.float32),
        ((color - 0.5) / DC).astype(np.float32),
        np.zeros((count, 3, 0), dtype=np.float32),
    )


def relaxed(mesh: Mesh, face: NDArray[np.int64], weight: Array, spacing: float) -> tuple[NDArray[np.int64], Array]:
    """The same number of points on a mesh, pushed apart where they are too near to others on the same side."""
    import open3d

    scene, middle = open3d.t.geometry.RaycastingScene(), mesh.bounds.mean(axis=0)
    corner = mesh.vertices - middle
    scene.add_triangles(tensor(corner), tensor(mesh.faces, np.uint32))
    unit = mesh.face_normals / np.maximum(np.linalg.norm(mesh.face_normals, axis=1, keepdims=True), 1e-30)
    for _ in range(ROUNDS):
        place = np.einsum("nk,nki->ni", weight, corner[mesh.faces[face]])
        distance, near = cKDTree(place).query(place, k=NEAR_BY + 1)
        away = place[:, None] - place[near[:, 1:]]
        distance = np.maximum(distance[:, 1:], 1e-3 * spacing)
        same = np.einsum("ni,nki->nk", unit[face], unit[face[near[:, 1:]]]) > 0.0
        push = np.where(same, np.maximum(RADIUS * spacing / distance - 1.0, 0.0), 0.0)
        step = PUSH * np.einsum("nk,nki->ni", push, away)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(0.5 * spacing / np.maximum(length, 1e-30), 1.0)
        found = scene.compute_closest_points(tensor(place + step))
        face = found["primitive_ids"].numpy().astype(np.int64)
        u, v = found["primitive_uvs"].numpy().astype(np.float64).T
        weight = np.stack([1.0 - u - v, u, v], axis=1)
    return face, weight


def vertex_colors(mesh: Mesh) -> FaceColors:
    """The colours of a mesh's vertices, linear over each face."""

    def colors(face: NDArray[np.int64], weight: Array) -> Array:
        return np.asarray(np.einsum("nk,nkc->nc", weight, mesh.colors[mesh.faces[face]] / 255.0))

    return colors
