"""From Gaussian splats to a mesh: visible points on the ridge of their density, then Poisson reconstruction.

Like SuGaR's mesh extraction [G24, Sec. 4.2] without its training: samples along rays around the visible Gaussians, the
first crossing of the level, normals against the gradient. Rays are aimed at the Gaussians, not at pixels: distant
surfaces and those seen at a low angle get as many points as the rest.

SuGaR keeps the level set. It lies in front of the Gaussians by two to three of their thicknesses, more where they
overlap more: an offset that varies from place to place. From the level set, points are moved along their normals to the
ridge of the density, its maximum across the surface, by mean shift [O11]; for flat Gaussians side by side that is the
plane of their centres. If centres scatter about the surface, as in scans, the density has a ridge for each; blurred by
a quarter of their spacing it has a single one. The normal is the direction in which the Gaussians there are thinnest
together. Only surfaces thinner than a cell of the reconstruction stay on the level set, which separates their two
sides.

[G24] Guedon, Lepetit: SuGaR: surface-aligned Gaussian splatting for efficient 3D mesh reconstruction. CVPR 2024.
[K06] Kazhdan, Bolitho, Hoppe: Poisson surface reconstruction. SGP 2006.
[O11] Ozertem, Erdogmus: Locally defined principal curves and surfaces. J. Mach. Learn. Res. 12, 2011.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array, Float32Array
from dcap.geometry.splatting import kernels
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.render import Splatter
from dcap.geometry.splatting.visibility import Progress, best_origins
from dcap.scene.errors import GeometryError
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class SurfacePoints:
    """Points on a surface that cameras have seen."""

    position: Array
    """Positions [m], shape (n, 3)."""
    normal: Array
    """Outward normals, towards the cameras, shape (n, 3)."""
    color: Array
    """sRGB colours 0 to 1, shape (n, 3)."""
    lead: Array
    """Distance of the level set in front of the points, along their normals [m], shape (n,)."""


TARGETS = np.array([[0.0, 0.0], [0.7, 0.0], [-0.7, 0.0], [0.0, 0.7], [0.0, -0.7]])
"""Target points of rays on a Gaussian, in deviations along its larger two axes [-]."""
NEAR_BY = 16
"""Number of points around each point for measuring the spacing."""
ACROSS = 4
"""Number of points on the other side for measuring the thickness."""


def mesh_of_splats(
    splats: Gaussians, config: SurfaceConfig, threads: int = 1, progress: Progress | None = None
) -> Mesh:
    """The visible surface as a mesh, the same for any number of threads. Raises GeometryError if there is none."""
    points = surface_points(splats, config, threads, progress)
    if progress is not None:
        progress(0.5, f"Poisson reconstruction of {len(points.position)} points")
    return reconstructed(points, config, threads)


def surface_points(
    splats: Gaussians, config: SurfaceConfig, threads: int = 1, progress: Progress | None = None
) -> SurfacePoints:
    """Places on the ridge of the density behind the crossings of the level set by rays to every visible Gaussian,
    thinned out."""
    splatter, near = Splatter(splats), _neighbours(splats, config, threads)
    gap = _gaps(splats, near)
    origin = best_origins(splatter, gap, config, progress)
    owner = np.flatnonzero(np.isfinite(origin[:, 0]))
    if not len(owner):
        raise GeometryError("no surface: no splat is visible in any picture")
    found, level, position, normal = _crossings(splatter, owner, origin, near, gap, config)
    if not found.any():
        raise GeometryError(f"no surface: the density of the splats crosses {config.level} nowhere (level)")
    color = np.repeat(splats.color[owner] / 255.0, len(TARGETS), axis=0)
    p, n = position[found].astype(np.float64), normal[found].astype(np.float64)
    return thinned(p, n, color[found], np.einsum("ni,ni->n", level[found] - p, n), config.spacing)


def _neighbours(splats: Gaussians, config: SurfaceConfig, threads: int) -> NDArray[np.int32]:
    """Indices of the nearest Gaussians of each one, including itself, shape (n, k)."""
    count = min(config.neighbours, len(splats))
    _, near = cKDTree(splats.position).query(splats.position, k=count, workers=threads)
    return np.ascontiguousarray(near.reshape(len(splats), count), dtype=np.int32)


def _gaps(splats: Gaussians, near: NDArray[np.int32]) -> Float32Array:
    """Spacing of the Gaussians on the surface around each one [m], shape (n,), as if they filled a disc."""
    radius = np.linalg.norm(splats.position[near[:, -1]] - splats.position, axis=1)
    return np.asarray(radius * np.sqrt(np.pi / near.shape[1]), dtype=np.float32)


def _crossings(
    splatter: Splatter,
    owner: NDArray[np.int64],
    origin: Array,
    near: NDArray[np.int32],
    gap: Float32Array,
    config: SurfaceConfig,
) -> tuple[NDArray[np.bool_], Float32Array, Float32Array, Float32Array]:
    """Rays from the origins to places on the Gaussians' larger two axes: the mask of those that enter the level set and
    face the camera (m,), the crossings, the places on the ridge behind them, and the normals there (m, 3)."""
    splats = splatter.splats
    wide = np.argsort(splats.log_scale[owner], axis=1)[:, :0:-1]
    rows = np.arange(len(owner))
    across = [splatter.axes[owner][rows, :, wide[:, k]] * splatter.scale[owner, wide[:, k]][:, None] for k in range(2)]
    target = splats.position[owner][:, None] + TARGETS[:, :1] * across[0][:, None] + TARGETS[:, 1:] * across[1][:, None]
    start = np.repeat(origin[owner], len(TARGETS), axis=0)
    ray = target.reshape(-1, 3) - start
    distance = np.linalg.norm(ray, axis=1)
    ray /= distance[:, None]
    found, meant = np.zeros(len(ray), dtype=np.int32), np.repeat(owner, len(TARGETS)).astype(np.int32)
    point, normal = np.zeros((2, len(ray), 3), dtype=np.float32)
    whiten = np.ascontiguousarray(splatter.axes.transpose(0, 2, 1) / splatter.scale[:, :, None], dtype=np.float32)
    kernels.cross_level(
        start.astype(np.float32), meant, ray.astype(np.float32), distance.astype(np.float32), splats.position, whiten,
        splatter.opacity, near, config.level, config.reach, config.samples, found, point, normal,
    )  # fmt: skip
    level = point.copy()
    kernels.settle_on_ridge(
        meant, splats.position, splatter.axes, splatter.scale, splatter.opacity, near, config.blur * gap,
        config.rounds, found, point, normal,
    )  # fmt: skip
    return (found != 0) & (np.einsum("ni,ni->n", normal, ray) < 0.0), level, point, normal


def thinned(position: Array, normal: Array, color: Array, lead: Array, spacing: float) -> SurfacePoints:
    """Means over the cells of a grid, separately for the six main directions of normals, so that the two sides of a
    thin board stay separate."""
    cell = np.floor((position - position.min(axis=0)) / spacing).astype(np.int64)
    size = cell.max(axis=0) + 1
    key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 6 + sides(normal)
    _, group, count = np.unique(key, return_inverse=True, return_counts=True)

    def mean(values: Array) -> Array:
        return np.stack([np.bincount(group, column) / count for column in values.T], axis=1)

    turned = mean(normal)
    return SurfacePoints(
        mean(position), turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-9), mean(color),
        mean(lead[:, None])[:, 0],
    )  # fmt: skip


def kept_apart(points: SurfacePoints, cell: float, threads: int = 1) -> Array:
    """Positions (n, 3), moved back to the level set where the two sides of a thin thing are nearer to each other than a
    cell or the spacing of points, and gradually less up to twice that: if the reconstruction confuses the sides, it
    leaves holes."""
    p, n = points.position, points.normal
    if not points.lead.any():
        return p
    count = min(NEAR_BY, len(p))
    distance = cKDTree(p).query(p, k=[count], workers=threads)[0][:, 0]
    least = np.maximum(cell, distance * np.sqrt(np.pi / count))
    far = 2.0 * float(np.quantile(least, 0.99))
    lead, side, share = points.lead.clip(0.0), sides(n), np.zeros(len(p))
    for way in range(6):
        own, other = np.flatnonzero(side == way), np.flatnonzero(side == (way ^ 1))
        if len(own) and len(other):
            tree, k = cKDTree(p[other]), range(1, min(ACROSS, len(other)) + 1)
            away, near = tree.query(p[own], k=k, distance_upper_bound=far, workers=threads)
            near = other[np.minimum(near, len(other) - 1)]  # one past the last means none
            thickness = np.einsum("nki,ni->nk", p[own][:, None] - p[near], n[own])
            # across a narrow gap the sides face each other, and have no thickness at the level set either
            thin = (away < 2.0 * least[own][:, None]) & (thickness + lead[own][:, None] + lead[near] > 0.0)
            share[own] = np.where(thin, 2.0 - thickness / least[own][:, None], 0.0).max(axis=1).clip(0.0, 1.0)
    return np.asarray(p + (share * lead)[:, None] * n)


def sides(normal: Array) -> NDArray[np.int64]:
    """Main direction of each normal (n, 3) among six, two for each axis, shape (n,)."""
    main = np.argmax(np.abs(normal), axis=1)
    return np.asarray(2 * main + (np.take_along_axis(normal, main[:, None], axis=1)[:, 0] > 0.0))


def reconstructed(points: SurfacePoints, config: SurfaceConfig, threads: int = 1) -> Mesh:
    """Poisson reconstruction [K06], without parts that no point supports, decimated and coloured by the points."""
    import open3d

    extent = 1.1 * float(np.ptp(points.position, axis=0).max())
    depth = int(np.clip(np.ceil(np.log2(max(extent / config.cell, 2.0))), 5, config.deepest))
    position = kept_apart(points, extent / 2**depth, threads)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(position))
    cloud.normals = open3d.utility.Vector3dVector(points.normal)
    # one thread: with more, the same points give different bytes
    dense, _ = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    tree = cKDTree(position)
    vertices = np.asarray(dense.vertices)
    distance, _ = tree.query(vertices, workers=threads)
    dense.remove_vertices_by_mask(distance > config.trim * extent / 2**depth)
    if len(dense.triangles) > config.faces:
        dense = dense.simplify_quadric_decimation(config.faces)
    dense.remove_degenerate_triangles()
    dense.remove_duplicated_triangles()
    dense.remove_unreferenced_vertices()
    if not len(dense.triangles):
        raise GeometryError("no surface is left of the splats' reconstruction")
    vertices = np.asarray(dense.vertices)
    _, nearest = tree.query(vertices, k=min(4, len(points.position)), workers=threads)
    color = points.color[nearest.reshape(len(vertices), -1)].mean(axis=1)
    return Mesh.of(vertices, np.asarray(dense.triangles), np.rint(255.0 * color).astype(np.uint8))
