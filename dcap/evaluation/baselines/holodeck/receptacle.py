"""Holodeck's places for objects on another thing: random ones on the receptacle, the first free one.

As in the source (`small_objects.py`): only objects smaller than 90 % of the receptacle in length and width are placed;
one of at most 25 cm in every direction and 625 cm2 seen from above is small and gets a random turn of whole degrees;
one less than 5 cm thick along a horizontal axis is thin, and laid flat up to 3 cm; ten attempts are made; the box ends
1 mm above the surface; an object that is neither small nor thin is not settled by physics, and discarded if its box
meets another one there. Ours is a version with rays of the action `InitialRandomSpawn` of its simulator AI2-THOR: a
point is drawn from the receptacle's faces that look up (unit normal's vertical part above 0.9) with room for the object
above them; the corners and middles of its footprint must be over the receptacle (no deeper than `SAG` below the
highest), and nothing may be in the box above the surface. The source turns and lays flat after its simulator has found
a place; here both come before, so that the returned place is the checked one. Objects that are not small are tried at
quarter turns. The source lets AI2-THOR's physics settle small and thin objects afterwards; here the stage lowers them
onto the surface beneath, without turning them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.baselines.floor_plan import CanonicalAsset, with_rotation
from dcap.geometry.placement.polygons import inside
from dcap.geometry.placement.poses import about_z
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.floor_plan import FloorPlan
from dcap.scene.types.segmentation import Segmentation

SHARE = 0.9
"""Upper bound of the object's length and width over the receptacle's [-]."""
LEVEL = 0.9
"""Vertical part of a unit normal above which a face carries things [-]."""
ABOVE = 1e-3
"""Gap between surface and box [m]."""
FLAT = 0.03
"""Largest thickness along x or y of assets that are laid flat [m]."""
THIN = 0.05
"""Thickness along x or y below which assets are settled by physics [m]."""
SMALL, SMALL_AREA = 0.25, 0.0625
"""Extents [m] and area seen from above [m^2] up to which the turn is random."""
SAG = 0.05
"""Largest height of a corner over the surface [m]."""
GRID = 7
"""Rays along each side of the footprint [-]."""
RIM = 0.98
"""Position of the outermost rays over the half extents [-]: a corner may be at the very edge of a board."""
QUARTERS = tuple(0.5 * np.pi * k for k in range(4))


@dataclass(frozen=True, eq=False, slots=True)
class ReceptaclePlace:
    """A place on the receptacle."""

    center: Array
    """Middle of the box [m], shape (3,)."""
    yaw: float
    """[rad]."""
    tilt: Array
    """The rotation that lays it flat, shape (3, 3)."""
    attempt: int
    """Number of the attempt, from 1."""


def fits_on(asset: CanonicalAsset, receptacle: Array) -> bool:
    """Whether the object is smaller than 90 % of a receptacle of that length and width [m], shape (2,), the longer
    side compared with the longer one: the source sorts both, too, but does not use the result."""
    return bool((np.sort(asset.size[:2]) < SHARE * np.sort(receptacle)).all())


def laid_flat(size: Array) -> Array:
    """The rotation that lays a thin thing of these extents [m] flat, else the identity, shape (3, 3)."""
    if size[0] <= FLAT:
        return np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # about y: x becomes vertical
    if size[1] <= FLAT:
        return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # about x: y becomes vertical
    return np.eye(3)


def is_thin(size: Array) -> bool:
    """Whether a thing of these extents [m] is thin along x or y."""
    return bool((size[:2] < THIN).any())


def is_small(size: Array) -> bool:
    """Whether a thing of these extents [m] gets a random turn."""
    return bool((size <= SMALL).all() and size[0] * size[1] <= SMALL_AREA)


def receptacle_place(
    scene: Segmentation, receptacle: int, asset: CanonicalAsset, rng: np.random.Generator, attempts: int
) -> ReceptaclePlace | None:
    """The first free place of up to `attempts` on the instance with that index; None if there is none."""
    small, tilt = is_small(asset.size), laid_flat(asset.size)
    half = 0.5 * np.ptp(asset.mesh.transformed(with_rotation(tilt)).bounds, axis=0)
    caster = Raycaster(scene.mesh)
    faces = upward_faces(scene, receptacle)
    if not len(faces):
        return None
    for attempt in range(1, attempts + 1):
        point = point_on(scene, faces, rng)
        turns = (float(np.radians(rng.integers(0, 360))),) if small else QUARTERS
        for yaw in turns:
            bottom = surface_under(scene, receptacle, caster, point, half, yaw)
            if bottom is not None and is_clear(caster, point, bottom + ABOVE, half, yaw):
                center = np.array([*point[:2], bottom + ABOVE + half[2]])
                return ReceptaclePlace(center, yaw, tilt, attempt)
    return None


def upward_faces(scene: Segmentation, receptacle: int) -> NDArray[np.int64]:
    """Indices of the receptacle's upward faces."""
    mine = np.flatnonzero(scene.face_instance == receptacle)
    normals = scene.mesh.face_normals[mine]
    carries = normals[:, 2] > LEVEL * np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    return np.asarray(mine[carries], dtype=np.int64)


def point_on(scene: Segmentation, faces: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """A point drawn evenly over the area of faces [m], shape (3,)."""
    total = np.cumsum(scene.mesh.face_areas[faces])
    face = faces[min(int(np.searchsorted(total, rng.random() * total[-1])), len(faces) - 1)]
    u, v = rng.random(2)
    u, v = (1.0 - u, 1.0 - v) if u + v > 1.0 else (u, v)
    a, b, c = scene.mesh.corners(np.array([face]))[0].astype(np.float64)
    return np.asarray(a + u * (b - a) + v * (c - a))


def footprint(point: Array, half: Array, yaw: float) -> Array:
    """A grid over a turned rectangle about a point [m], xy, shape (GRID^2, 2)."""
    steps = RIM * np.linspace(-1.0, 1.0, GRID)
    x, y = np.meshgrid(steps * half[0], steps * half[1])
    return np.asarray(point[:2] + np.c_[x.ravel(), y.ravel()] @ about_z(yaw)[:2, :2].T)


def surface_under(
    scene: Segmentation, receptacle: int, caster: Raycaster, point: Array, half: Array, yaw: float
) -> float | None:
    """The highest surface under the footprint near a point of it [m]; None if the footprint extends beyond the
    receptacle."""
    spots = footprint(point, half, yaw)
    start = np.c_[spots, np.full(len(spots), point[2] + SAG)]
    hits = caster.cast(start, np.tile([0.0, 0.0, -1.0], (len(start), 1)))
    if not (np.isfinite(hits.distance).all() and (scene.face_instance[hits.face] == receptacle).all()):
        return None
    heights = hits.position[:, 2]
    return float(heights.max()) if np.ptp(heights) <= SAG else None


def is_clear(caster: Raycaster, point: Array, bottom: float, half: Array, yaw: float) -> bool:
    """Whether nothing is in the box above `bottom` [m]: no ray through it upward, along it or across it hits."""
    spots = footprint(point, half, yaw)
    start, up = np.c_[spots, np.full(len(spots), bottom)], np.tile([0.0, 0.0, 1.0], (len(spots), 1))
    # where a ray leaves a solid, the spot is inside it: under a pillow's surface
    if (caster.cast(start, up).distance < 2.0 * half[2]).any() or np.isfinite(caster.left_at(start, up)).any():
        return False
    turn, levels = about_z(yaw), bottom + 2.0 * half[2] * (np.arange(GRID) + 0.5) / GRID
    for axis in (0, 1):
        other = 1 - axis
        across, height = np.meshgrid(RIM * half[other] * np.linspace(-1.0, 1.0, GRID), levels)
        local = np.zeros((across.size, 3))
        local[:, axis], local[:, other] = -half[axis], across.ravel()
        start = local @ turn.T + (point[0], point[1], 0.0)
        start[:, 2] = height.ravel()
        if caster.occluded(start, np.tile(turn[:, axis], (len(start), 1)), 2.0 * float(half[axis])).any():
            return False
    return True


def collides(plan: FloorPlan, receptacle: str, low: Array, high: Array) -> str:
    """Label of a thing on the receptacle whose axis-aligned box meets the one from `low` to `high` [m]; empty if there
    is none. Things that are larger than the receptacle, or not over it, do not stand on it."""
    base = next((box for box in plan.things if box.thing == receptacle), None)
    if base is None:
        return ""
    for box in plan.things:
        if box is base or np.prod(box.size[:2]) > np.prod(base.size[:2]) or box.bottom <= base.bottom + ABOVE:
            continue
        own_low, own_high = np.array([*box.ring.min(axis=0), box.bottom]), np.array([*box.ring.max(axis=0), box.top])
        over = inside(base.ring, box.center[None, :2])[0]
        if over and (own_low < high).all() and (own_high > low).all():
            return box.label
    return ""
