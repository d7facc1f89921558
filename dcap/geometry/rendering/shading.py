"""How light meets surfaces: a key light with soft shadows, a bright sky with ambient occlusion, a little fill.

All colours are linear light; 1 is a white surface that faces the key light.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float32]

KEY_COLOR = np.array([1.00, 0.965, 0.91], dtype=np.float32) * 0.74
SKY_COLOR = np.array([0.92, 0.96, 1.00], dtype=np.float32) * 0.50
GROUND_COLOR = np.array([1.00, 0.95, 0.88], dtype=np.float32) * 0.26
FILL_COLOR = np.array([0.95, 0.97, 1.00], dtype=np.float32) * 0.12
SHEEN = np.float32(0.035)  # a broad, weak highlight: enough to read a curved surface, too little to look like plastic
SHEEN_POWER = 24.0
GRAZING = 0.12  # cosine of the angle of incidence below which the key light fades faster than Lambert's law
LIGHT_RADIUS = 0.10  # tangent of the key light's angular radius: a window-sized source
KEY_RAYS = 2  # per pixel; a 4 x 4 tile together has 32 different ones
SKY_RAYS = 3
TILE = 4
KEY_REACH = (
    0.9  # shadows are cast from at most this share of the camera's distance: far walls and ceilings let light in
)
SKY_REACH = 0.5
WINDOW = 4  # half width [pixels] of the gathering filter: twice the tile, so that every subset counts the same
PLANE_TOLERANCE = 0.004  # distance from a pixel's plane over its depth at which the filter forgets a neighbour


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceHits:
    """What n rays meet; distance inf and zeros where they meet nothing."""

    direction: Array
    """Unit ray directions, shape (n, 3)."""
    distance: Array
    """Along the ray [m], shape (n,)."""
    position: Array
    """[m], shape (n, 3)."""
    flat: Array
    """Unit face normals towards the viewer, shape (n, 3)."""
    smooth: Array
    """Unit shading normals, shape (n, 3)."""
    color: Array
    """Linear colours 0..1, shape (n, 3)."""
    mesh_index: NDArray[np.int32]
    """Mesh seen, -1 for none, shape (n,)."""

    def take(self, index: NDArray[np.int64]) -> "SurfaceHits":
        """The given rays only."""
        return SurfaceHits(
            self.direction[index], self.distance[index], self.position[index], self.flat[index], self.smooth[index],
            self.color[index], self.mesh_index[index],
        )  # fmt: skip


def colors_of(mesh: Mesh) -> Array:
    """Linear vertex colours 0..1, shape (n, 3)."""
    level = np.arange(256) / 255.0
    table = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return np.asarray(table[mesh.colors])


def background(direction: Array) -> Array:
    """A soft studio backdrop: light grey below, a cooler white above, shape (n, 3)."""
    height = np.clip(0.5 + 0.9 * direction[:, 2:], 0.0, 1.0)
    low, high = np.array([0.66, 0.65, 0.64], dtype=np.float32), np.array([0.83, 0.87, 0.92], dtype=np.float32)
    return np.asarray(low + (high - low) * (height * height * (3.0 - 2.0 * height)), dtype=np.float32)


def shade(surface: SurfaceHits, light: Array, key: NDArray[np.float64]) -> Array:
    """Linear colours of surface points; light (n, 2): shares of the key light and of the sky that reach them."""
    normal, toward = surface.smooth, key.astype(np.float32)
    facing = normal @ toward
    facing = np.clip(facing, 0.0, 1.0)
    # fades in gently: at grazing light the noise of a scan would flicker, and facets would show at the terminator
    lambert = (facing**2 * np.float32(1.0 + GRAZING) / (facing + np.float32(GRAZING)))[:, None]
    up = (0.5 + 0.5 * normal[:, 2])[:, None]
    ambient = (GROUND_COLOR + (SKY_COLOR - GROUND_COLOR) * up) * light[:, 1:]
    headlight = np.clip(-np.einsum("ij,ij->i", normal, surface.direction), 0.0, 1.0)[:, None]
    total = surface.color * (KEY_COLOR * lambert * light[:, :1] + ambient + FILL_COLOR * headlight * light[:, 1:])
    half = toward - surface.direction
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    gloss = np.clip(np.einsum("ij,ij->i", normal, half), 0.0, 1.0) ** SHEEN_POWER
    return np.asarray(total + (SHEEN * gloss * light[:, 0])[:, None], dtype=np.float32)


def visibility(
    caster: Raycaster, surface: SurfaceHits, key: NDArray[np.float64], reach: float, shape: tuple[int, int]
) -> Array:
    """Shares of the key light and the sky that reach each pixel, from a few rays each, shape (h * w, 2)."""
    seen = np.flatnonzero(surface.mesh_index >= 0)
    points = surface.take(seen)
    origin = points.position + points.flat * (2e-4 * points.distance + 1e-5)[:, None]
    tile, wide = bayer(TILE, shape).ravel()[seen], bayer(2 * TILE, shape).ravel()[seen]
    light = np.ones((len(surface.distance), 2), dtype=np.float32)
    light[seen, 0] = key_share(caster, origin, points.flat, tile, wide, key, KEY_REACH * reach)
    light[seen, 1] = sky_share(caster, origin, points.smooth, points.flat, tile, wide, SKY_REACH * reach)
    return light


def key_share(
    caster: Raycaster,
    origin: Array,
    normal: Array,
    tile: NDArray[np.int64],
    wide: NDArray[np.int64],
    key: NDArray[np.float64],
    reach: float,
) -> Array:
    """Share of the key light's disc that is not hidden, shape (n,)."""
    side, other = frame(key[None, :])
    share = np.zeros(len(origin), dtype=np.float32)
    for ray in range(KEY_RAYS):
        u, v = sequence(ray * TILE * TILE + np.arange(TILE * TILE))
        radius, angle = LIGHT_RADIUS * np.sqrt(u)[:, None], 2.0 * np.pi * v[:, None]
        table = key.astype(np.float32) + radius * np.cos(angle) * side + radius * np.sin(angle) * other
        table /= np.linalg.norm(table, axis=1, keepdims=True)
        # the reach varies, so that shadows fade out with distance instead of ending
        limits = reach * (0.5 + 0.5 * levels(ray, KEY_RAYS))
        direction = table.astype(np.float32)[tile]
        toward = np.flatnonzero(np.einsum("ij,ij->i", direction, normal) > 0.0)
        share[toward] += ~caster.occluded(origin[toward], direction[toward], limits[wide[toward]])
    return np.asarray(share / KEY_RAYS, dtype=np.float32)


def sky_share(
    caster: Raycaster,
    origin: Array,
    normal: Array,
    flat: Array,
    tile: NDArray[np.int64],
    wide: NDArray[np.int64],
    reach: float,
) -> Array:
    """Cosine-weighted share of the hemisphere that is not hidden; hidden counts less the farther the hider is, (n,)."""
    side, other = frame(normal)
    share = np.zeros(len(origin), dtype=np.float32)
    for ray in range(SKY_RAYS):
        u, v = sequence(131 + ray * TILE * TILE + np.arange(TILE * TILE))
        x, y, z = np.sqrt(u) * np.cos(2.0 * np.pi * v), np.sqrt(u) * np.sin(2.0 * np.pi * v), np.sqrt(1.0 - u)
        limits = reach * levels(ray, SKY_RAYS) ** 2
        direction = x[tile][:, None] * side + y[tile][:, None] * other + z[tile][:, None] * normal
        # mirrored at the face: a shading normal may lean over it
        depth = np.minimum(np.einsum("ij,ij->i", direction, flat), 0.0)
        direction -= 2.0 * depth[:, None] * flat
        share += ~caster.occluded(origin, direction, limits[wide])
    return np.asarray(share / SKY_RAYS, dtype=np.float32)


def sequence(index: NDArray[np.int64]) -> tuple[Array, Array]:
    """Points of the R2 sequence in the unit square [R18], two arrays of the index's shape."""
    first, second = 0.7548776662466927, 0.5698402909980532  # 1 / g, 1 / g^2 with g^3 = g + 1
    return (
        np.asarray(np.mod(0.5 + first * index, 1.0), dtype=np.float32),
        np.asarray(np.mod(0.5 + second * index, 1.0), dtype=np.float32),
    )


def levels(ray: int, count: int) -> Array:
    """Evenly spread numbers 0..1 for the 64 pixels of a wide tile, different for each of `count` rays, shape (64,)."""
    wide = 4 * TILE * TILE
    return np.asarray((np.arange(wide) * count + ray + 0.5) / (wide * count), dtype=np.float32)


def bayer(side: int, shape: tuple[int, int]) -> NDArray[np.int64]:
    """Number 0 .. side^2 - 1 of each pixel within its tile, neighbours far apart (ordered dithering), shape (h, w)."""
    order = np.zeros((1, 1), dtype=np.int64)
    while len(order) < side:
        order = np.block([[4 * order, 4 * order + 2], [4 * order + 3, 4 * order + 1]])
    return np.asarray(order[np.arange(shape[0])[:, None] % side, np.arange(shape[1])[None, :] % side])


def frame(normal: NDArray[np.floating]) -> tuple[Array, Array]:
    """Two unit vectors across each unit normal (n, 3) [Duff et al., JCGT 6(1), 2017]."""
    sign = np.where(normal[:, 2] >= 0.0, 1.0, -1.0).astype(np.float32)
    a = -1.0 / (sign + normal[:, 2])
    b = normal[:, 0] * normal[:, 1] * a
    side = np.stack([1.0 + sign * normal[:, 0] ** 2 * a, sign * b, -sign * normal[:, 0]], axis=1)
    other = np.stack([b, sign + normal[:, 1] ** 2 * a, -normal[:, 1]], axis=1)
    return np.asarray(side, dtype=np.float32), np.asarray(other, dtype=np.float32)


def gather(light: Array, surface: SurfaceHits, shape: tuple[int, int]) -> Array:
    """Average the light of neighbouring pixels on the same surface, first along rows, then along columns, (h, w, 2)."""
    result = light.reshape(*shape, 2)
    position, normal = surface.position.reshape(*shape, 3), surface.smooth.reshape(*shape, 3)
    position = np.where(np.isfinite(position), position, 0.0).astype(np.float32)
    depth = np.where(np.isfinite(surface.distance), surface.distance, 1.0).astype(np.float32)
    tolerance = PLANE_TOLERANCE * depth.reshape(shape)
    for axis in (1, 0):
        result = gather_axis(result, position, normal, tolerance, axis)
    return result


def gather_axis(light: Array, position: Array, normal: Array, tolerance: Array, axis: int) -> Array:
    """One direction of `gather`: weights 1 inside the window, 1/2 at its ends, less off the pixel's plane."""
    total, weight_sum = light.copy(), np.ones(light.shape[:2], dtype=np.float32)
    for offset in [o for k in range(1, WINDOW + 1) for o in (-k, k)]:
        here, there = shifted(offset, axis)
        away = np.einsum("ijk,ijk->ij", position[there] - position[here], normal[here]) / tolerance[here]
        turn = np.clip(np.einsum("ijk,ijk->ij", normal[there], normal[here]), 0.0, 1.0)
        weight = turn**8 * np.exp(-away * away) * np.float32(0.5 if abs(offset) == WINDOW else 1.0)
        total[here] += weight[..., None] * light[there]
        weight_sum[here] += weight
    return total / weight_sum[..., None]


def shifted(offset: int, axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slices of the pixels that have a neighbour at `offset` along the axis, and of these neighbours."""
    low, high = (
        slice(max(0, -offset), -offset if offset > 0 else None),
        slice(max(0, offset), offset if offset < 0 else None),
    )
    return ((low, slice(None)), (high, slice(None))) if axis == 0 else ((slice(None), low), (slice(None), high))
