"""From a point cloud to a mesh: the outer side of each point, then Poisson reconstruction as for splats.

Points are discs viewed by cameras, like Gaussian splats: inside a room, or all around anything else. A point's normal
is that of the plane through its neighbours, towards the cameras that see it; points that no camera sees follow their
neighbours. Nothing depends on a tree through all points, which would reverse whole walls at one wrong edge. Normals
from the source are compared with the views of the cameras before they are trusted.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.discs import FLATNESS, OPACITY, OVERLAP, quaternions_along
from dcap.geometry.splatting.render import Splatter
from dcap.geometry.splatting.surface import SurfacePoints, reconstructed, sides, thinned
from dcap.geometry.splatting.viewpoints import FOV_DEG, outer_places, viewpoints
from dcap.geometry.splatting.visibility import Progress, sightings
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import LocalPlanes, PointCloud, local_planes

MOST = 1_000_000
"""Maximum number of points used; more are thinned out [-]."""
LOOKED_AT = 150_000
"""... and maximum number of these that cameras look at [-]."""
STRAY = 10.0
"""Factor on the usual distance of neighbours beyond which a point is stray [-]."""
ROOM_METRES = (1.5, 2.2)
"""Least smallest and middle extent of a room [m]: larger than any single piece of furniture."""
HALF_OPEN = 0.45
"""Share of directions with points from which a place is inside a room [-]: a floor and two walls."""
THING_DIAGONAL = 2.0
"""Diagonal to which single things are scaled for viewing [m]: cameras see nothing that is very near."""
BOTH_SIDES = 0.5
"""Least lead of one side, as a share of the votes [-]; below it the neighbours decide."""
AGREES = 0.8
"""Least share of the given normals that point to the cameras, or all away from them, for them to be trusted [-]."""
ROUNDS = 200
"""Maximum number of steps from point to point in which sides spread."""
CARRIED = 3
"""Number of viewed points that determine the side of an unviewed one."""
BESIDE = 8
"""Number of neighbours from which a side spreads."""


@dataclass(frozen=True, eq=False, slots=True)
class Oriented:
    """Points with outward normals."""

    normal: Array
    """Unit normals, shape (n, 3)."""
    note: str
    """Origin of the normals."""


def mesh_of_points(
    cloud: PointCloud, config: SurfaceConfig, *, single: bool, threads: int = 1, progress: Progress | None = None
) -> tuple[Mesh, tuple[str, ...]]:
    """The surface through the points, the same for any number of threads, and the assumptions made.

    `single`: a thing that is seen from outside, whatever its size. Raises GeometryError if nothing is left of it.
    """
    extent = 1.1 * float(np.subtract(*np.quantile(cloud.position, [0.999, 0.001], axis=0)).max())
    finest = extent / 2**config.deepest
    points, notes = without_strays(evenly_thinned(cloud, 0.5 * finest, MOST), threads)
    planes = local_planes(points.position, threads)
    spacing, scatter = float(np.median(planes.gap)), float(np.median(planes.scatter))
    cell = max(finest, 1.5 * spacing)
    oriented = oriented_normals(points, planes, config, single=single, threads=threads, progress=progress)
    if progress is not None:
        progress(0.5, f"Poisson reconstruction of {len(points)} points")
    none = np.zeros(len(points))
    even = thinned(points.position, oriented.normal, points.color / 255.0, none, 0.75 * cell)
    mesh = reconstructed(even, config.model_copy(update={"cell": cell}), threads)
    thinning = (
        f"{len(cloud)} points, {1e3 * spacing:.2g} mm apart after thinning, off their surface by about "
        f"{1e3 * scatter:.2g} mm; cells of the reconstruction {1e3 * cell:.2g} mm"
    )
    return mesh, (
        *notes,
        thinning,
        oriented.note,
        closed_note(mesh, even, cell, config, threads),
    )


def evenly_thinned(cloud: PointCloud, spacing: float, most: int) -> PointCloud:
    """Means over the cells of a grid, of a larger one if more than `most` would be left; separately for the six main
    directions of given normals."""
    side = np.zeros(len(cloud), dtype=np.int64) if cloud.normal is None else sides(cloud.normal)
    while True:
        cell = np.floor((cloud.position - cloud.position.min(axis=0)) / spacing).astype(np.int64)
        size = cell.max(axis=0) + 1
        key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 6 + side
        _, group, count = np.unique(key, return_inverse=True, return_counts=True)
        if len(count) <= most:
            break
        spacing *= max(float(np.sqrt(len(count) / most)), 1.05)  # cells of a surface go with the square

    def mean(values: NDArray[np.generic]) -> Array:
        return np.stack([np.bincount(group, column) / count for column in values.T], axis=1)

    normal = None
    if cloud.normal is not None:
        normal = mean(cloud.normal)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    return PointCloud(mean(cloud.position), np.rint(mean(cloud.color)).astype(np.uint8), normal)


def without_strays(cloud: PointCloud, threads: int) -> tuple[PointCloud, tuple[str, ...]]:
    """The cloud without points far from all others, and a note on their number."""
    count = min(BESIDE + 1, len(cloud))
    away = cKDTree(cloud.position).query(cloud.position, k=[count], workers=threads)[0][:, 0]
    kept = away <= STRAY * np.median(away)
    gone = int((~kept).sum())
    if not gone:
        return cloud, ()
    return cloud.subset(kept), (f"{gone} points far from all others are left out",)


def oriented_normals(
    cloud: PointCloud,
    planes: LocalPlanes,
    config: SurfaceConfig,
    *,
    single: bool,
    threads: int = 1,
    progress: Progress | None = None,
) -> Oriented:
    """Normals towards the inside of a room, or outwards for a thing seen from outside."""
    axis = planes.normal if cloud.normal is None else cloud.normal
    room = not single and is_room(cloud)
    toward = "towards the inside of the room" if room else "outwards"
    few = evenly_thinned(replace(cloud, normal=axis), float(np.median(planes.gap)), LOOKED_AT)
    coarse = local_planes(few.position, threads)
    assert few.normal is not None
    votes = camera_votes(few, coarse.gap, config, room=room, single=single, progress=progress)
    if cloud.normal is not None and votes.any():
        agree = float((votes[votes != 0.0] > 0.0).mean())
        if max(agree, 1.0 - agree) >= AGREES:
            turned = "" if agree > 0.5 else f", reversed because they did not point {toward}"
            return Oriented(axis if agree > 0.5 else -axis, f"the file's normals are used{turned}")
    few_sign = spread_sides(votes, few.normal, coarse.near[:, 1 : BESIDE + 1])
    _, near = cKDTree(few.position).query(cloud.position, k=range(1, CARRIED + 1), workers=threads)
    same = np.einsum("nki,ni->nk", few.normal[near], axis)
    sign = np.sign((few_sign[near] * same).sum(axis=1))
    middle = 0.5 * (cloud.position.min(axis=0) + cloud.position.max(axis=0))
    inward = np.where(np.einsum("ni,ni->n", middle - cloud.position, axis) < 0.0, -1.0, 1.0)
    sign = np.where(sign == 0.0, inward if room else -inward, sign)
    how = f"no normals in the file: estimated from neighbours and turned {toward}"
    if cloud.normal is not None:
        how = f"the file's normals point both ways: each is turned {toward}"
    return Oriented(sign[:, None] * axis, how)


def is_room(cloud: PointCloud) -> bool:
    """Return whether the points, in metres, extend too far for a single thing."""
    extent = np.sort(np.subtract(*np.quantile(cloud.position, [0.995, 0.005], axis=0)))
    return bool(extent[0] >= ROOM_METRES[0] and extent[1] >= ROOM_METRES[1])


def camera_votes(
    cloud: PointCloud, gap: Array, config: SurfaceConfig, *, room: bool, single: bool, progress: Progress | None
) -> Array:
    """1 if a point's normal faces the cameras that see it, -1 if it faces away, 0 for neither or both, shape (n,)."""
    diagonal = float(np.linalg.norm(np.subtract(*np.quantile(cloud.position, [0.995, 0.005], axis=0))))
    scale = 1.0 if room else THING_DIAGONAL / diagonal
    discs = discs_of(cloud, gap, scale)
    if room:
        cameras = viewpoints(discs, config.places, config.pixels, enclosed=HALF_OPEN)
    else:
        cameras = outer_cameras(discs, config, single=single)
    ahead, seen_at_all = np.zeros(len(cloud)), np.zeros(len(cloud))
    for seen in sightings(Splatter(discs), (scale * gap).astype(np.float32), cameras, config, progress):
        ahead[seen.index] += seen.cosine
        seen_at_all[seen.index] += np.abs(seen.cosine)
    return np.where(np.abs(ahead) > BOTH_SIDES * seen_at_all, np.sign(ahead), 0.0)


def discs_of(cloud: PointCloud, gap: Array, scale: float) -> Gaussians:
    """A flat Gaussian for each point, wide enough to overlap its neighbours."""
    count = len(cloud)
    assert cloud.normal is not None
    wide = np.log(np.maximum(scale * gap * OVERLAP, 1e-9))
    return Gaussians(
        (scale * cloud.position).astype(np.float32),
        np.stack([wide, wide, wide + np.log(FLATNESS)], axis=1).astype(np.float32),
        quaternions_along(cloud.normal, np.zeros(count)).astype(np.float32),
        np.full(count, np.log(OPACITY / (1.0 - OPACITY)), dtype=np.float32),
        ((cloud.color / 255.0 - 0.5) / DC).astype(np.float32),
        np.zeros((count, 3, 0), dtype=np.float32),
    )


def outer_cameras(discs: Gaussians, config: SurfaceConfig, *, single: bool) -> list[Camera]:
    """Views from all around; for a scene, which stands on something, only from above its middle."""
    places, center = outer_places(discs, 3 * config.places, np.radians(FOV_DEG))
    if not single:
        places = places[places[:, 2] >= center[2]]
    return [looking_at(p, center, config.pixels, config.pixels, fov_deg=FOV_DEG) for p in places]


def spread_sides(sign: Array, axis: Array, near: NDArray[np.int64]) -> Array:
    """Signs (n,) of the axes (n, 3), where zeros get the sign of their neighbours (n, k); 0 if no neighbour leads to
    one."""
    sign = sign.copy()
    for _ in range(ROUNDS):
        open_ = np.flatnonzero(sign == 0.0)
        if not len(open_):
            break
        beside = near[open_]
        same = np.einsum("nki,ni->nk", axis[beside], axis[open_])
        found = np.sign((sign[beside] * same).sum(axis=1))
        if not found.any():
            break
        sign[open_] = found
    return sign


def closed_note(mesh: Mesh, points: SurfacePoints, cell: float, config: SurfaceConfig, threads: int) -> str:
    """Note on the share of the surface that spans holes between the points."""
    middle = mesh.triangles.mean(axis=1)
    area = mesh.face_areas
    away, _ = cKDTree(points.position).query(middle, workers=threads)
    share = float(area[away > 2.0 * cell].sum() / area.sum())
    most = 2e3 * config.trim * cell
    return (
        f"holes up to about {most:.2g} mm across are closed, {100 * share:.2g} % of the surface; wider ones stay open"
    )
