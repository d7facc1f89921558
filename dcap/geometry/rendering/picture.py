"""Pictures of meshes without a display or a graphics card, lit or in their own colours.

In: coloured meshes and a camera. Out: an sRGB picture with soft shadows and ambient occlusion, the depth, and the mesh
visible in each pixel. Same input, same bytes: directions of rays come from fixed sequences, and every pixel is computed
independently of the cores.

Pictures of a mesh in its own colours, without light, as a reference for splats on it; and the similarity of two
pictures.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array
from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.shading import OFFSET, LightRays, Lights, compressed, gather, shade
from dcap.geometry.rendering.surface import PreparedMeshes, RenderScene, SurfaceHits, dot, in_bands
from dcap.scene.types.mesh import Mesh, PaintedMesh

EDGE_STEP = 0.004  # relative jump in depth against the neighbours' plane at an edge
EDGE_COLOR = 0.035  # jump in displayed colour (0..1) at an edge
AROUND = ((0, 0), (0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1))
"""A pixel and its eight neighbours (rows, columns), the nearer ones first."""

SAMPLES = 2
"""Rays along each side of a pixel, so that edges are as smooth as in other pictures [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Picture:
    """Camera view: colours, depths and meshes."""

    rgb: NDArray[np.uint8]
    """sRGB, shape (h, w, 3)."""
    depth: NDArray[np.float32]
    """Distance along the viewing axis [m], inf where nothing is, shape (h, w)."""
    mesh_index: NDArray[np.int32]
    """Index of the visible mesh, -1 where nothing is, shape (h, w)."""


def picture(
    meshes: Sequence[Mesh | PaintedMesh] | PreparedMeshes, camera: Camera, *, samples: int = 2, shadows: bool = True,
    low_light: bool = False,
) -> Picture:  # fmt: skip
    """Render the meshes, which are prepared if several pictures are taken of them.

    `samples` x `samples` rays smooth each pixel at an edge, `shadows` adds shadows and occlusion, `low_light` reveals
    relief.
    """
    return exposed(meshes, camera, shadows=shadows, low_light=low_light).picture(samples)


@dataclass(frozen=True, eq=False, slots=True)
class Exposure:
    """An undeveloped picture: the surface at each pixel's middle, and the light there."""

    scene: RenderScene
    surface: SurfaceHits
    rays: LightRays | None
    """Rays to the lights and whether they arrive; None without shadows."""
    light: Float32Array
    """Shares of the key light and of the sky, shape (2, h * w)."""
    shown: Float32Array
    """Displayed colours 0..1 of the pixels' middles, shape (3, h * w)."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.scene.camera.height, self.scene.camera.width

    @property
    def depth(self) -> NDArray[np.float32]:
        """Distance along the viewing axis [m], inf where nothing is, shape (h, w)."""
        forward = self.scene.camera.world_from_camera[:, 2].astype(np.float32)
        return np.asarray((self.surface.distance * dot(self.surface.direction, forward)).reshape(self.shape))

    def adding(self, faces: NDArray[np.bool_]) -> "Exposure":
        """The same view with additional faces of the prepared meshes, a mask (m,): equal to a view of all of them, but
        only rays that may meet the additional faces are traced again."""
        if not faces.any():
            return self
        scene, added = self.scene.adding(faces)
        mesh, camera = scene.prepared.mesh, scene.camera
        corner = mesh.vertices[mesh.faces[faces]].reshape(-1, 3)
        low, high = corner.min(axis=0), corner.max(axis=0)
        center = (0.5 * (low + high)).astype(np.float32)
        toward = center.astype(np.float64) - camera.position  # a difference of squares needs double precision
        along, away = dot(self.surface.direction, toward), float(np.linalg.norm(toward))
        radius = 0.5 * float(np.linalg.norm(high - low)) + OFFSET[0] * away + OFFSET[1]  # rays start off a surface
        seen = np.flatnonzero(away**2 - along * along < (1.01 * radius) ** 2)
        ways = self.surface.direction[:, seen].T
        hits = added.first_hits(packed_rays(np.broadcast_to(camera.position, ways.shape), ways))
        fresh = seen[hits.distance < self.surface.distance[seen]]
        surface = self.surface.with_others(fresh, scene.look(camera.pixel_centers[fresh]))
        rays, light = self.rays, self.light
        if rays is not None:
            lights = Lights(scene.light, scene.reach, self.shape)
            shaded = lights.near_ball(surface, center, radius)
            shaded[fresh] = False
            other = np.flatnonzero(shaded)
            rays = rays.with_others(other, lights.some(added, surface, other, rays))
            rays = rays.with_others(fresh, lights.some(scene.caster, surface, fresh))
            light = gather(rays.shares, surface, self.shape)
        return Exposure(scene, surface, rays, light, displayed(scene, surface, light))

    def picture(self, samples: int = 2) -> Picture:
        """The developed picture, with `samples` x `samples` rays at edges."""
        shown = self.shown
        if samples > 1:
            shown = shown.copy()
            rough = np.flatnonzero(edges(self.surface, shown, self.shape))
            shown[:, rough] = smoothed(rough, self.scene, self.surface, self.light, samples)
        return Picture(in_bytes(shown, self.shape), self.depth, self.surface.mesh_index.reshape(self.shape))


def exposed(
    meshes: Sequence[Mesh | PaintedMesh] | PreparedMeshes, camera: Camera, *, shadows: bool = True,
    low_light: bool = False,
) -> Exposure:  # fmt: skip
    """View of the meshes from the camera, and the light there."""
    prepared = meshes if isinstance(meshes, PreparedMeshes) else PreparedMeshes(meshes)
    scene = RenderScene(prepared, camera, low_light=low_light)
    surface = scene.look(camera.pixel_centers)
    shape = (camera.height, camera.width)
    light, rays = np.ones((2, len(surface.distance)), dtype=np.float32), None
    if shadows:
        rays = Lights(scene.light, scene.reach, shape).arriving(scene.caster, surface)
        light = gather(rays.shares, surface, shape)
    return Exposure(scene, surface, rays, light, displayed(scene, surface, light))


def displayed(scene: RenderScene, surface: SurfaceHits, light: Float32Array) -> Float32Array:
    """Displayed colours 0..1 of surfaces in light (2, n), shape (3, n)."""
    shown = np.empty_like(surface.color)

    def expose(band: slice) -> None:
        shown[:, band] = compressed(shade(surface.part(band), light[:, band], scene.light))

    in_bands(expose, len(surface.distance))
    return shown


def in_bytes(shown: Float32Array, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """sRGB of displayed colours (3, h * w), shape (h, w, 3)."""
    rgb = np.empty((shown.shape[1], 3), dtype=np.uint8)

    def quantise(band: slice) -> None:
        rgb[band] = np.round(255.0 * np.clip(shown[:, band], 0.0, 1.0)).T

    in_bands(quantise, len(rgb))
    return rgb.reshape(*shape, 3)


def edges(surface: SurfaceHits, shown: Float32Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of the pixels that differ from a neighbour in mesh, depth or colour, shape (h * w,)."""
    index = surface.mesh_index.reshape(shape)
    inverse = (1.0 / surface.distance).reshape(shape)  # linear over a plane seen in perspective
    color = shown.reshape(3, *shape)
    rough = np.zeros(shape, dtype=bool)
    for axis in (0, 1):
        one, two = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
        jump = index[one] != index[two]
        for channel in color:
            jump |= np.abs(channel[one] - channel[two]) > EDGE_COLOR
        rough[one] |= jump
        rough[two] |= jump
        bend = np.abs(np.diff(inverse, n=2, axis=axis))
        middle = (slice(None),) * axis + (slice(1, -1),)
        rough[middle] |= bend > EDGE_STEP * inverse[middle]
    return rough.ravel()


def smoothed(
    pixel: NDArray[np.int64], scene: RenderScene, surface: SurfaceHits, light: Float32Array, samples: int
) -> Float32Array:
    """Displayed colours of pixels as means of samples^2 rays each, shape (3, n)."""
    corner = np.stack([pixel % scene.camera.width, pixel // scene.camera.width], axis=1)
    seen = scene.look((corner + sample_offsets(samples)[:, None]).reshape(-1, 2))
    mean = np.empty((3, len(pixel)), dtype=np.float32)

    def average(band: slice) -> None:
        starts = range(0, len(seen.distance), len(pixel))
        own = [seen.part(slice(first + band.start, first + band.stop)) for first in starts]
        lights = borrowed_light(own, neighbours(pixel[band], scene.camera), surface, light)
        mean[:, band] = sum(
            compressed(shade(hits, lit, scene.light)) for hits, lit in zip(own, lights, strict=True)
        ) / len(own)

    in_bands(average, len(pixel))
    return mean


def sample_offsets(samples: int) -> NDArray[np.float64]:
    """Positions within a pixel on a rotated grid: no two share a row or a column, shape (samples^2, 2)."""
    step, count = np.arange(samples**2), samples**2
    return np.stack([(step + 0.5) / count, ((step * samples + step // samples) % count + 0.5) / count], axis=1)


def neighbours(pixel: NDArray[np.int64], camera: Camera) -> list[NDArray[np.int64]]:
    """Pixels (n,) and their eight neighbours, clamped to the picture."""
    column, row = pixel % camera.width, pixel // camera.width
    return [
        np.clip(row + y, 0, camera.height - 1) * camera.width + np.clip(column + x, 0, camera.width - 1)
        for y, x in AROUND
    ]


def borrowed_light(
    own: Sequence[SurfaceHits], around: Sequence[NDArray[np.int64]], surface: SurfaceHits, light: Float32Array
) -> list[Float32Array]:
    """Light of the most similar surface around, for each of several sets of n rays, each of shape (2, n)."""
    costs = [np.full(len(around[0]), np.inf, dtype=np.float32) for _ in own]
    chosen = [light[:, around[0]] for _ in own]
    for near in around:
        position, smooth, index = surface.position[:, near], surface.smooth[:, near], surface.mesh_index[near]
        lit = light[:, near]
        for k, hits in enumerate(own):
            gap = np.abs(dot(position - hits.position, hits.flat)) / hits.distance
            cost = 20.0 * gap + 1.0 - dot(smooth, hits.smooth) + (index != hits.mesh_index)
            better = cost < costs[k]
            costs[k] = np.where(better, cost, costs[k])
            chosen[k] = np.where(better, lit, chosen[k])
    return chosen


def unlit(mesh: Mesh, camera: Camera, caster: Raycaster | None = None) -> Float32Array:
    """sRGB 0 to 1 over black, shape (rows, columns, 3); `caster` is the mesh's ray caster, if already available."""
    fine = camera.scaled(SAMPLES)
    ways = fine.directions(fine.pixel_centers)
    hits = (caster or Raycaster(mesh)).cast(np.broadcast_to(camera.position, ways.shape), ways)
    seen = hits.face >= 0
    color = np.zeros((len(ways), 3))
    corners = mesh.colors[mesh.faces[hits.face[seen]]] / 255.0
    color[seen] = np.einsum("nk,nkc->nc", hits.barycentric[seen], corners)
    blocks = color.reshape(camera.height, SAMPLES, camera.width, SAMPLES, 3)
    return np.asarray(blocks.mean(axis=(1, 3)), dtype=np.float32)


def psnr(a: Float32Array, b: Float32Array) -> float:
    """Peak signal-to-noise ratio of two pictures with colours 0 to 1 [dB], inf if they are equal."""
    error = float(np.mean((a.astype(np.float64) - b) ** 2))
    return float("inf") if error == 0.0 else -10.0 * float(np.log10(error))
