"""Contact between an object and a scene: penetration, gap, contact area, and support of the centre of mass.

Units are SI, the frame is the world's (z up). The scene's surfaces may be open, as scans are: only the object has to
have an inside.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.metrics.columns import DOWN, UP, Columns, below, columns
from dcap.evaluation.metrics.depth import sunk_depth
from dcap.geometry.distance import MeshDistance
from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh

TOUCHING = 1e-3
"""Surfaces closer than this touch [m]: the least gap visible in a picture of a room, and ten times the solver's gap."""
LANDED = 1e-4
"""Largest gap above its support at which an object counts as resting on it [m]."""
FACING, AT = 0.5, 2e-5
"""Least cosine for a near point to be in front of a face [-]; and the distance within which a point is at the face
[m]."""
FINE = 1.0 / 64.0
"""Largest edge of the faces that are sampled, over the object's size [-]."""
LEAST_EDGE = 1e-3
"""Least edge of these faces [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Touching:
    """An object against a scene."""

    penetration: float
    """Depth of the object in the scene [m]: the largest distance of a point of the scene inside the object from the
    object's surface, or, if that is larger, the least way out of the part below a surface; for an object that is
    entirely inside a solid, the depth of its lowest point below the surface."""
    gap: float
    """Distance that the object could come down before it touches; 0 if it touches [m]; inf over nothing."""
    contact_area: float
    """Area of the object's surface within TOUCHING of the scene, or inside it [m^2]."""
    margin: float
    """Distance of the centre of mass, seen in plan, to the rim of the convex hull of the patch: positive inside [m];
    -inf without one."""
    columns: Columns
    patch: Array
    """Middles of the pieces of the object's surface that carry it, or would after it has come down by the gap [m],
    shape (k, 3): a millimetre of air changes the gap, not the support."""
    patch_area: Array
    """Of each of these pieces [m^2], shape (k,)."""

    @property
    def middle(self) -> Array | None:
        """Centroid of the patch [m], shape (3,); None without one."""
        return np.average(self.patch, axis=0, weights=self.patch_area) if len(self.patch) else None


def touching(thing: Mesh, scene: Mesh) -> Touching:
    """Measure an object at its final pose against the scene without it, either deformed or undeformed."""
    size = float(np.ptp(thing.vertices, axis=0).max())
    edge = max(FINE * size, LEAST_EDGE)
    whole = Raycaster(scene)
    enclosed = enclosed_depth(thing, whole)
    solid = MeshDistance(thing)
    depth = max(inside_depth(solid, around(thing, scene, TOUCHING + edge), edge), enclosed)
    lines = columns(thing, whole, sunk=depth > TOUCHING)
    low = sunk_depth(solid, lines)
    if low > TOUCHING >= depth:  # it is nearly submerged: the surface is near its top, and the part below is deep
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
    """Whether points (n, 3) of a surface with area normals (n, 3) have the scene within TOUCHING in front of them, or
    are that deep behind a face that faces them, shape (n,): the rim of a side is near the ground below its bottom, but
    does not touch it."""
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
    """Depth of the object's lowest point below the surface above it if it is entirely inside a solid [m], else 0: then
    no part of the surface is inside the object. Inside means: along most vertical lines both the next face above and
    the next one below are hit from behind."""
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
    """Distance in plan of a centre of mass (3,) inside the convex hull of a contact (k, 3) [m], negative outside."""
    if not len(patch):
        return -np.inf
    hull = shapely.MultiPoint(patch[:, :2]).convex_hull
    point = shapely.Point(center[:2])
    rim = hull if hull.geom_type != "Polygon" else hull.exterior
    distance = float(point.distance(rim))
    return distance if hull.geom_type == "Polygon" and hull.contains(point) else -distance
