"""Pictures of Gaussian splats: colour and transmitted light.

Taichi must have been started. The same splats and camera give the same picture for any number of threads: Gaussians are
ordered by depth and index, and each tile is blended by one thread.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array
from dcap.geometry.camera import Camera
from dcap.geometry.splatting import kernels
from dcap.scene.types.gaussians import DC, Gaussians, harmonics

NEAR = 0.05
"""Least distance of drawn Gaussians from the camera [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class RenderedSplats:
    """Camera view of splats."""

    image: Float32Array
    """sRGB colours 0 to 1 over the background, shape (rows, columns, 3)."""
    light: Float32Array
    """Share of the light from behind all splats [-], shape (rows, columns)."""
    front: NDArray[np.int32]
    """Index of the Gaussian beyond which less than half of the light passes, -1 for none, shape (rows, columns)."""
    weight: Float32Array
    """Largest share of each Gaussian in a pixel [-], shape (n,)."""


class Splatter:
    """Gaussians ready to be drawn."""

    def __init__(self, splats: Gaussians) -> None:
        self.splats = splats
        self.axes = np.ascontiguousarray(splats.axes, dtype=np.float32)
        self.scale, self.opacity = splats.scale, splats.opacity
        n = len(splats)
        self.depth = np.zeros(n, dtype=np.float32)
        self.mean, self.conic = np.zeros((n, 2), dtype=np.float32), np.zeros((n, 3), dtype=np.float32)
        self.rectangle = np.zeros((n, 4), dtype=np.int32)
        self.color = DC * splats.dc + np.float32(0.5)

    def view(self, camera: Camera, background: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> RenderedSplats:
        """The picture of a camera."""
        order = self._project(camera)
        rows, columns = camera.height, camera.width
        image = np.zeros((rows, columns, 3), dtype=np.float32)
        light = np.ones((rows, columns), dtype=np.float32)
        front = np.full((rows, columns), -1, dtype=np.int32)
        weight = np.zeros(len(self.splats), dtype=np.float32)
        start, entry, wide = self._tiles(order, rows, columns)
        kernels.blend(
            start, entry, wide, self.mean, self.conic, self.rectangle, self.opacity, self._colors(order, camera),
            image, light, front, weight,
        )  # fmt: skip
        image += light[:, :, None] * np.array(background, dtype=np.float32)
        return RenderedSplats(image, light, front, weight)

    def _project(self, camera: Camera) -> NDArray[np.int32]:
        """Project all Gaussians; returns the indices of those in the picture, nearest first."""
        turn = camera.world_from_camera.T
        kernels.project(
            self.splats.position, self.axes, self.scale, self.opacity, turn, -turn @ camera.position,
            camera.focals.tolist(), camera.principal.tolist(), [camera.width, camera.height], NEAR,
            self.depth, self.mean, self.conic, self.rectangle,
        )  # fmt: skip
        seen = np.flatnonzero(self.depth > 0.0)
        return seen[np.argsort(self.depth[seen], kind="stable")].astype(np.int32)

    def _tiles(
        self, order: NDArray[np.int32], rows: int, columns: int
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
        """Start of each tile's list, all lists one after the other, and the number of tiles in a row."""
        wide, high = -(-columns // kernels.TILE), -(-rows // kernels.TILE)
        count = np.zeros(wide * high, dtype=np.int32)
        kernels.count_tiles(order, self.rectangle, wide, count)
        start = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
        entry = np.zeros(max(int(start[-1]), 1), dtype=np.int32)
        kernels.fill_tiles(order, self.rectangle, wide, start[:-1].copy(), entry)
        return start, entry, wide

    def _colors(self, order: NDArray[np.int32], camera: Camera) -> Float32Array:
        """View-dependent colours of the Gaussians in the picture, shape (n, 3)."""
        if self.splats.degree == 0:
            return np.asarray(np.maximum(self.color, 0.0), dtype=np.float32)
        away = self.splats.position[order] - camera.position
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        out = self.color.copy()
        seen = np.einsum("nck,nk->nc", self.splats.rest[order], harmonics(away, self.splats.degree).astype(np.float32))
        out[order] += seen
        return np.asarray(np.maximum(out, 0.0), dtype=np.float32)
