"""Gaussian splats on the surface of a mesh: flat discs in the colours of its vertices, as a good scan of it would have.

Known geometry as splats, so that what is reconstructed from them can be compared with it.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

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
"""Splats that are made at once [-]."""


def splats_on_mesh(mesh: Mesh, spacing: float, seed: int, scatter: float = 0.0) -> Gaussians:
    """One splat per `spacing`^2 [m^2] of surface, spread evenly; same input, same splats. As in a scan they lie off the
    surface by the standard deviation `scatter` [m].

    Raises GeometryError for a spacing that would make more than MOST.
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
    faces, so that no face has more than one too many."""
    ends = np.cumsum(areas)
    place = (np.arange(count) + random.uniform(0.0, 1.0, count)) / count * ends[-1]
    face = np.minimum(np.searchsorted(ends, place, side="right"), len(areas) - 1)
    # the R2 sequence: neighbours in order, which share a face, keep away from each other
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
