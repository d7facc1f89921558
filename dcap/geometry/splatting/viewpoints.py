"""Viewpoints for splats: in the free space inside a room, or all around a single thing.

A scan by Gaussians has no floor plan of its own. A place is free if it is far enough from every opaque Gaussian, and
inside if Gaussians lie in nearly all directions.

Selection of the Gaussians that are part of the visible surface, with the best viewpoint of each.

The share of a pixel is not sufficient: in a layer of overlapping Gaussians, the last one in the order by depth has no
larger share than one in a layer below, between two of the first. The position is: a Gaussian behind the plane of the
one that stops most of the light in its pixel is hidden.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.render import RenderedSplats, Splatter
from dcap.scene.types.gaussians import Gaussians

CANDIDATES = 3000
OPAQUE = 0.5
"""Opacity below which Gaussians do not obstruct [-]."""
CLEARANCE = 0.25
"""Least distance of a camera from opaque Gaussians [m]."""
ENCLOSED = 0.75
"""Least share of directions with Gaussians for a place inside a room [-]."""
BANDS, SECTORS = 6, 12
"""Numbers of equal bands of height and of sectors of azimuth into which directions are divided."""
GRAIN = 0.02
"""Size of the cells in which one Gaussian represents all others for directions, over the scene's diagonal [-]."""
AT_ONCE = 2_000_000
"""Number of pairs of a place and a Gaussian processed together."""
CUBE = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64)
FOV_DEG = 92.0
"""Field of view [degrees]: six pictures of a right angle see everything; slightly more makes them overlap."""
Progress = Callable[[float, str], None]


def viewpoints(splats: Gaussians, places: int, pixels: int, seed: int = 0, enclosed: float = ENCLOSED) -> list[Camera]:
    """Square cameras that together see everything visible: six at each of `places` inside a room, or one at each of
    three times as many around a scene without an inside."""
    inside = inner_places(splats, places, seed, enclosed)
    if len(inside):
        return [looking_at(p, p + d, pixels, pixels, fov_deg=FOV_DEG) for p in inside for d in CUBE]
    outside, center = outer_places(splats, 3 * places, np.radians(FOV_DEG))
    return [looking_at(p, center, pixels, pixels, fov_deg=FOV_DEG) for p in outside]


def outer_places(splats: Gaussians, count: int, field_of_view: float) -> tuple[Array, Array]:
    """Places all around from which everything is in the picture [m], shape (count, 3), and the middle as target."""
    low, high = bulk(splats)
    center, radius = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    return center + 1.1 * radius / np.sin(0.5 * field_of_view) * fibonacci(count), center


def bulk(splats: Gaussians) -> tuple[Array, Array]:
    """Box of all opaque Gaussians except the outermost half per cent on each side [m]; scans have strays far away."""
    opaque = splats.position[splats.opacity > OPAQUE]
    low, high = np.quantile(opaque if len(opaque) else splats.position, [0.005, 0.995], axis=0)
    return low.astype(np.float64), high.astype(np.float64)


def inner_places(splats: Gaussians, count: int, seed: int, enclosed: float = ENCLOSED) -> Array:
    """Up to `count` places inside, far apart from each other [m], shape (k, 3); empty if there is no inside."""
    random = np.random.default_rng(seed)
    low, high = bulk(splats)
    points = random.uniform(low, high, (CANDIDATES, 3))
    opaque = splats.subset(splats.opacity > OPAQUE)
    if not len(opaque):
        return np.zeros((0, 3))
    distance, _ = cKDTree(opaque.position).query(points)
    points = points[distance > CLEARANCE + 2.0 * float(np.median(opaque.scale.max(axis=1)))]
    _, some = np.unique(np.floor(opaque.position / (GRAIN * np.linalg.norm(high - low))), axis=0, return_index=True)
    return far_apart(points[enclosure(points, opaque.position[some]) >= enclosed], count)


def enclosure(places: Array, positions: NDArray[np.floating]) -> Array:
    """Share of directions from each place (k, 3) with positions (n, 3) [-], shape (k,)."""
    full = np.zeros((len(places), BANDS * SECTORS), dtype=bool)
    step = max(AT_ONCE // max(len(positions), 1), 1)
    for first in range(0, len(places), step):
        x, y, z = np.moveaxis(positions - places[first : first + step, None], 2, 0).astype(np.float32)
        rise = z / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-9)
        band = np.minimum(((rise + 1.0) * 0.5 * BANDS).astype(int), BANDS - 1)
        sector = np.minimum(((np.arctan2(y, x) / (2 * np.pi) + 0.5) * SECTORS).astype(int), SECTORS - 1)
        full[np.arange(first, first + len(x))[:, None], band * SECTORS + sector] = True
    return np.asarray(full.mean(axis=1))


def far_apart(points: Array, count: int) -> Array:
    """A subset that leaves no large gap, in the order of the points if it contains all of them."""
    return points if len(points) <= count else points[far_apart_index(points, count)]


def far_apart_index(points: Array, count: int) -> NDArray[np.int64]:
    """Indices of up to `count` points: the first is the most central, each next one the farthest from those already
    chosen."""
    if not len(points) or not count:
        return np.zeros(0, dtype=np.int64)
    taken = [int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[taken[0]], axis=1)
    while len(taken) < min(count, len(points)):
        taken.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[taken[-1]], axis=1))
    return np.array(taken, dtype=np.int64)


def fibonacci(count: int) -> Array:
    """Directions spread evenly over the sphere, shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def best_origins(
    splatter: Splatter, gap: NDArray[np.float32], config: SurfaceConfig, progress: Progress | None = None
) -> Array:
    """Position of the camera that sees each Gaussian best, frontally and from nearby [m], shape (n, 3); NaN if none
    does. `gap` is the spacing of Gaussians around each [m], shape (n,)."""
    splats = splatter.splats
    best, origin = np.zeros(len(splats)), np.full((len(splats), 3), np.nan)
    for seen in sightings(splatter, gap, viewpoints(splats, config.places, config.pixels), config, progress):
        score = seen.weight * np.abs(seen.cosine) / seen.distance
        better = score > best[seen.index]
        best[seen.index[better]], origin[seen.index[better]] = score[better], seen.camera.position
    return origin


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """The Gaussians of the visible surface that one camera sees."""

    camera: Camera
    index: NDArray[np.int64]
    """Indices of the Gaussians, shape (k,)."""
    weight: NDArray[np.float32]
    """Largest share of each Gaussian in a pixel [-], shape (k,)."""
    cosine: Array
    """Cosine of the angle between its thinnest axis and the direction to the camera, of either sign [-], shape (k,)."""
    distance: Array
    """Distance to the camera [m], shape (k,)."""


def sightings(
    splatter: Splatter,
    gap: NDArray[np.float32],
    cameras: Sequence[Camera],
    config: SurfaceConfig,
    progress: Progress | None = None,
) -> Iterator[Sighting]:
    """Sightings of Gaussians from each camera; `gap` is the spacing of Gaussians around each [m], shape (n,)."""
    splats = splatter.splats
    flat = np.take_along_axis(splatter.axes, splats.log_scale.argmin(axis=1)[:, None, None], axis=2)[:, :, 0]
    for i, camera in enumerate(cameras):
        view = splatter.view(camera)
        visible = np.flatnonzero(view.weight > config.seen)
        visible = visible[behind(splats.position, flat, view, camera, visible) <= config.slack * gap[visible]]
        away = camera.position - splats.position[visible]
        distance = np.linalg.norm(away, axis=1)
        cosine = np.einsum("ni,ni->n", flat[visible], away) / distance
        yield Sighting(camera, visible, view.weight[visible], cosine, distance)
        if progress is not None:
            progress(0.5 * (i + 1) / len(cameras), f"view {i + 1} of {len(cameras)}")


def behind(
    position: NDArray[np.float32],
    flat: NDArray[np.float32],
    view: RenderedSplats,
    camera: Camera,
    index: NDArray[np.int64],
) -> Array:
    """Distance of the Gaussians with these indices behind the plane of the front Gaussian in the pixel of their middle
    [m], shape (k,): negative in front of it or if there is none, infinite if the middle is not in the picture.

    `flat` are the thinnest axes (n, 3) of all Gaussians at `position` (n, 3)."""
    place = position[index].astype(np.float64)
    column, row = np.floor(camera.project(place)[:, :2]).astype(np.int64).T
    inside = (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    front = view.front[np.where(inside, row, 0), np.where(inside, column, 0)]
    normal = flat[front].astype(np.float64)
    normal *= np.sign(np.einsum("ni,ni->n", camera.position - position[front], normal))[:, None]
    depth = np.einsum("ni,ni->n", position[front] - place, normal)
    return np.where(inside, np.where(front >= 0, depth, -np.inf), np.inf)
