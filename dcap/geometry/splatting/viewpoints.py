"""Viewpoints for splats: in the free space inside a room, or all around a single thing.

A scan by Gaussians has no floor plan of its own. A place is free if it is far enough from every opaque Gaussian, and
inside if Gaussians lie in nearly all directions.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
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
