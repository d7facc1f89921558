"""Simulated scans of a room: a noisy coloured mesh with holes, or the fused pictures of a depth camera.

In: surfaces tagged with instance and part. Out: one mesh in which faces hidden inside other solids or lying on the
floor are absent, displaced by smooth and fine noise of about a millimetre, with a few small holes, its faces in
random order; and the truth, which surface each face belongs to.

Simulates a scan of an embedded room by a moving depth camera: one noisy surface without names.

In: a room's mesh. Out: the surface fused from depth images at eye height [C96]: unseen surfaces are missing, touching
things are one surface, edges are round, colours are blurred.

[C96] Curless, Levoy: A volumetric method for building complex models from range images. SIGGRAPH 1996.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import open3d
from numpy.typing import NDArray
from open3d import core
from open3d.t import geometry
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster, tensor
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import smooth_noise
from dcap.synthetic.schema import RecipeModel

ON_FLOOR = 0.003
"""Height below which downward faces lie on the floor, unseen by any camera [m]."""

VOXEL = 0.02
"""Voxel size of the fused volume [m]: the resolution of phones."""
BLOCK, BLOCKS = 16, 20_000
"""Number of voxels along an edge of a block, and initial number of blocks [-]."""
LEAST_SEEN = 3.0
"""Least number of cameras that have seen a point of the surface [-]."""
NOISE = 0.004
"""Standard deviation of depth at one metre, growing with its square [m]."""
EYES = 1.5
"""Height of the camera above the lowest point [m]."""
WIDTH, HEIGHT, FOV_DEG = 240, 180, 75.0
STANDS, TURNS = 3, 8
"""Places along each horizontal axis, and views from each of them [-]."""
FARTHEST = 6.0
"""Largest depth [m]."""


class ScanDefects(RecipeModel):
    """Defects of a scanned surface: noise along its normals, and holes."""

    smooth_noise: NonNegativeFloat = 0.0008
    """Standard deviation of the long-waved noise [m]."""
    rough_noise: NonNegativeFloat = 0.0004
    """Standard deviation of the short-waved noise [m]."""
    fine_noise: NonNegativeFloat = 0.0002
    """Standard deviation of the independent noise per vertex [m]."""
    sheet_noise: NonNegativeFloat = 0.02
    """Share of the noise on walls, floor and ceiling: large planes are scanned flatter [-]."""
    hole_count: NonNegativeInt = 9
    hole_radius: tuple[PositiveFloat, PositiveFloat] = (0.012, 0.03)
    """Smallest and largest hole [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class ScanSurface:
    """A piece of the room's surface."""

    mesh: Mesh
    instance: int
    """Index of the thing it belongs to."""
    part: str
    closed: bool
    """Whether the piece is a solid that hides its inside; False for the sheets of walls, floor and ceiling."""


@dataclass(frozen=True, eq=False, slots=True)
class RoomScan:
    """The scan and its truth."""

    mesh: Mesh
    face_instance: NDArray[np.int32]
    """Index of the instance of each face, shape (m,)."""
    face_part: NDArray[np.object_]
    """Part name of each face, shape (m,)."""


def scan(surfaces: Sequence[ScanSurface], seed: int, defects: ScanDefects) -> RoomScan:
    """Scan a room."""
    rng = np.random.default_rng(seed)
    visible = [replace(s, mesh=s.mesh.submesh(np.flatnonzero(kept))) for s, kept in
               zip(surfaces, _visible(surfaces), strict=True)]  # fmt: skip
    mesh = Mesh.concatenate([s.mesh for s in visible])
    counts = [len(s.mesh.faces) for s in visible]
    instance = np.repeat(np.array([s.instance for s in visible], dtype=np.int32), counts)
    part = np.repeat(np.array([s.part for s in visible], dtype=object), counts)
    vertex_counts = [len(s.mesh.vertices) for s in visible]
    calm = np.repeat([1.0 if s.closed else defects.sheet_noise for s in visible], vertex_counts)
    mesh = _noisy(mesh, calm, seed, defects, rng)
    order = rng.permutation(np.flatnonzero(~_holes(mesh, defects, rng)))
    return RoomScan(_compact(mesh, order, rng), instance[order], part[order])


def _visible(surfaces: Sequence[ScanSurface]) -> list[NDArray[np.bool_]]:
    """Per surface, the faces that reach out of all other solids and do not lie on the floor.

    A face is hidden if its centre and its three corners are inside other solids: faces at a border stay, so that no gap
    opens.
    """
    centers = [s.mesh.triangles.mean(axis=1) for s in surfaces]
    points = [np.concatenate([c, s.mesh.vertices]) for s, c in zip(surfaces, centers, strict=True)]
    hidden = [np.zeros(len(p), dtype=bool) for p in points]
    bounds = np.array([s.mesh.bounds for s in surfaces])
    for index, solid in enumerate(surfaces):
        if solid.closed:
            _mark_inside(index, solid.mesh, points, bounds, hidden)
    kept = []
    for surface, center, inside in zip(surfaces, centers, hidden, strict=True):
        count = len(center)
        covered = inside[:count] & inside[count:][surface.mesh.faces].all(axis=1)
        kept.append(~covered & ~((center[:, 2] < ON_FLOOR) & (surface.mesh.face_normals[:, 2] < 0)))
    return kept


def _mark_inside(index: int, solid: Mesh, points: list[Array], bounds: Array, hidden: list[NDArray[np.bool_]]) -> None:
    """Mark the points of all other surfaces that lie in one solid."""
    low, high = bounds[index]
    near = np.flatnonzero((bounds[:, 0] <= high).all(axis=1) & (bounds[:, 1] >= low).all(axis=1))
    asked = [(j, np.flatnonzero(((points[j] > low) & (points[j] < high)).all(axis=1))) for j in near if j != index]
    asked = [(j, chosen) for j, chosen in asked if len(chosen)]
    if not asked:
        return
    inside = _inside(solid, np.concatenate([points[j][chosen] for j, chosen in asked]))
    ends = np.cumsum([len(chosen) for _, chosen in asked])[:-1]
    for (j, chosen), found in zip(asked, np.split(inside, ends), strict=True):
        hidden[j][chosen[found]] = True


def _inside(solid: Mesh, points: Array) -> NDArray[np.bool_]:
    """Mask of the points (n, 3) that lie inside a closed mesh, by ray parity, shape (n,)."""
    caster = open3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(tensor(solid.vertices, np.float32), tensor(solid.faces, np.uint32))
    occupied = caster.compute_occupancy(tensor(points, np.float32), nthreads=1, nsamples=3)
    return np.asarray(occupied.numpy() > 0.5)


def _noisy(mesh: Mesh, share: Array, seed: int, defects: ScanDefects, rng: np.random.Generator) -> Mesh:
    """The mesh displaced along its normals, with slight noise in the colours; `share` scales it per vertex."""
    points, normals = mesh.vertices, mesh.vertex_normals
    shift = defects.smooth_noise * smooth_noise(points, seed + 1, 0.35)
    shift += defects.rough_noise * smooth_noise(points, seed + 2, 0.08)
    shift += defects.fine_noise * rng.standard_normal(len(points))
    tint = 1.2 * smooth_noise(points, seed + 3, 0.15) + rng.normal(0.0, 1.0, len(points))
    colors = np.clip(np.rint(mesh.colors + tint[:, None]), 0, 255).astype(np.uint8)
    return replace(mesh, vertices=points + (share * shift)[:, None] * normals, colors=colors)


def _holes(mesh: Mesh, defects: ScanDefects, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Faces in small round holes on steep or downward surfaces, which cameras see worst, shape (m,)."""
    centers, normals = mesh.triangles.mean(axis=1), mesh.face_normals
    candidates = np.flatnonzero(normals[:, 2] < 0.3 * np.linalg.norm(normals, axis=1))
    missing = np.zeros(len(mesh.faces), dtype=bool)
    for seed_face in rng.choice(candidates, defects.hole_count, replace=False):
        radius = rng.uniform(*defects.hole_radius)
        missing |= np.linalg.norm(centers - centers[seed_face], axis=1) < radius
    return missing


def _compact(mesh: Mesh, faces: NDArray[np.int64], rng: np.random.Generator) -> Mesh:
    """The given faces in the given order, with only the vertices that they use, also shuffled."""
    used, inverse = np.unique(mesh.faces[faces], return_inverse=True)
    order = rng.permutation(len(used))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return Mesh(mesh.vertices[used[order]], place[inverse.reshape(-1, 3)].astype(np.int32), mesh.colors[used[order]])


def scanned(mesh: Mesh, seed: int = 0) -> Mesh:
    """The surface fused from the camera's views; reproducible from the seed."""
    kinds, channels = (core.float32,) * 3, (1, 1, 3)
    grid = geometry.VoxelBlockGrid(
        ("tsdf", "weight", "color"), kinds, channels, VOXEL, BLOCK, BLOCKS, core.Device("CPU:0")
    )
    caster, rng = Raycaster(mesh), np.random.default_rng(seed)
    for camera in walk(mesh, caster):
        depth, color = (geometry.Image(core.Tensor.from_numpy(image)) for image in seen(mesh, caster, camera, rng))
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = camera.world_from_camera, camera.position
        middle = 0.5 * WIDTH - 0.5, 0.5 * HEIGHT - 0.5
        lens = core.Tensor.from_numpy(
            np.array([[camera.focal, 0.0, middle[0]], [0.0, camera.focal, middle[1]], [0.0, 0.0, 1.0]])
        )
        place = core.Tensor.from_numpy(np.ascontiguousarray(np.linalg.inv(pose)))
        blocks = grid.compute_unique_block_coordinates(depth, lens, place, 1.0, FARTHEST)
        grid.integrate(blocks, depth, color, lens, place, 1.0, FARTHEST)
    found = grid.extract_triangle_mesh(LEAST_SEEN).to_legacy()
    colors = np.rint(255.0 * np.asarray(found.vertex_colors)).clip(0, 255).astype(np.uint8)
    return Mesh(np.asarray(found.vertices), np.asarray(found.triangles, dtype=np.int64), colors)


def walk(mesh: Mesh, caster: Raycaster) -> list[Camera]:
    """Cameras at free places, each turning around and looking slightly down."""
    low, high = mesh.bounds
    cameras = []
    for u in (np.arange(STANDS) + 0.5) / STANDS:
        for v in (np.arange(STANDS) + 0.5) / STANDS:
            place = np.array([low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1]), low[2] + EYES])
            turns = 2.0 * np.pi * (np.arange(TURNS) + 0.5 * u) / TURNS
            around = np.stack([np.cos(turns), np.sin(turns), np.zeros(TURNS)], axis=1)
            if caster.cast(np.tile(place, (TURNS, 1)), around).distance.min() < 0.25:
                continue  # inside a thing, or too close to it
            cameras += [
                looking_at(place, place + way + [0.0, 0.0, -0.45], WIDTH, HEIGHT, fov_deg=FOV_DEG) for way in around
            ]
    return cameras


def seen(
    mesh: Mesh, caster: Raycaster, camera: Camera, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Depth along the optical axis with noise [m], shape (HEIGHT, WIDTH), 0 without a hit, and colour 0..1."""
    ways = camera.directions(camera.pixel_centers)
    hits = caster.cast(np.tile(camera.position, (len(ways), 1)), ways)
    depth = np.where(np.isfinite(hits.distance), hits.distance * (ways @ camera.world_from_camera[:, 2]), 0.0)
    depth = np.where(depth > 0.0, depth + NOISE * depth**2 * rng.normal(size=len(depth)), 0.0)
    face = np.maximum(hits.face, 0)
    color = np.einsum("nk,nkc->nc", hits.barycentric, mesh.colors[mesh.faces[face]].astype(np.float64))
    color[hits.face < 0] = 0.0
    return (
        depth.reshape(HEIGHT, WIDTH).astype(np.float32),
        (color / 255.0).astype(np.float32).reshape(HEIGHT, WIDTH, 3),
    )
