"""Pictures of meshes without a display or a graphics card.

In: coloured meshes and a camera. Out: an sRGB picture with soft
shadows and ambient occlusion, depth and the mesh seen in each pixel. Same input, same bytes: every ray direction
comes from a fixed low-discrepancy sequence [R18], one subset per pixel of a 4 x 4 tile, and a filter that respects
edges gathers the subsets.

[R18] Roberts: The unreasonable effectiveness of quasirandom sequences, 2018 (R2 sequence).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.normals import ShadingNormals
from dcap.geometry.rendering.shading import SurfaceHits, background, colors_of, gather, shade, visibility
from dcap.scene.types.mesh import Mesh

EDGE_STEP = 0.004  # relative jump in depth against the neighbours' plane that makes an edge
EDGE_COLOR = 0.035  # jump in displayed colour (0..1) that makes an edge
Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False, slots=True)
class Picture:
    """What a camera sees."""

    rgb: NDArray[np.uint8]
    """sRGB, shape (h, w, 3)."""
    depth: NDArray[np.float32]
    """Distance along the viewing axis [m], inf where nothing is, shape (h, w)."""
    mesh_index: NDArray[np.int32]
    """Index of the mesh seen, -1 where nothing is, shape (h, w)."""


def picture(meshes: Sequence[Mesh], camera: Camera, *, samples: int = 2, shadows: bool = True) -> Picture:
    """Render the meshes; `samples` x `samples` rays smooth each pixel at an edge, `shadows` adds shadows and
    occlusion.
    """
    scene = RenderScene(meshes, camera)
    surface = scene.look(rays_through(camera, camera.pixel_centers))
    shape = (camera.height, camera.width)
    light = np.ones((*shape, 2), dtype=np.float32)
    if shadows:
        light = gather(visibility(scene.caster, surface, scene.light, scene.reach, shape), surface, shape)
    linear = scene.shaded(surface, light.reshape(-1, 2))
    shown = compressed(linear)
    if samples > 1:
        rough = np.flatnonzero(edges(surface, shown, shape))
        shown[rough] = smoothed(rough, scene, surface, light, samples)
    depth = surface.distance * (surface.direction @ camera.world_from_camera[:, 2].astype(np.float32))
    return Picture(
        np.round(255.0 * np.clip(shown, 0.0, 1.0)).astype(np.uint8).reshape(*shape, 3),
        depth.astype(np.float32).reshape(shape),
        surface.mesh_index.reshape(shape),
    )


def seen_meshes(meshes: Sequence[Mesh], camera: Camera) -> NDArray[np.int32]:
    """Index of the mesh seen in the middle of each pixel, -1 where nothing is, shape (h, w)."""
    owner = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]).astype(np.int32)
    direction = rays_through(camera, camera.pixel_centers)
    origin = np.broadcast_to(np.asarray(camera.position, dtype=np.float32), direction.shape)
    face = Raycaster(Mesh.concatenate(list(meshes))).cast(origin, direction).face
    return np.append(owner, np.int32(-1))[face].reshape(camera.height, camera.width)


def rays_through(camera: Camera, points: NDArray[np.floating]) -> Array:
    """Unit directions through image points (n, 2) in the ray tracer's precision, shape (n, 3)."""
    return np.asarray(camera.directions(points), dtype=np.float32)


class RenderScene:
    """The meshes as the camera sees them: one acceleration structure, colours, normals and the light."""

    def __init__(self, meshes: Sequence[Mesh], camera: Camera) -> None:
        self.camera = camera
        self.mesh = Mesh.concatenate(list(meshes))
        self.mesh_of_face = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]).astype(np.int32)
        self.caster = Raycaster(self.mesh)
        self.colors = colors_of(self.mesh)
        rotation = camera.world_from_camera
        # over the left shoulder of the photographer, but never flatter than 40 degrees above the horizon
        side = -0.75 * rotation[:, 0] - 0.55 * rotation[:, 2] * (1.0, 1.0, 0.0)
        flat = side * (1.0, 1.0, 0.0)
        flat /= max(float(np.linalg.norm(flat)), 1e-9)
        self.light = np.array([0.62 * flat[0], 0.62 * flat[1], 0.785])
        self.light /= np.linalg.norm(self.light)
        self.reach = float(np.linalg.norm(np.asarray(camera.target) - camera.position))
        self.normals = ShadingNormals(self.mesh)

    def look(self, direction: Array) -> SurfaceHits:
        """What rays from the camera meet."""
        origin = np.broadcast_to(np.asarray(self.camera.position, dtype=np.float32), direction.shape)
        hits = self.caster.cast(origin, direction)
        seen = np.flatnonzero(hits.face >= 0)
        face, weight = hits.face[seen], hits.barycentric[seen].astype(np.float32)
        flat = hits.normal.astype(np.float32)
        smooth = flat.copy()
        smooth[seen] = np.einsum("ni,nij->nj", weight, self.normals.of(face))
        away = np.einsum("ij,ij->i", flat, direction) > 0.0
        flat[away] *= -1.0
        smooth[away] *= -1.0
        # a shading normal that points away from the viewer would shade the wrong side: bend it back to the face's own
        smooth = np.where((np.einsum("ij,ij->i", smooth, flat) > 0.1)[:, None], smooth, flat)
        smooth /= np.maximum(np.sqrt(np.einsum("ij,ij->i", smooth, smooth)), np.float32(1e-12))[:, None]
        color = np.zeros_like(flat)
        color[seen] = np.einsum("ni,nij->nj", weight, self.colors[self.mesh.faces[face]])
        index = np.full(len(direction), -1, dtype=np.int32)
        index[seen] = self.mesh_of_face[face]
        return SurfaceHits(
            direction, hits.distance.astype(np.float32), hits.position.astype(np.float32), flat, smooth, color, index
        )

    def shaded(self, surface: SurfaceHits, light: Array) -> Array:
        """Linear colours of the rays that made the surface, with light (n, 2) = (key, ambient) reaching each, (n,
        3).
        """
        linear = background(surface.direction)
        seen = np.flatnonzero(surface.mesh_index >= 0)
        linear[seen] = shade(surface.take(seen), light[seen], self.light)
        return linear


def edges(surface: SurfaceHits, shown: Array, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Pixels that differ from a neighbour in mesh, depth or colour, shape (h * w,)."""
    index = surface.mesh_index.reshape(shape)
    inverse = (1.0 / surface.distance).reshape(shape)  # linear over a plane seen in perspective
    color = shown.reshape(*shape, 3)
    rough = np.zeros(shape, dtype=bool)
    for axis in (0, 1):
        one, two = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
        jump = (index[one] != index[two]) | (np.abs(color[one] - color[two]).max(axis=-1) > EDGE_COLOR)
        rough[one] |= jump
        rough[two] |= jump
        bend = np.abs(np.diff(inverse, n=2, axis=axis))
        middle = (slice(None),) * axis + (slice(1, -1),)
        rough[middle] |= bend > EDGE_STEP * np.abs(inverse[middle])
    return rough.ravel()


def smoothed(pixel: NDArray[np.int64], scene: RenderScene, surface: SurfaceHits, light: Array, samples: int) -> Array:
    """Displayed colours of pixels as means of samples^2 rays each, shape (n, 3)."""
    camera = scene.camera
    column, row = pixel % camera.width, pixel // camera.width
    total = np.zeros((len(pixel), 3), dtype=np.float32)
    for step in range(samples * samples):
        # a rotated grid: no two samples share a row or a column
        offset = np.array(
            [(step + 0.5) / samples**2, ((step * samples + step // samples) % samples**2 + 0.5) / samples**2]
        )
        seen = scene.look(rays_through(camera, np.stack([column, row], axis=1) + offset))
        total += compressed(scene.shaded(seen, borrowed_light(seen, pixel, surface, light)))
    return np.asarray(total / samples**2, dtype=np.float32)


def borrowed_light(seen: SurfaceHits, pixel: NDArray[np.int64], surface: SurfaceHits, light: Array) -> Array:
    """Light of the most similar surface among a pixel and its eight neighbours, shape (n, 2)."""
    height, width = light.shape[:2]
    column, row = pixel % width, pixel // width
    best = np.full(len(pixel), np.inf, dtype=np.float32)
    chosen = pixel.copy()
    for y, x in ((0, 0), (0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        near = np.clip(row + y, 0, height - 1) * width + np.clip(column + x, 0, width - 1)
        gap = np.abs(np.einsum("ij,ij->i", surface.position[near] - seen.position, seen.flat)) / seen.distance
        turn = 1.0 - np.einsum("ij,ij->i", surface.smooth[near], seen.smooth)
        cost = np.where(surface.mesh_index[near] == seen.mesh_index, 0.0, 1.0) + 20.0 * gap + turn
        better = cost < best
        best[better], chosen[better] = cost[better], near[better]
    return np.asarray(light.reshape(-1, 2)[chosen])


def compressed(linear: Array) -> Array:
    """Displayed brightness 0..1 of linear light: a soft shoulder above 0.75, then the sRGB curve."""
    knee = np.float32(0.75)
    over = np.maximum(linear - knee, 0.0)
    toned = np.minimum(linear, knee) + (1 - knee) * (1 - np.exp(-over / (1 - knee)))
    curved = 1.055 * np.power(np.maximum(toned, 1e-9), 1 / 2.4) - 0.055
    return np.asarray(np.where(toned <= 0.0031308, 12.92 * toned, curved), dtype=np.float32)
