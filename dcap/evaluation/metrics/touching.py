"""How an object and a scene touch: penetration, gap, contact area, and whether the contact carries the centre of mass.

Units are SI, the frame is the world's (z up). The scene's surfaces may be open, as scans are: only the object has to
have an inside.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.evaluation.metrics.columns import DOWN, UP, Columns, below, columns
from dcap.evaluation.metrics.depth import sunk_depth
from dcap.geometry.distance import MeshDistance
from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

TOUCHING = 1e-3
"""Surfaces closer than this touch [m]: what one sees of a gap in a picture of a room, and ten times what the solver
leaves."""
LANDED = 1e-4
"""An object this close above what carries it has come down on it [m]."""
FACING, AT = 0.5, 2e-5
"""Cosine from which on what is near is before a face [-]; and what is as near as this is at it [m]."""
FINE = 1.0 / 64.0
"""Largest edge of the faces that are sampled, over the object's size [-]."""
LEAST_EDGE = 1e-3
"""And at least this [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Touching:
    """An object against a scene."""

    penetration: float
    """How deep the object is in the scene [m]: the largest distance of a point of the scene inside the object from the
    object's surface, or, if that is more, the least way out of what is below a surface; of an object that is inside a
    solid as a whole how far its lowest point is below the surface."""
    gap: float
    """How far the object could come down before it touches; 0 where it touches [m]; inf over nothing."""
    contact_area: float
    """Area of the object's surface within TOUCHING of the scene, or inside it [m^2]."""
    margin: float
    """Distance of the centre of mass, seen in plan, to the rim of the convex hull of the patch: positive inside [m];
    -inf without one."""
    columns: Columns
    patch: Array
    """Middles of the pieces of the object's surface that carry it, or would once it has come down by the gap [m],
    shape (k, 3): a millimetre of air changes the gap, and not what is beneath."""
    patch_area: Array
    """Of each of these pieces [m^2], shape (k,)."""

    @property
    def middle(self) -> Array | None:
        """Centroid of the patch [m], shape (3,); None without one."""
        return np.average(self.patch, axis=0, weights=self.patch_area) if len(self.patch) else None


def touching(thing: Mesh, scene: Mesh) -> Touching:
    """Measure an object at its final pose against the scene without it, as it was left or as it was given."""
    size = float(np.ptp(thing.vertices, axis=0).max())
    edge = max(FINE * size, LEAST_EDGE)
    whole = Raycaster(scene)
    enclosed = enclosed_depth(thing, whole)
    solid = MeshDistance(thing)
    depth = max(inside_depth(solid, around(thing, scene, TOUCHING + edge), edge), enclosed)
    lines = columns(thing, whole, sunk=depth > TOUCHING)
    low = sunk_depth(solid, lines)
    if low > TOUCHING >= depth:  # it is nearly drowned: the surface is near its top, and deep is what is below
        lines = columns(thing, whole)
        low = sunk_depth(solid, lines)
    depth = max(depth, low)
    gap = np.inf
    if enclosed or lines.nearest >= 0:
        gap = 0.0 if enclosed else max(float(lines.gap[lines.nearest]), 0.0)
    down = gap if LANDED < gap < np.inf else 0.0
    near = around(thing, scene, TOUCHING + edge + down)
    fine = subdivide_near(thing, thing.bounds, edge)
    middle, normal = fine.triangles.mean(axis=1), fine.face_normals
    caster = Raycaster(near)

    def touches(points: Array) -> NDArray[np.bool_]:
        deep = below(points, whole, lines.end) if depth > TOUCHING else np.zeros(len(points), dtype=bool)
        return faced(points, normal, caster) | deep | (enclosed > 0.0)

    mine = touches(middle)
    landed = middle - [0.0, 0.0, down]
    carried = touches(landed) if down else mine
    margin = support_margin(landed[carried], center_of_mass(thing))
    area = fine.face_areas
    return Touching(depth, gap, float(area[mine].sum()), margin, lines, landed[carried], area[carried])


def faced(points: Array, normal: Array, scene: Raycaster) -> NDArray[np.bool_]:
    """Which points (n, 3) of a surface with area normals (n, 3) have the scene within TOUCHING before them, or are that
    deep behind a face that looks at them, shape (n,): the rim of a side is near what its bottom stands on, and does not
    touch it."""
    place, looks = scene.nearest_facing(points)
    way, length = place - points, np.linalg.norm(normal, axis=1)
    away = np.linalg.norm(way, axis=1)
    ahead = np.einsum("ij,ij->i", way, normal)
    before = ahead >= FACING * away * length
    opposed = np.einsum("ij,ij->i", looks, normal) <= -FACING * length
    behind = (ahead <= -FACING * away * length) & opposed
    return np.asarray((away <= TOUCHING) & (before | behind | (away <= AT)))


def around(thing: Mesh, scene: Mesh, reach: float) -> Mesh:
    """Faces of the scene whose box comes within a reach [m] of the object's box."""
    low, high = thing.bounds[0] - reach, thing.bounds[1] + reach
    corner = scene.triangles
    near = ((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)
    return scene.submesh(np.flatnonzero(near))


def inside_depth(solid: MeshDistance, near: Mesh, edge: float) -> float:
    """Largest distance from the object's surface of a point of the scene inside the object [m]."""
    if not len(near.faces):
        return 0.0
    low, high = solid.mesh.bounds
    points = surface_points(near, solid.mesh.bounds, edge)
    points = points[((points > low) & (points < high)).all(axis=1)]
    if not len(points):
        return 0.0
    return float(max(0.0, -solid(points).min()))


def surface_points(mesh: Mesh, box: Array, edge: float) -> Array:
    """Corners and middles of a surface whose faces in a box (2, 3) are cut to edges of at most `edge` [m], (n, 3)."""
    fine = subdivide_near(mesh, box, edge)
    return np.concatenate([fine.vertices, fine.triangles.mean(axis=1)])


def enclosed_depth(thing: Mesh, scene: Raycaster) -> float:
    """How far the object's lowest point is below the surface over it where it is inside a solid as a whole [m], else 0:
    none of the surface is inside the object then. Inside: along most vertical lines both the next face above and the
    next one below are met from behind."""
    low, high = thing.bounds
    inner = np.linspace(0.2, 0.8, 5)
    plan = np.stack(np.meshgrid(*(low[a] + inner * (high - low)[a] for a in range(2))), axis=-1).reshape(-1, 2)
    above = scene.left_at(np.column_stack([plan, np.full(len(plan), high[2])]), np.tile(UP, (len(plan), 1)))
    below = scene.left_at(np.column_stack([plan, np.full(len(plan), low[2])]), np.tile(DOWN, (len(plan), 1)))
    behind = np.isfinite(above) & np.isfinite(below)
    if behind.sum() <= 0.5 * len(plan):
        return 0.0
    return float(high[2] - low[2] + above[behind].min())


def support_margin(patch: Array, center: Array) -> float:
    """How far inside the convex hull of a contact (k, 3) a centre of mass (3,) is in plan [m], negative outside."""
    if not len(patch):
        return -np.inf
    hull = shapely.MultiPoint(patch[:, :2]).convex_hull
    point = shapely.Point(center[:2])
    rim = hull if hull.geom_type != "Polygon" else hull.exterior
    distance = float(point.distance(rim))
    return distance if hull.geom_type == "Polygon" and hull.contains(point) else -distance
