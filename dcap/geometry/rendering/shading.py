"""Lighting of surfaces: a key light, a sky and a fill light, with their visibility from each pixel.

All colours are linear light; 1 is a white surface that faces the key light. Components come first: (3, n).

Share of the key light and of the sky that reaches each pixel, from a few rays of the pixel and of its neighbours.

Every ray direction comes from a fixed low-discrepancy sequence [R18], one subset for each pixel of a 4 x 4 tile. A
filter that respects edges gathers the subsets.

[R18] Roberts: The unreasonable effectiveness of quasirandom sequences, 2018 (R2 sequence).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array, IntArray, Mask
from dcap.geometry.raycast import RayTracer
from dcap.geometry.rendering.surface import BAND, SurfaceHits, dot, in_bands
from dcap.geometry.rendering.view_volume import KEY_REACH, LIGHT_RADIUS, SKY_REACH
from dcap.scene.types.mesh import Mesh

Ways = Callable[[SurfaceHits, NDArray[np.int64], NDArray[np.int64]], tuple[Float32Array, NDArray[np.bool_]]]
"""Function that returns rays to a light, scaled by their reach (rays, 3, n), and the mask of those that could arrive
(rays, n)."""

KEY_RAYS = 2  # per pixel; a 4 x 4 tile has 32 different ones in total
SKY_RAYS = 3
TILE = 4
OFFSET = (2e-4, 1e-5)  # rays start this far off the surface: a share of the camera's distance, and a constant [m]
WINDOW = 4  # half width [pixels] of the gathering filter: twice the tile, so that every subset counts the same
PLANE_TOLERANCE = 0.004  # distance from a pixel's plane over its depth at which the filter ignores a neighbour


def column(*values: float) -> Float32Array:
    """A colour for use with component-first arrays, shape (3, 1)."""
    return np.array(values, dtype=np.float32)[:, None]


KEY_COLOR = column(1.00, 0.965, 0.91) * 0.74
SKY_COLOR = column(0.92, 0.96, 1.00) * 0.50
GROUND_COLOR = column(1.00, 0.95, 0.88) * 0.26
FILL_COLOR = column(0.95, 0.97, 1.00) * 0.12
BACKDROP_LOW, BACKDROP_HIGH = column(0.66, 0.65, 0.64), column(0.83, 0.87, 0.92)
SHEEN = 0.035  # a broad, weak highlight: enough to read a curved surface, too little to look like plastic
GRAZING = 0.12  # cosine of the angle of incidence below which the key light fades faster than Lambert's law
KNEE = 0.75  # linear brightness above which a soft shoulder replaces clipping


def shade(surface: SurfaceHits, light: Float32Array, key: NDArray[np.float64]) -> Float32Array:
    """Linear colours of surfaces, (3, n); light (2, n): shares of the key light and of the sky that reach them."""
    normal, toward = surface.smooth, key.astype(np.float32)[:, None]
    facing = np.clip(dot(normal, toward), 0.0, 1.0)
    # fades in gently: at grazing light the noise of a scan would flicker, and facets would show at the terminator
    lambert = facing * facing * (1.0 + GRAZING) / (facing + GRAZING)
    headlight = np.clip(-dot(normal, surface.direction), 0.0, 1.0)
    ambient = GROUND_COLOR + (SKY_COLOR - GROUND_COLOR) * (0.5 + 0.5 * normal[2]) + FILL_COLOR * headlight
    total = surface.color * (KEY_COLOR * (lambert * light[0]) + ambient * light[1])
    half = toward - surface.direction
    gloss = np.clip(dot(normal, half) / np.sqrt(dot(half, half)), 0.0, 1.0)
    for _ in range(3):
        gloss = gloss * gloss
    gloss = gloss * gloss * gloss  # the 24th power
    total += SHEEN * gloss * light[0]
    return np.asarray(np.where(surface.mesh_index >= 0, total, background(surface.direction)))


def background(direction: Float32Array) -> Float32Array:
    """A soft studio backdrop: light grey below, a cooler white above, shape (3, n)."""
    height = np.clip(0.5 + 0.9 * direction[2], 0.0, 1.0)
    return np.asarray(BACKDROP_LOW + (BACKDROP_HIGH - BACKDROP_LOW) * (height * height * (3.0 - 2.0 * height)))


def compressed(linear: Float32Array) -> Float32Array:
    """Displayed brightness 0..1 of linear light: a soft shoulder above the knee, then the sRGB curve."""
    over = np.maximum(linear - KNEE, 0.0)
    toned = np.minimum(linear, KNEE) + (1 - KNEE) * (1 - np.exp(-over / (1 - KNEE)))
    curved = 1.055 * np.power(np.maximum(toned, 1e-9), 1 / 2.4) - 0.055
    return np.asarray(np.where(toned <= 0.0031308, 12.92 * toned, curved))


def gathered_light(
    caster: RayTracer, surface: SurfaceHits, key: NDArray[np.float64], reach: float, shape: tuple[int, int]
) -> Float32Array:
    """Shares of the key light and of the sky that reach each pixel, shape (2, h * w)."""
    return gather(Lights(key, reach, shape).arriving(caster, surface).shares, surface, shape)


@dataclass(frozen=True, eq=False, slots=True)
class LightRays:
    """Masks of the rays from n pixels to the lights that arrive."""

    key: Mask
    """Rays to the key light, shape (KEY_RAYS, n)."""
    sky: Mask
    """Rays to the sky, shape (SKY_RAYS, n)."""

    @property
    def shares(self) -> Float32Array:
        """Shares of the key light and of the sky from each pixel's own rays, shape (2, n)."""
        return np.stack([one.sum(axis=0, dtype=np.float32) / np.float32(len(one)) for one in (self.key, self.sky)])

    def with_others(self, pixel: IntArray, others: "LightRays") -> "LightRays":
        """A copy with the rays of some pixels (k,) replaced by those of `others`."""
        key, sky = self.key.copy(), self.sky.copy()
        key[:, pixel], sky[:, pixel] = others.key, others.sky
        return LightRays(key, sky)


class Lights:
    """The key light and the sky over the pixels of a picture."""

    def __init__(self, key: NDArray[np.float64], reach: float, shape: tuple[int, int]) -> None:
        """Take the unit vector to the key light, the camera's distance from its target [m], and the rows and
        columns."""
        self._toward, self._reach = key.astype(np.float32)[:, None], reach
        self._key, self._sky = key_ways(key, KEY_REACH * reach), sky_ways(SKY_REACH * reach)
        self._tile, self._wide = bayer(TILE, shape).ravel(), bayer(2 * TILE, shape).ravel()

    def arriving(self, caster: RayTracer, surface: SurfaceHits) -> LightRays:
        """Rays from all pixels, and whether they arrive."""
        return LightRays(
            open_rays(caster, surface, self._key, KEY_RAYS, self._tile, self._wide),
            open_rays(caster, surface, self._sky, SKY_RAYS, self._tile, self._wide),
        )

    def some(
        self, caster: RayTracer, surface: SurfaceHits, pixel: IntArray, asked: LightRays | None = None
    ) -> LightRays:
        """Rays from some pixels (k,) with the given surface; rays not in `asked` count as stopped."""
        near, tile, wide = surface.at(pixel), self._tile[pixel], self._wide[pixel]
        key, sky = (None, None) if asked is None else (asked.key[:, pixel], asked.sky[:, pixel])
        return LightRays(
            open_rays(caster, near, self._key, KEY_RAYS, tile, wide, key),
            open_rays(caster, near, self._sky, SKY_RAYS, tile, wide, sky),
        )

    def near_ball(self, surface: SurfaceHits, center: Float32Array, radius: float) -> Mask:
        """Upper bound of the pixels whose rays may meet things in a ball with centre (3,) and radius [m], shape
        (n,)."""
        farthest = np.float32(SKY_REACH * self._reach) * (levels(SKY_RAYS) ** 2).max(axis=0)
        result = np.empty(len(surface.distance), dtype=bool)

        def look(band: slice) -> None:
            part = surface.part(band)
            way = center[:, None] - part.position
            away, along = dot(way, way), dot(way, self._toward)
            to_sky = away < (radius + farthest[self._wide[band]]) ** 2
            # rays to the key light stay in a cone that begins at the surface
            cone = 1.01 * radius + LIGHT_RADIUS * np.maximum(along + radius, 0.0)
            before = (along > -radius) & (along < KEY_REACH * self._reach + radius)
            to_key = before & (away - along * along < cone * cone)
            result[band] = (part.mesh_index >= 0) & (to_sky | to_key)

        in_bands(look, len(result))
        return result


def open_rays(
    caster: RayTracer, surface: SurfaceHits, ways: Ways, count: int, tile: IntArray, wide: IntArray,
    asked: Mask | None = None,
) -> Mask:  # fmt: skip
    """Mask of those of `count` rays from each of n pixels that arrive, false where nothing is visible or a ray is not
    in `asked`, shape (count, n); `tile` and `wide` are the pixels' indices in their tiles, shape (n,)."""
    pixels = len(surface.distance)
    rays = np.empty((count, pixels, 6), dtype=np.float32)
    could = np.empty((count, pixels), dtype=bool)

    def aim(band: slice) -> None:
        near = surface.part(band)
        seen = near.mesh_index >= 0
        off = OFFSET[0] * np.where(seen, near.distance, 0.0) + OFFSET[1]
        rays[:, band, :3] = (near.position + near.flat * off).T
        way, could[:, band] = ways(near, tile[band], wide[band])
        could[:, band] &= seen if asked is None else seen & asked[:, band]
        # a ray without length is open
        rays[:, band, 3:] = np.where(could[:, None, band], way, 0.0).transpose(0, 2, 1)

    in_bands(aim, pixels)
    blocked = caster.blocked(rays.reshape(-1, 6)).reshape(count, pixels)
    return np.asarray(could & ~blocked)


def key_ways(key: NDArray[np.float64], reach: float) -> Ways:
    """Rays to the disc of the key light."""
    side, other = (one.astype(np.float64) for one in frame(key[:, None].astype(np.float32)))
    u, v = sequence(np.arange(KEY_RAYS * TILE * TILE))
    radius, angle = LIGHT_RADIUS * np.sqrt(u), 2.0 * np.pi * v
    table = key[:, None] + radius * np.cos(angle) * side + radius * np.sin(angle) * other
    table /= np.linalg.norm(table, axis=0)
    # (rays, 3, tile); the reach varies, so that shadows fade out with distance instead of ending
    directions = np.stack(np.split(table.astype(np.float32), KEY_RAYS, axis=1))
    limits = reach * (0.5 + 0.5 * levels(KEY_RAYS))

    def ways(
        surface: SurfaceHits, tile: NDArray[np.int64], wide: NDArray[np.int64]
    ) -> tuple[Float32Array, NDArray[np.bool_]]:
        direction = directions[:, :, tile]
        facing = np.stack([dot(one, surface.flat) > 0.0 for one in direction])
        return direction * limits[:, None, wide], facing

    return ways


def sky_ways(reach: float) -> Ways:
    """Rays to the sky, denser around the normal by its cosine; distant surfaces hide less."""
    u, v = sequence(131 + np.arange(SKY_RAYS * TILE * TILE))
    local = np.stack([np.sqrt(u) * np.cos(2.0 * np.pi * v), np.sqrt(u) * np.sin(2.0 * np.pi * v), np.sqrt(1.0 - u)])
    locals_of = np.stack(np.split(local.astype(np.float32), SKY_RAYS, axis=1))
    limits = reach * levels(SKY_RAYS) ** 2

    def ways(
        surface: SurfaceHits, tile: NDArray[np.int64], wide: NDArray[np.int64]
    ) -> tuple[Float32Array, NDArray[np.bool_]]:
        side, other = frame(surface.smooth)
        result = np.empty((SKY_RAYS, *surface.smooth.shape), dtype=np.float32)
        for ray, (x, y, z) in enumerate(locals_of[:, :, tile]):
            direction = x * side + y * other + z * surface.smooth
            # mirrored at the face: a shading normal may lean over it
            direction -= 2.0 * np.minimum(dot(direction, surface.flat), 0.0) * surface.flat
            result[ray] = direction * limits[ray, wide]
        return result, np.ones((SKY_RAYS, len(wide)), dtype=bool)

    return ways


def sequence(index: NDArray[np.int64]) -> tuple[Float32Array, Float32Array]:
    """Points of the R2 sequence in the unit square [R18], two arrays of the index's shape."""
    first, second = 0.7548776662466927, 0.5698402909980532  # 1 / g, 1 / g^2 with g^3 = g + 1
    return (
        np.asarray(np.mod(0.5 + first * index, 1.0), dtype=np.float32),
        np.asarray(np.mod(0.5 + second * index, 1.0), dtype=np.float32),
    )


def levels(count: int) -> Float32Array:
    """Evenly spread numbers 0..1 for the 64 pixels of a wide tile, different for each ray, shape (count, 64)."""
    wide = 4 * TILE * TILE
    ray = np.arange(count)[:, None]
    return np.asarray((np.arange(wide) * count + ray + 0.5) / (wide * count), dtype=np.float32)


def bayer(side: int, shape: tuple[int, int]) -> NDArray[np.int64]:
    """Index 0 .. side^2 - 1 of each pixel within its tile, neighbours far apart (ordered dithering), shape (h, w)."""
    order = np.zeros((1, 1), dtype=np.int64)
    while len(order) < side:
        order = np.block([[4 * order, 4 * order + 2], [4 * order + 3, 4 * order + 1]])
    return np.asarray(order[np.arange(shape[0])[:, None] % side, np.arange(shape[1])[None, :] % side])


def frame(normal: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Two unit vectors perpendicular to each unit normal, all of shape (3, n) [Duff et al., JCGT 6(1), 2017]."""
    x, y, z = normal
    sign = np.where(z >= 0.0, np.float32(1.0), np.float32(-1.0))
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.stack([1.0 + sign * x * x * a, sign * b, -sign * x]), np.stack([b, sign + y * y * a, -y])


def gather(light: Float32Array, surface: SurfaceHits, shape: tuple[int, int]) -> Float32Array:
    """Light averaged over neighbours on the same surface, first along rows, then along columns, shape (2, h * w)."""
    seen = surface.mesh_index >= 0
    tolerance = (PLANE_TOLERANCE * np.where(seen, surface.distance, 1.0)).astype(np.float32).reshape(shape)
    position, normal = surface.position.reshape(3, *shape), surface.smooth.reshape(3, *shape)
    result = light.reshape(2, *shape)
    for axis in (1, 0):
        result = gather_axis(result, position, normal / tolerance, normal, axis)
    return result.reshape(2, -1)


def gather_axis(
    light: Float32Array, position: Float32Array, steep: Float32Array, normal: Float32Array, axis: int
) -> Float32Array:
    """One direction of `gather`: weights 1 inside the window, 1/2 at its ends, smaller off the pixel's plane; `steep`
    is the normal over the tolerance, all of shape (2 or 3, h, w)."""
    height, width = light.shape[1:]
    result = np.empty_like(light)

    def average(band: slice) -> None:
        total, weight_sum = light[:, band].copy(), np.ones((band.stop - band.start, width), dtype=np.float32)
        for offset in [o for k in range(1, WINDOW + 1) for o in (-k, k)]:
            own, here, there = shifted(offset, axis, band, (height, width))
            away = dot(position[there] - position[here], steep[here])
            turn = np.clip(dot(normal[there], normal[here]), 0.0, 1.0)
            for _ in range(3):
                turn *= turn  # the 8th power in total
            weight = turn * np.exp(-away * away)
            if abs(offset) == WINDOW:
                weight *= 0.5
            total[own] += weight * light[there]
            weight_sum[own[1:]] += weight
        result[:, band] = total / weight_sum

    in_bands(average, height, band=max(1, BAND // width))
    return result


Cut = tuple[slice, slice, slice]


def shifted(offset: int, axis: int, band: slice, shape: tuple[int, int]) -> tuple[Cut, Cut, Cut]:
    """Pixels of a band of rows that have a neighbour at `offset`: as slices of the band and of the picture, and their
    neighbours as slices of the picture."""
    everything = slice(None)
    if axis == 1:
        first, last = max(0, -offset), shape[1] - max(0, offset)
        own, there = slice(first, last), slice(first + offset, last + offset)
        return (everything, everything, own), (everything, band, own), (everything, band, there)
    first, last = max(band.start, -offset), min(band.stop, shape[0] - offset)
    last = max(first, last)
    return (
        (everything, slice(first - band.start, last - band.start), everything),
        (everything, slice(first, last), everything),
        (everything, slice(first + offset, last + offset), everything),
    )


def spread_points(mesh: Mesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Middles of faces, spread over a surface by area, and unit normals there, each of shape (count, 3)."""
    area = np.cumsum(mesh.face_areas)
    face = np.searchsorted(area, (np.arange(count) + 0.5) / count * area[-1])
    normal = mesh.face_normals[face]
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return mesh.triangles[face].mean(axis=1), normal / np.maximum(length, np.finfo(float).tiny)
