"""Simulates a scan of an embedded room by a moving depth camera: one noisy surface without names.

In: a room's mesh. Out: the surface fused from depth images at eye height [C96]: unseen surfaces are missing, touching
things are one surface, edges are round, colours are blurred.

[C96] Curless, Levoy: A volumetric method for building complex models from range images. SIGGRAPH 1996.
"""

import numpy as np
from numpy.typing import NDArray
from open3d import core
from open3d.t import geometry

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

VOXEL = 0.02
"""Voxel size of the fused volume [m]: the resolution of phones."""
BLOCK, BLOCKS = 16, 20_000
"""Voxels along an edge of a block, and blocks at first [-]."""
LEAST_SEEN = 3.0
"""Least number of cameras that have seen a place [-]."""
NOISE = 0.004
"""Standard deviation of depth at one metre, growing with its square [m]."""
EYES = 1.5
"""Height of the camera above the lowest point [m]."""
WIDTH, HEIGHT, FOV_DEG = 240, 180, 75.0
STANDS, TURNS = 3, 8
"""Places along each horizontal axis, and views from each of them [-]."""
FARTHEST = 6.0
"""[m]."""


def scanned(mesh: Mesh, seed: int = 0) -> Mesh:
    """The surface fused from the camera's views; the same for the same seed."""
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
    """Cameras at places that are free, each turning around, looking a little down."""
    low, high = mesh.bounds
    cameras = []
    for u in (np.arange(STANDS) + 0.5) / STANDS:
        for v in (np.arange(STANDS) + 0.5) / STANDS:
            place = np.array([low[0] + u * (high[0] - low[0]), low[1] + v * (high[1] - low[1]), low[2] + EYES])
            turns = 2.0 * np.pi * (np.arange(TURNS) + 0.5 * u) / TURNS
            around = np.stack([np.cos(turns), np.sin(turns), np.zeros(TURNS)], axis=1)
            if caster.cast(np.tile(place, (TURNS, 1)), around).distance.min() < 0.25:
                continue  # inside of a thing, or too close to one
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
