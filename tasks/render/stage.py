"""Stage 9, render: the scene before, the object at rest in it, and its contact from nearby.

In: scene, object, anchor and the settled state. Out: three pictures and the visible share of the object, or `buried`
where the scene hides it. The camera looks at the contact from the front of the base and above, at 1.5 times the base
part's box diagonal (the paper's section 4.3), from where it sees most of the object; walls and ceiling in its way are
cut away.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt
from scipy.ndimage import binary_closing, binary_erosion
from scipy.spatial import cKDTree

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.picture import Picture, picture
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import HiddenObject, Infeasible, Reason
from dcap.scene.types.renders import Renders
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from tasks.render.settled_meshes import settled_item, settled_scene, shown, structure_faces
from tasks.runner.stage import stage

Array = NDArray[np.float64]

SEEN_POINTS = 400  # surface points of the object whose visibility ranks the views
FRONT_BONUS = 0.25  # preference for the front over the side, in units of visible share
TINTS = np.array([[255.0, 122.0, 26.0], [0.0, 172.0, 240.0]])
TINT_SHARE, LINE_SHARE = 0.30, 0.85  # opacity of the contact patch and of its outline
LEAST_PATCH = 1.5e-3  # a contact point stands for a disc of at least this radius [m]


class RenderConfig(BaseModel, frozen=True, extra="forbid"):
    """How the pictures are taken."""

    size: PositiveInt = 1024
    """Side of each picture [pixels]."""
    fov_deg: PositiveFloat = 55.0
    """Field of view [degrees]."""
    distance_factor: PositiveFloat = 1.5
    """Camera distance over the diagonal of the base part's box [-]."""
    nearest: PositiveFloat = 2.2
    """Smallest camera distance over the object's diagonal [-]."""
    farthest: PositiveFloat = 14.0
    """Largest camera distance over the object's diagonal [-]: beyond it the object is too small to judge."""
    closeup_factor: PositiveFloat = 1.35
    """Camera distance of the close-up over the object's diagonal [-]."""
    elevations_deg: tuple[float, ...] = (27.0, 14.0, 45.0)
    """Heights of the camera over the horizon that are tried [degrees], the preferred one first."""
    azimuths_deg: tuple[float, ...] = (20.0, -20.0, 45.0, -45.0, 70.0, -70.0, 100.0, -100.0, 180.0)
    """Directions off the base's front that are tried [degrees]."""
    samples: PositiveInt = 2
    """Rays across a pixel at edges."""
    least_visible: NonNegativeFloat = 0.02
    """Share of the object's pixels below which it is buried [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class ChosenView:
    """A camera and how much of the object it sees."""

    camera: Camera
    visible: float


def render(
    scene: SegmentedScene,
    item: SegmentedObject,
    anchor: Anchor,
    settled: Settled,
    config: RenderConfig,
    before: SegmentedScene | None = None,
) -> Renders | Infeasible:
    """Take the three pictures; `before` is the scene that was given, where the drop started from another state."""
    thing = settled_item(item, anchor, settled.bodies[0])
    after = settled_scene(scene, settled, anchor.base_id).scene
    solid = ~structure_faces(after)
    things = Raycaster(after.mesh.submesh(np.flatnonzero(solid)))
    target = contact_middle(settled, anchor)
    view = best_view(things, thing, target, view_distance(scene, anchor, thing, config), front(scene, anchor), config)
    around = shown(after, view.camera)
    rest = photograph([*around, thing], view.camera, config)
    fraction = visible_fraction(rest.mesh_index == len(around), thing, view.camera)
    if fraction < config.least_visible:
        return Infeasible(
            Reason.BURIED,
            f"only {fraction:.1%} of the object is visible (RenderConfig.least_visible {config.least_visible})",
            HiddenObject(visible_fraction=fraction, camera_position=view.camera.position),
        )
    clean = photograph(shown(before or scene, view.camera), view.camera, config)
    near = closeup(after, things, thing, settled, view, config)
    return Renders(clean.rgb, rest.rgb, near, fraction, view.camera.position, target)


def photograph(meshes: list[Mesh], camera: Camera, config: RenderConfig) -> Picture:
    """What the camera sees."""
    return picture(meshes, camera, samples=config.samples)


# --- where the camera stands ------------------------------------------------------------------------------------------


def contact_middle(settled: Settled, anchor: Anchor) -> Array:
    """What the camera looks at [m]: the middle of the contact, or where it was predicted."""
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
    """The candidate from which most of the object is seen, the front and the first elevation being preferred."""
    points, normals = surface_points(thing)
    best, best_score = None, -np.inf
    for rank, elevation in enumerate(config.elevations_deg):
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


def surface_points(mesh: Mesh) -> tuple[Array, Array]:
    """Points spread over a surface by area, and unit normals there, each of shape (n, 3)."""
    area = np.cumsum(mesh.face_areas)
    face = np.searchsorted(area, (np.arange(SEEN_POINTS) + 0.5) / SEEN_POINTS * area[-1])
    normal = mesh.face_normals[face]
    return mesh.triangles[face].mean(axis=1), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def visible_share(caster: Raycaster, points: Array, normals: Array, camera: Array) -> float:
    """Share of the points facing a camera that nothing hides."""
    way = camera - points
    facing = np.einsum("ij,ij->i", way, normals) > 0.0
    length = np.linalg.norm(way[facing], axis=1)
    blocked = caster.occluded(points[facing] + 1e-3 * normals[facing], way[facing] / length[:, None], length)
    return float(1.0 - blocked.mean()) if len(blocked) else 0.0


def visible_fraction(seen: NDArray[np.bool_], thing: Mesh, camera: Camera) -> float:
    """Pixels of the object that are seen in the scene, a mask, over its pixels alone."""
    around = camera.project(thing.vertices)[:, :2]
    rays = rays_between(camera, around.min(axis=0) - 1.0, around.max(axis=0) + 1.0)[1]
    alone = int((Raycaster(thing).first_hits(rays).face >= 0).sum())
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


# --- the contact ------------------------------------------------------------------------------------------------------


def closeup(
    scene: Segmentation, things: Raycaster, thing: Mesh, settled: Settled, view: ChosenView, config: RenderConfig
) -> NDArray[np.uint8]:
    """The contact from nearby, its patch tinted as if the object were glass."""
    size = np.ptp(thing.vertices, axis=0)
    target = view.camera.target + np.array([0.0, 0.0, 0.22 * size[2]])
    way = view.camera.position - view.camera.target
    flat = np.array([way[0], way[1], 0.0])
    flat /= np.linalg.norm(flat)
    distance = config.closeup_factor * float(np.linalg.norm(size))
    camera = best_view(things, thing, target, distance, flat, config).camera
    meshes = shown(scene, camera)
    taken = photograph([*meshes, thing], camera, config)
    return tinted(taken.rgb, contact_mask(meshes, settled.contact_points, camera))


def contact_mask(meshes: list[Mesh], contact: Array, camera: Camera) -> NDArray[np.bool_]:
    """Pixels of the scene (seen through the object) that belong to the contact patch, shape (h, w)."""
    mask = np.zeros((camera.height, camera.width), dtype=bool)
    if len(contact) == 0:
        return mask
    around = camera.project(contact)
    radius = patch_radius(contact)
    reach = 2.0 * radius / around[:, 2].min() * camera.focal + 2.0
    place, rays = rays_between(camera, around[:, :2].min(axis=0) - reach, around[:, :2].max(axis=0) + reach)
    hits = Raycaster(Mesh.concatenate(meshes)).first_hits(rays)
    hit = np.flatnonzero(hits.face >= 0)
    points = rays[hit, :3].astype(np.float64) + hits.distance[hit, None] * rays[hit, 3:]
    close = ((points > contact.min(axis=0) - radius) & (points < contact.max(axis=0) + radius)).all(axis=1)
    found = np.zeros(len(rays), dtype=bool)
    away = cKDTree(contact).query(points[close], distance_upper_bound=radius, workers=-1)[0]
    found[hit[close]] = away <= radius
    mask[place] = found.reshape(mask[place].shape)
    return mask


def patch_radius(contact: Array) -> float:
    """Radius [m] of the disc that one contact point stands for: so that neighbours' discs overlap."""
    if len(contact) < 2:
        return 4.0 * LEAST_PATCH
    spacing = np.median(cKDTree(contact).query(contact, k=2)[0][:, 1])
    extent = float(np.linalg.norm(np.ptp(contact, axis=0)))
    return float(np.clip(1.6 * spacing, LEAST_PATCH, max(0.05 * extent, LEAST_PATCH)))


def tinted(rgb: NDArray[np.uint8], mask: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """A picture with the masked pixels tinted and outlined, in the colour that differs more from what is there."""
    if not mask.any():
        return rgb
    width = max(1, round(len(rgb) / 512))
    mask = closed(mask, 4 * width)
    tint = TINTS[int(np.argmax(np.linalg.norm(TINTS - rgb[mask].mean(axis=0), axis=1)))]
    line = mask & ~binary_erosion(mask, iterations=width)
    share = np.where(line, LINE_SHARE, np.where(mask, TINT_SHARE, 0.0))[..., None]
    return np.asarray(np.round(rgb * (1.0 - share) + tint * share), dtype=np.uint8)


def closed(mask: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
    """A mask (h, w) with gaps of up to 2 * steps pixels filled."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    place = (slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1))
    rim = 2 * steps
    result = np.zeros_like(mask)
    result[place] = binary_closing(np.pad(mask[place], rim), iterations=steps)[rim:-rim, rim:-rim]
    return result


render_task = stage(render)
