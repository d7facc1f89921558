"""Chooses the cameras of judged pictures independently of the methods.

In: each method's final surfaces of the scene and of the object. Out: one overview camera for all methods of a sample,
which fits all their final states, and close-ups of the contact, with the same direction and distance for all, each
centred on its own contact. The directions maximise the visibility of the least visible of the compared placements.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.shading import spread_points
from dcap.geometry.rendering.view_volume import LEVEL_COS
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.pictures import Sights, Viewpoint

Direction = tuple[float, float]
"""Azimuth off +x, counterclockwise from above, and elevation over the horizon [degrees]."""

SIZE = 768
"""Width and height of the pictures [pixel]: the largest square that no API makes smaller (OpenAI scales the shorter
side to 768 pixels, Anthropic the longer one to 1568)."""
SAMPLES = 2
"""Rays along each side of a pixel at edges [-]."""
AZIMUTHS = tuple(22.5 * k for k in range(16))
GRAZING = (12.0, 22.0, 35.0, 50.0)
"""Elevations that are tried for the close-up, the preferred one first: a gap is visible along the surface [degrees]."""
ABOVE = (32.0, 45.0, 60.0)
"""Elevations that are tried for the overview [degrees]."""
CLOSEUPS: tuple[Direction, ...] = tuple((a, e) for e in GRAZING for a in AZIMUTHS)
OVERVIEWS: tuple[Direction, ...] = tuple((a, e) for e in ABOVE for a in AZIMUTHS)
ASIDE_DEG = 20.0
"""Angle of the preferred azimuth off the direction to the middle of the scene: two sides of things show [degrees]."""
ENOUGH = 0.8
"""Share of the best visibility that counts as good as the best [-]."""
STEEPER, TURNED = 0.1, 0.3
"""Penalties of a step up in elevation, and of a camera on the far side, against full visibility [-]."""
CLOSEUP_FOV, OVERVIEW_FOV = 30.0, 40.0
"""Fields of view [degrees]."""
SHARE, NARROWEST, WIDEST = 0.9, 0.1, 0.4
"""Width that a close-up shows at the contact: over the object's diagonal [-], and its least and largest value [m]. 2 mm
are about four pixels."""
BELOW_MIDDLE = 0.12
"""Distance of the contact below the middle of the close-up, over its width [-]."""
MARGIN = 1.15
"""Margin of an overview around its content [-]."""
AROUND = 1.5
"""Extent around the objects in which a support that is a whole floor is shown [m]."""
OFF_MIDDLE = 0.1
"""Distance from the middle of the scene beyond which a support has a side towards it [m]."""
FRONT = -90.0
"""Azimuth of that side for a support in the middle [degrees]."""
COARSE = 96
"""Rays along each side of the pictures for measuring visibility [-]."""
SEEN_POINTS = 400
"""Number of points of the object for measuring its visibility [-]."""
FAR = 6.0
"""Largest distance at which something may hide the object from an overview [m]."""
HIDES, HIDES_M = 0.1, 0.03
"""An obstacle hides the contact if it is nearer than the object's lower edge by more than this share of its diagonal
and this length [m]; the rim of a dent does not."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacedThing:
    """An object among its possible obstacles: everything but walls and ceilings, which pictures leave out."""

    thing: Mesh
    around: Raycaster

    @classmethod
    def of(cls, scene: Mesh, structure: NDArray[np.bool_], thing: Mesh) -> "PlacedThing":
        """The object in a scene, whose structure is a mask of its faces (m,)."""
        level = np.abs(unit(scene.face_normals)[:, 2]) > LEVEL_COS
        height = scene.triangles[:, :, 2].mean(axis=1)
        floor = level & (height < thing.bounds[1, 2])
        return cls(thing, Raycaster(scene, np.flatnonzero(~structure | floor)))

    @property
    def diagonal(self) -> float:
        """Diagonal of the object's bounds [m]."""
        return float(np.linalg.norm(np.ptp(self.thing.bounds, axis=0)))

    def visible_share(self, toward: Direction) -> float:
        """Share of the object's surface that the scene does not hide from a direction."""
        points, normals = spread_points(self.thing, SEEN_POINTS)
        way = along(toward)
        facing = normals @ way > 0.0
        start = points[facing] + 1e-3 * normals[facing]
        hidden = self.around.occluded(start, np.broadcast_to(way, start.shape), FAR)
        return float(1.0 - hidden.mean()) if len(hidden) else 0.0

    def contact_seen(self, toward: Direction, own: Raycaster) -> tuple[float, Array]:
        """Share of the object's lower edge that is seen from a direction, and the point of contact [m], shape (3,).

        A column of rays sees the lower edge where the ray below the lowest one that meets the object goes on behind
        it, or meets what carries it. The contact is at the lowest of these rays, of those that meet a support near the
        object if any do: else it floats. `own` are the rays' meetings with the object alone.
        """
        middle, size = self.thing.bounds.mean(axis=0), self.diagonal
        camera = camera_of(viewpoint(middle, toward, 1.1 * size, CLOSEUP_FOV), COARSE)
        ways = camera.directions(camera.pixel_centers)
        rays = packed_rays(np.broadcast_to(camera.position, ways.shape), ways)
        depth_own, depth_around = (one.first_hits(rays).distance.reshape(COARSE, COARSE) for one in (own, self.around))
        seen = np.isfinite(depth_own) & (depth_own <= depth_around + 1e-4)
        columns = np.flatnonzero(np.isfinite(depth_own).any(axis=0))
        found = columns[seen[:, columns].any(axis=0)]
        if not len(found):
            return 0.0, middle
        row = COARSE - 1 - np.argmax(seen[::-1, found], axis=0)
        edge = depth_own[row, found]
        below = depth_around[np.minimum(row + 1, COARSE - 1), found]
        open_ = below > edge - HIDES * size - HIDES_M
        share = float(open_.sum()) / len(columns)
        if not open_.any():
            return 0.0, middle
        row, found, edge, below = (one[open_] for one in (row, found, edge, below))
        pixel = 1.1 * size / COARSE
        step = pixel / np.sin(np.radians(toward[1]))  # of a level support from one row to the next
        touches = below - edge < 3.0 * step
        low = (COARSE - row) * pixel + 0.5 * np.abs(found - 0.5 * COARSE) * pixel
        best = int(np.argmin(np.where(touches, low, np.inf) if touches.any() else low))
        return share, np.asarray(camera.position + edge[best] * ways.reshape(COARSE, COARSE, 3)[row[best], found[best]])


def sights_of(placed: PlacedThing, support: Array, scene_middle: Array) -> Sights:
    """Visibility of a placement; the support is given by the corners of its box (8, 3) [m]."""
    own = Raycaster(placed.thing)
    found = [placed.contact_seen(one, own) for one in CLOSEUPS]
    way = (scene_middle - support.mean(axis=0))[:2]
    off = np.linalg.norm(way) > OFF_MIDDLE
    return Sights(
        overview=np.array([placed.visible_share(one) for one in OVERVIEWS]),
        closeup=np.array([share for share, _ in found]),
        contact=np.array([point for _, point in found]),
        bounds=np.asarray(placed.thing.bounds, dtype=np.float64),
        support=support,
        ahead_deg=float(np.degrees(np.arctan2(way[1], way[0]))) if off else FRONT,
    )


@dataclass(frozen=True, slots=True)
class SampleCameras:
    """The cameras of one sample."""

    overview: Viewpoint
    direction: int
    """Direction of all close-ups, an index of CLOSEUPS."""
    width: float
    """Width that all close-ups show at the contact [m]."""

    def closeup(self, sights: Sights) -> Viewpoint:
        """The close-up of one of its placements."""
        return self.closeup_at(sights.contact[self.direction])

    def closeup_at(self, contact: Array) -> Viewpoint:
        """The close-up of a contact at a point (3,) [m]."""
        target = contact + np.array([0.0, 0.0, BELOW_MIDDLE * self.width])
        return viewpoint(target, CLOSEUPS[self.direction], self.width, CLOSEUP_FOV)


def sample_cameras(placements: Sequence[Sights]) -> SampleCameras:
    """The cameras of a sample, from the visibility of each compared placement."""
    ahead = placements[0].ahead_deg
    best = chosen([one.overview for one in placements], OVERVIEWS, ABOVE, ahead)
    diagonal = max(float(np.linalg.norm(np.ptp(one.bounds, axis=0))) for one in placements)
    return SampleCameras(
        overview=overview_of(placements, OVERVIEWS[best]),
        direction=chosen([one.closeup for one in placements], CLOSEUPS, GRAZING, ahead),
        width=round(float(np.clip(SHARE * diagonal, NARROWEST, WIDEST)), 6),
    )


def chosen(shares: Sequence[Array], ways: Sequence[Direction], elevations: Sequence[float], ahead_deg: float) -> int:
    """Index of the direction that maximises the visibility of the least visible placement, preferring low directions
    from the middle of the scene. Visibility is relative to the best of that placement from anywhere: a half buried
    object is visible by half at most."""
    seen = np.stack([np.minimum(one / max(float(one.max()), 1e-9) / ENOUGH, 1.0) for one in shares])
    azimuth, elevation = np.array(ways).T
    rank = np.array([elevations.index(one) for one in elevation])
    away = 0.5 * (1.0 - np.cos(np.radians(azimuth - ahead_deg - ASIDE_DEG)))
    score = seen.min(axis=0) + 0.1 * seen.mean(axis=0) - STEEPER * rank - TURNED * away
    return int(np.argmax(np.round(score, 6)))


def overview_of(placements: Sequence[Sights], toward: Direction) -> Viewpoint:
    """The camera in a direction that has all objects and their support in the picture."""
    low = np.min([one.bounds[0] for one in placements], axis=0)
    high = np.max([one.bounds[1] for one in placements], axis=0)
    reach = np.array([AROUND, AROUND, AROUND])
    support = [np.clip(one.support, low - reach, high + reach) for one in placements]
    points = np.concatenate([box_corners(low, high), *support])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    camera = camera_of(viewpoint(middle, toward, 1.0, OVERVIEW_FOV))
    local = (points - middle) @ camera.world_from_camera
    slope = np.tan(0.5 * np.radians(OVERVIEW_FOV)) / MARGIN
    distance = float((np.abs(local[:, :2]).max(axis=1) / slope - local[:, 2]).max())
    return viewpoint(middle, toward, 2.0 * distance * np.tan(0.5 * np.radians(OVERVIEW_FOV)), OVERVIEW_FOV)


def asset_view(item: Mesh) -> Viewpoint:
    """The camera of the object alone."""
    low, high = item.bounds
    width = 1.1 * float(np.linalg.norm(high - low))
    return viewpoint(0.5 * (low + high), (FRONT + 30.0, 25.0), width, CLOSEUP_FOV)


def viewpoint(target: Array, toward: Direction, width: float, fov_deg: float) -> Viewpoint:
    """The camera in a direction that shows `width` [m] at its target (3,)."""
    distance = 0.5 * width / np.tan(0.5 * np.radians(fov_deg))
    position = target + distance * along(toward)
    return Viewpoint(rounded(position), rounded(target), fov_deg)


def camera_of(view: Viewpoint, size: int = SIZE) -> Camera:
    """A square camera."""
    return looking_at(np.array(view.position), np.array(view.target), size, size, fov_deg=view.fov_deg)


def along(toward: Direction) -> Array:
    """A direction as a unit vector, shape (3,)."""
    a, e = np.radians(toward)
    return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def rounded(point: Array) -> tuple[float, float, float]:
    """A point to a micrometre [m]."""
    x, y, z = (round(float(one), 6) for one in point)
    return x, y, z


def box_corners(low: Array, high: Array) -> Array:
    """Corners of an upright box [m], shape (8, 3)."""
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def unit(vectors: Array) -> Array:
    """Vectors (n, 3) of length one; those without a length stay so."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30))
