"""Chooses the camera, and measures the visibility of the object from it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.see_through import caster_of
from dcap.geometry.rendering.visibility import spread_points
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import PaintedMesh
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.render.config import RenderConfig

Array = NDArray[np.float64]

SEEN_POINTS = 400  # number of surface points of the object whose visibility ranks the views
POORLY_SEEN = 0.2  # visible share below which an object is looked at from above, too
FRONT_BONUS = 0.25  # preference for the front over the side, in units of visible share


@dataclass(frozen=True, eq=False, slots=True)
class ChosenView:
    """A camera and the visible share of the object."""

    camera: Camera
    visible: float


def contact_middle(settled: Settled, anchor: Anchor) -> Array:
    """Target of the camera [m]: the middle of the contact, or its predicted place."""
    if len(settled.contact_points):
        return np.asarray(settled.contact_points.mean(axis=0))
    return anchor.surface_point


def view_distance(scene: Segmentation, anchor: Anchor, thing: Mesh, config: RenderConfig) -> float:
    """Camera distance [m]: a multiple of the base part's diagonal, clamped by the object's size."""
    part = scene.instances[scene.index_of(anchor.base_id)].parts[anchor.part_index]
    diagonal = float(np.linalg.norm(np.ptp(thing.vertices, axis=0)))
    wanted = config.distance_factor * part.box.diagonal
    return float(np.clip(wanted, config.nearest * diagonal, config.farthest * diagonal))


def front(scene: Segmentation, anchor: Anchor) -> Array:
    """Horizontal unit vector towards the viewer: the base's front, else towards the middle of the room."""
    own = scene.instances[scene.index_of(anchor.base_id)]
    if own.front is not None:
        return np.asarray(own.front)
    away = scene.mesh.bounds.mean(axis=0) - own.box.center
    length = float(np.linalg.norm(away[:2]))
    if length < 0.1 * float(np.linalg.norm(np.ptp(scene.mesh.vertices, axis=0))):
        return np.array([0.0, -1.0, 0.0])
    return np.array([away[0], away[1], 0.0]) / length


def best_view(
    things: Raycaster, thing: Mesh, target: Array, distance: float, toward: Array, config: RenderConfig
) -> ChosenView:
    """The candidate that sees most of the object, preferring the front and the first elevation.

    An object that all of these show poorly, as in a deep vessel, is seen from above if that shows more.
    """
    chosen = best_of(things, thing, target, distance, toward, config.elevations_deg, config)
    if chosen.visible >= POORLY_SEEN:
        return chosen
    above = best_of(things, thing, target, distance, toward, config.from_above_deg, config)
    return above if above.visible > chosen.visible else chosen


def best_of(
    things: Raycaster,
    thing: Mesh,
    target: Array,
    distance: float,
    toward: Array,
    elevations_deg: tuple[float, ...],
    config: RenderConfig,
) -> ChosenView:
    """The best candidate at some elevations."""
    points, normals = spread_points(thing, SEEN_POINTS)
    best, best_score = None, -np.inf
    for rank, elevation in enumerate(elevations_deg):
        for azimuth in config.azimuths_deg:
            position = target + distance * direction(toward, azimuth, elevation)
            seen = visible_share(things, points, normals, position)
            score = seen + FRONT_BONUS * np.cos(np.radians(azimuth)) - 0.15 * rank
            if score > best_score + 1e-9:
                camera = looking_at(position, target, config.size, config.size, fov_deg=config.fov_deg)
                best, best_score = ChosenView(camera, seen), score
    assert best is not None
    return best


def direction(toward: Array, azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector at an azimuth off a horizontal one and an elevation over the horizon."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    side = np.array([-toward[1], toward[0], 0.0])
    return np.asarray(np.cos(e) * (np.cos(a) * toward + np.sin(a) * side) + np.sin(e) * np.array([0.0, 0.0, 1.0]))


def visible_share(caster: Raycaster, points: Array, normals: Array, camera: Array) -> float:
    """Share of the points facing a camera that nothing hides."""
    way = camera - points
    facing = np.einsum("ij,ij->i", way, normals) > 0.0
    length = np.linalg.norm(way[facing], axis=1)
    blocked = caster.occluded(points[facing] + 1e-3 * normals[facing], way[facing] / length[:, None], length)
    return float(1.0 - blocked.mean()) if len(blocked) else 0.0


def visible_fraction(seen: NDArray[np.bool_], thing: PaintedMesh, camera: Camera) -> float:
    """Visible pixels of the object in the scene, a mask, over its pixels alone."""
    around = camera.project(thing.mesh.vertices)[:, :2]
    rays = rays_between(camera, around.min(axis=0) - 1.0, around.max(axis=0) + 1.0)[1]
    alone = int((caster_of([thing]).first_hits(rays).face >= 0).sum())
    return int(seen.sum()) / alone if alone else 0.0


def rays_between(camera: Camera, low: Array, high: Array) -> tuple[tuple[slice, slice], NDArray[np.float32]]:
    """The rows and columns whose centres lie between two image points, and packed rays through them, row by row."""
    size = np.array([camera.width, camera.height])
    first = np.clip(np.ceil(low - 0.5), 0, size).astype(int)
    last = np.maximum(np.clip(np.floor(high - 0.5) + 1, 0, size).astype(int), first)
    place = (slice(first[1], last[1]), slice(first[0], last[0]))
    center = camera.pixel_centers.reshape(camera.height, camera.width, 2)[place].reshape(-1, 2)
    ways = camera.directions(center)
    return place, packed_rays(np.broadcast_to(camera.position, ways.shape), ways)
