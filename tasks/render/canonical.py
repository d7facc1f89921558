"""Visibility of the object at rest from a fixed set of views around it, and from standing height in the room.

In: the scene and the object at rest. Out: per view the visible share of the object's silhouette and of its outline. A
thing is recognised by its outline [B87], so recognisability is the uncovered share of the outline.

[B87] Biederman: Recognition-by-components: a theory of human image understanding. Psychological Review 94, 1987.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion

from dcap.geometry.camera import looking_at
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.visibility import spread_points
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.renders import Visibility
from tasks.render.config import RenderConfig
from tasks.render.views import SEEN_POINTS, direction, visible_share

Array = NDArray[np.float64]

AZIMUTHS = np.arange(0.0, 360.0, 45.0)
ELEVATIONS = (15.0, 45.0)
TOP = 89.0
"""Views around the object: angles off the base's front and over the horizon [degrees], and one from above."""
EYE_HEIGHT, RINGS, ON_A_RING = 1.6, (1.5, 2.5), 12
"""Standing people: height of their eyes over the lowest point of the scene, distances from the object [m]."""


def canonical_views(scene: Mesh, thing: Mesh, target: Array, toward: Array, config: RenderConfig) -> Visibility:
    """The visible shares of the object (a mesh at rest) among the scene without it.

    Args:
        scene: everything else at rest.
        thing: the object at rest.
        target: middle of the contact [m], shape (3,).
        toward: horizontal unit vector of the base's front, shape (3,).
        config: size, field of view and distance of the views.
    """
    around, alone = Raycaster(scene), Raycaster(thing)
    middle = thing.bounds.mean(axis=0)
    distance = config.nearest * float(np.linalg.norm(np.ptp(thing.vertices, axis=0)))
    ways = [(azimuth, elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS] + [(0.0, TOP)]
    rows = []
    for azimuth, elevation in ways:
        position = middle + distance * direction(toward, azimuth, elevation)
        camera = looking_at(position, middle, config.canonical_size, config.canonical_size, fov_deg=config.fov_deg)
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
    """Mean visible share of the object from standing height around it, inside the scene's bounds; 0 without a place to
    stand."""
    points, normals = spread_points(thing, SEEN_POINTS)
    low, high = scene.bounds
    shares = []
    for radius in RINGS:
        angle = 2.0 * np.pi * np.arange(ON_A_RING) / ON_A_RING
        eyes = target[:2] + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for eye in eyes[((eyes > low[:2]) & (eyes < high[:2])).all(axis=1)]:
            shares.append(visible_share(around, points, normals, np.array([*eye, low[2] + EYE_HEIGHT])))
    return float(np.mean(shares)) if shares else 0.0
