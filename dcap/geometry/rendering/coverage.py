"""Coverage of each pixel by a mesh, and the object composited into a photograph.

In: an exposed picture and the index of one of its meshes. Out: shares of pixels and that mesh's own colours. Only
pixels at the rim of the mesh are traced again, with several rays each.

Composites the object into a photograph: its own colours where it is visible, its shadow on the rest.

In: conditioning maps of the photograph's camera and the photograph. Out: a picture of the same size. The photograph is
darkened in linear light by the light that the object takes away; things that hide the object stay in front of it.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from dcap.arrays import ByteArray, Float32Array, Mask
from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.picture import Exposure, borrowed_light, neighbours, sample_offsets
from dcap.geometry.rendering.shading import compressed, shade
from dcap.scene.errors import InputError
from dcap.scene.srgb import linear_from_srgb
from dcap.scene.types.pictures import ConditioningMaps


def coverage(exposure: Exposure, mesh: int, samples: int) -> tuple[Float32Array, Float32Array]:
    """Share of each pixel in which a mesh is visible, (h, w), and its own displayed colour there, (3, h, w)."""
    camera, shape = exposure.scene.camera, exposure.shape
    seen = (exposure.surface.mesh_index == mesh).reshape(shape)
    share = seen.astype(np.float32)
    color = np.where(seen, exposure.shown.reshape(3, *shape), 0.0)
    rim = np.flatnonzero(rim_of(seen))
    if not len(rim):
        return share, color
    rays = exposure.scene.look(sub_pixels(rim, camera, samples))
    own = [rays.part(slice(first, first + len(rim))) for first in range(0, len(rays.distance), len(rim))]
    light = borrowed_light(own, neighbours(rim, camera), exposure.surface, exposure.light)
    hit = np.stack([one.mesh_index == mesh for one in own]).astype(np.float32)
    tone = np.stack([compressed(shade(one, lit, exposure.scene.light)) for one, lit in zip(own, light, strict=True)])
    total = hit.sum(axis=0)
    share.reshape(-1)[rim] = total / len(own)
    color.reshape(3, -1)[:, rim] = (tone * hit[:, None]).sum(axis=0) / np.maximum(total, 1.0)
    return share, color


def silhouette(caster: Raycaster, camera: Camera, samples: int) -> Float32Array:
    """Share of each pixel covered by a mesh alone, shape (h, w)."""
    shape = (camera.height, camera.width)
    seen = hits(caster, camera, camera.pixel_centers).reshape(shape)
    share = seen.astype(np.float32)
    rim = np.flatnonzero(rim_of(seen))
    if len(rim):
        share.reshape(-1)[rim] = (
            hits(caster, camera, sub_pixels(rim, camera, samples)).reshape(-1, len(rim)).mean(axis=0)
        )
    return share


def hits(caster: Raycaster, camera: Camera, points: NDArray[np.float64]) -> Mask:
    """Mask of the rays through image points (n, 2) that meet a mesh, shape (n,)."""
    ways = camera.directions(points)
    return np.asarray(caster.first_hits(packed_rays(np.broadcast_to(camera.position, ways.shape), ways)).face >= 0)


def rim_of(seen: Mask) -> Mask:
    """Pixels on both sides of the rim of a mask (h, w); the picture's own edge does not count."""
    square = np.ones((3, 3), dtype=bool)
    return np.asarray(binary_dilation(seen, square) & ~binary_erosion(seen, square, border_value=1))


def sub_pixels(pixel: NDArray[np.int64], camera: Camera, samples: int) -> NDArray[np.float64]:
    """Image points of samples^2 rays in each of n pixels, ordered ray by ray over all pixels, shape (s * n, 2)."""
    corner = np.stack([pixel % camera.width, pixel // camera.width], axis=1)
    return np.asarray((corner + sample_offsets(samples)[:, None]).reshape(-1, 2))


def share_bytes(share: Float32Array) -> NDArray[np.uint8]:
    """Numbers 0..1 as bytes 0..255."""
    return np.asarray(np.round(255.0 * np.clip(share, 0.0, 1.0)), dtype=np.uint8)


def composite(maps: ConditioningMaps, photo: ByteArray) -> ByteArray:
    """The photograph (h, w, 3) with the object in it; raises InputError if its size differs from the maps'."""
    if photo.shape != maps.rgb.shape:
        (height, width), (h, w) = maps.rgb.shape[:2], photo.shape[:2]
        raise InputError(
            f"the photo has {w} x {h} pixels and its camera {width} x {height}; give the photo's own camera"
        )
    share = maps.object_mask[..., None] / 255.0
    ground = encoded(linear_from_srgb(photo) * maps.shadow[..., None])
    return np.asarray(np.round(ground * (1.0 - share) + maps.object_rgb * share), dtype=np.uint8)


def encoded(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB 0..255 of linear light."""
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)
