"""Cameras of a settled placement, and the share of the object that each of them sees.

In: the scene, its painted mesh and the object at rest. Out: the meshes visible to each camera, prepared once for all;
the automatic camera; per fixed view around the object, and from standing height in the room, the visible share of the
object's silhouette and of its outline. A thing is recognised by its outline [B87], so recognisability is the uncovered
share of the outline.

[B87] Biederman: Recognition-by-components: a theory of human image understanding. Psychological Review 94, 1987.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.painted import caster_of
from dcap.geometry.rendering.picture import Exposure, exposed
from dcap.geometry.rendering.shading import spread_points
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh, PaintedMesh
from dcap.scene.types.pictures import Visibility
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.render.config import RenderConfig
from tasks.render.settled_meshes import Cutaway, floor_of

SEEN_POINTS = 400  # number of points on the object whose visibility ranks the views
POORLY_SEEN = 0.2  # visible share below which an object is also viewed from above
FRONT_BONUS = 0.25  # preference for the front over the side, in units of visible share
FROM_ABOVE_DEG = (65.0, 85.0)
"""Elevations to try if the preferred ones show little of the object [degrees]."""
AZIMUTHS_DEG = (20.0, -20.0, 45.0, -45.0, 70.0, -70.0, 100.0, -100.0, 180.0)
"""Azimuths from the base's front to try [degrees]."""
CANONICAL_SIZE = 192
"""Side of the views that measure visibility and recognisability [pixels]."""
AZIMUTHS = np.arange(0.0, 360.0, 45.0)
ELEVATIONS = (15.0, 45.0)
TOP = 89.0
"""Views around the object: angles off the base's front and over the horizon [degrees], and one view from above."""
EYE_HEIGHT, RINGS, ON_A_RING = 1.6, (1.5, 2.5), 12
"""Viewpoints of standing people: height of their eyes over the lowest point of the scene, distances from the object
[m]."""


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
    """Horizontal unit vector towards the viewer: along the base's front, else towards the middle of the room."""
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
    """The candidate with the best view of the object, preferring the front and the first elevation.

    An object that is poorly visible in all of them, as in a deep vessel, is viewed from above if that shows more.
    """
    points, normals = spread_points(thing, SEEN_POINTS)

    def best_of(elevations_deg: tuple[float, ...]) -> ChosenView:
        best, best_score = None, -np.inf
        for rank, elevation in enumerate(elevations_deg):
            for azimuth in AZIMUTHS_DEG:
                position = target + distance * direction(toward, azimuth, elevation)
                seen = visible_share(things, points, normals, position)
                score = seen + FRONT_BONUS * np.cos(np.radians(azimuth)) - 0.15 * rank
                if score > best_score + 1e-9:
                    camera = looking_at(position, target, config.size, config.size, fov_deg=config.fov_deg)
                    best, best_score = ChosenView(camera, seen), score
        assert best is not None
        return best

    chosen = best_of(config.elevations_deg)
    if chosen.visible >= POORLY_SEEN:
        return chosen
    above = best_of(FROM_ABOVE_DEG)
    return above if above.visible > chosen.visible else chosen


def direction(toward: Array, azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector at an azimuth off a horizontal direction and an elevation over the horizon."""
    a, e = np.radians(azimuth_deg), np.radians(elevation_deg)
    side = np.array([-toward[1], toward[0], 0.0])
    return np.asarray(np.cos(e) * (np.cos(a) * toward + np.sin(a) * side) + np.sin(e) * np.array([0.0, 0.0, 1.0]))


def visible_share(caster: Raycaster, points: Array, normals: Array, camera: Array) -> float:
    """Share of the points facing a camera that are not hidden."""
    way = camera - points
    facing = np.einsum("ij,ij->i", way, normals) > 0.0
    length = np.linalg.norm(way[facing], axis=1)
    blocked = caster.occluded(points[facing] + 1e-3 * normals[facing], way[facing] / length[:, None], length)
    return float(1.0 - blocked.mean()) if len(blocked) else 0.0


def visible_fraction(seen: NDArray[np.bool_], thing: PaintedMesh, camera: Camera) -> float:
    """Visible pixels of the object in the scene, given by a mask, over its pixels without the scene."""
    around = camera.project(thing.mesh.vertices)[:, :2]
    low, high = around.min(axis=0) - 1.0, around.max(axis=0) + 1.0
    size = np.array([camera.width, camera.height])
    first = np.clip(np.ceil(low - 0.5), 0, size).astype(int)
    last = np.maximum(np.clip(np.floor(high - 0.5) + 1, 0, size).astype(int), first)
    pixels = camera.pixel_centers.reshape(camera.height, camera.width, 2)[first[1] : last[1], first[0] : last[0]]
    ways = camera.directions(pixels.reshape(-1, 2))
    rays = packed_rays(np.broadcast_to(camera.position, ways.shape), ways)
    alone = int((caster_of([thing]).first_hits(rays).face >= 0).sum())
    return int(seen.sum()) / alone if alone else 0.0


def canonical_views(scene: Mesh, thing: Mesh, target: Array, toward: Array, config: RenderConfig) -> Visibility:
    """The visible shares of the object (a mesh at rest) within the scene without it.

    Args:
        scene: everything else at rest.
        thing: the object at rest.
        target: middle of the contact [m], shape (3,).
        toward: horizontal unit vector of the base's front, shape (3,).
        config: field of view and distance of the views.
    """
    around, alone = Raycaster(scene), Raycaster(thing)
    middle = thing.bounds.mean(axis=0)
    distance = config.nearest * float(np.linalg.norm(np.ptp(thing.vertices, axis=0)))
    ways = [(azimuth, elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS] + [(0.0, TOP)]
    rows = []
    for azimuth, elevation in ways:
        position = middle + distance * direction(toward, azimuth, elevation)
        camera = looking_at(position, middle, CANONICAL_SIZE, CANONICAL_SIZE, fov_deg=config.fov_deg)
        view = camera.directions(camera.pixel_centers)
        rays = packed_rays(np.broadcast_to(camera.position, view.shape), view)
        own = alone.first_hits(rays)
        mine = np.flatnonzero(own.face >= 0)
        seen = np.zeros(len(rays), dtype=bool)
        seen[mine] = around.first_hits(rays[mine]).distance > own.distance[mine]
        shape = (camera.height, camera.width)
        silhouette = (own.face >= 0).reshape(shape)
        outline = (silhouette & ~binary_erosion(silhouette)).ravel()
        rows.append((azimuth, elevation, share_of(seen, own.face >= 0), share_of(seen, outline)))
    return Visibility(np.array(rows), from_the_room(scene, around, thing, target))


def share_of(seen: NDArray[np.bool_], asked: NDArray[np.bool_]) -> float:
    """Visible share of a mask [-]."""
    count = int(asked.sum())
    return float((seen & asked).sum()) / count if count else 0.0


def from_the_room(scene: Mesh, around: Raycaster, thing: Mesh, target: Array) -> float:
    """Mean visible share of the object from standing height around it, inside the scene's bounds; 0 if there is nowhere
    to stand."""
    points, normals = spread_points(thing, SEEN_POINTS)
    low, high = scene.bounds
    shares = []
    for radius in RINGS:
        angle = 2.0 * np.pi * np.arange(ON_A_RING) / ON_A_RING
        eyes = target[:2] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for eye in eyes[((eyes > low[:2]) & (eyes < high[:2])).all(axis=1)]:
            shares.append(visible_share(around, points, normals, np.array([*eye, low[2] + EYE_HEIGHT])))
    return float(np.mean(shares)) if shares else 0.0


class SceneViews:
    """Views of a scene by several cameras."""

    def __init__(
        self, scene: Segmentation, look: PaintedMesh | None = None, things: Sequence[PaintedMesh] = ()
    ) -> None:
        """`look`: the scene's painted mesh, if it has textures; `things`: meshes that are never cut away."""
        self._cutaway = Cutaway(scene)
        around = [look or PaintedMesh(scene.mesh), *floor_of(scene)]
        self._meshes = PreparedMeshes([*around, *things])
        self._things = self._meshes.mesh_of_face >= len(around)

    def seen_by(self, camera: Camera) -> PreparedMeshes:
        """Meshes visible to a camera: first the scene without cut-away faces, then the other meshes."""
        cut = self._cutaway.faces(camera)
        shown = np.ones(len(self._things), dtype=bool)
        shown[: len(cut)] = ~cut
        return self._meshes.showing(shown)

    def exposed(self, camera: Camera, *, low_light: bool = False) -> Exposure:
        """A camera's view of the scene alone, still to be developed."""
        seen = self.seen_by(camera)
        return exposed(seen.showing(seen.shown & ~self._things), camera, low_light=low_light)

    def with_things(self, alone: Exposure) -> Exposure:
        """A view of the scene alone, with the other meshes added."""
        return alone.adding(self._things)
