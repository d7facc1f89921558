"""Contact between an object and a scene: penetration, gap, area, and support of the centre of mass.

Units are SI, the frame is the world's (z up). The scene's surfaces may be open, as scans are: only the object has to
have an inside.

The object is measured over its support along vertical lines. A line starts at the object's highest point on it: the
desk over a chair's seat does not carry the chair. Only if that point is inside a solid does it start at the top of the
whole object, so that it finds the surface of the solid that the object intersects. A surface that a line meets from
behind in the upper half of the object is above the object, such as a board that its top touches. Nothing here knows a
method's intention: only the meshes.

The depth in the support is the least way out, up or sideways. Along each vertical line on which the object is sunk, the
part below the surface has to be lifted out. If the object continues next to the line, half as deep and in the open, it
may come out sideways instead: a cupboard's edge that is two centimetres inside a ball's side has a depth of two
centimetres, though the ball reaches far below the cupboard's top.
"""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, label

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh

LINES = 96
"""Vertical lines along each side of the object's box in plan [-]: features under a hundredth of its size are missed."""
ABOVE = 1e-3
"""Lines start this far above the object's highest point on them [m]."""
HAIR = 1e-5
"""Distance below a surface that it passes through at which a line continues [m]."""
MOST_BOARDS = 16
"""Most surfaces that a line passes through [-]."""
DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
NEIGHBOURS = np.ones((3, 3), dtype=int)
"""Lines that touch at a corner are neighbours."""
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
class Columns:
    """Vertical lines through the object that meet something beneath its top."""

    plan: Array
    """Positions in plan [m], shape (k, 2)."""
    index: NDArray[np.int64]
    """Indices among LINES along each side, shape (k, 2)."""
    step: Array
    """Spacing along each side [m], shape (2,)."""
    under: Array
    """Height of the object's lowest point on each [m], shape (k,)."""
    high: Array
    """Height of its highest point on each [m], shape (k,)."""
    drowned: NDArray[np.bool_]
    """Whether that point is inside a solid of the scene, shape (k,)."""
    top: Array
    """Height of the first surface of the scene below the line's start [m], -inf without one, (k,)."""
    face: NDArray[np.int64]
    """That face of the scene, -1 without one, shape (k,)."""
    upward: NDArray[np.bool_]
    """Whether that face looks up, shape (k,)."""
    end: float
    """Height of the object's top [m]: it cannot intersect a surface above it."""

    @property
    def gap(self) -> Array:
        """Distance of the object above the scene, negative below its surface [m], inf over nothing, (k,)."""
        return self.under - self.top

    @property
    def nearest(self) -> int:
        """The line on which it is least far above, or deepest below; -1 with nothing beneath."""
        return int(np.argmin(self.gap)) if len(self.gap) and np.isfinite(self.gap.min()) else -1


def columns(thing: Mesh, beneath: Raycaster, *, sunk: bool = True) -> Columns:
    """Lines through the object (world frame) over the scene without it. `sunk` says that a part of the scene is inside
    the object, so that it may intersect a surface over a low part of it."""
    own = Raycaster(thing)
    low, high = thing.bounds
    step = np.maximum((high - low)[:2], 1e-9) / LINES
    axes = [low[a] + step[a] * (np.arange(LINES) + 0.5) for a in range(2)]
    plan = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    end = float(high[2]) + ABOVE
    under = heights(plan, float(low[2]) - ABOVE, own, UP)
    met = np.flatnonzero(np.isfinite(under))
    plan, under = plan[met], under[met]
    own_top = np.maximum(heights(plan, end, own, DOWN), under)
    start = np.column_stack([plan, own_top + ABOVE])
    drowned = below(start, beneath, end) if sunk else np.zeros(len(plan), dtype=bool)
    start[drowned, 2] = end
    top, face, upward = first_below(start, 0.5 * (own_top + under), beneath)
    return Columns(plan, np.column_stack(np.divmod(met, LINES)), step, under, own_top, drowned, top, face, upward, end)


def first_below(start: Array, middle: Array, beneath: Raycaster) -> tuple[Array, NDArray[np.int64], NDArray[np.bool_]]:
    """Height [m] and face of the first hit of vertical lines from points (n, 3), and whether it faces up, shape (n,)
    each. Faces hit from behind above `middle` [m], shape (n,), are passed through if an upward face follows.
    """
    hits = beneath.cast(start, np.tile(DOWN, (len(start), 1)))
    met = np.isfinite(hits.distance)
    top = np.where(met, start[:, 2] - np.where(met, hits.distance, 0.0), -np.inf)
    face, upward = np.where(met, hits.face, -1).astype(np.int64), hits.normal[:, 2] > 0.0
    under = np.flatnonzero(met & ~upward & (top > middle))
    level = top[under] - HAIR
    for _ in range(MOST_BOARDS):
        hits = beneath.cast(np.column_stack([start[under, :2], level]), np.tile(DOWN, (len(under), 1)))
        met = np.isfinite(hits.distance)
        under, level, normal, number = under[met], level[met] - hits.distance[met], hits.normal[met], hits.face[met]
        carries = normal[:, 2] > 0.0
        here = under[carries]
        top[here], face[here], upward[here] = level[carries], number[carries], True
        under, level = under[~carries], level[~carries] - HAIR
        if not len(under):
            break
    return top, face, upward


def heights(plan: Array, start: float, mesh: Raycaster, way: Array) -> Array:
    """Heights at which vertical rays from points (n, 2) at a height [m] meet a mesh, infinite on a miss, shape (n,)."""
    origin = np.column_stack([plan, np.full(len(plan), start)])
    return np.asarray(start + way[2] * mesh.cast(origin, np.tile(way, (len(plan), 1))).distance)


def below(points: Array, scene: Raycaster, end: float) -> NDArray[np.bool_]:
    """Whether points (n, 3) are inside a solid of the scene, by a ray upward: the next surface, no higher than `end`
    [m], is hit from behind, shape (n,)."""
    above = scene.cast(points, np.tile(UP, (len(points), 1)))
    return np.asarray((points[:, 2] + above.distance <= end) & (above.normal[:, 2] > 0.0))


def sunk_depth(solid: MeshDistance, lines: Columns) -> float:
    """Largest of the least ways out over all sunk lines [m], 0 without any; `solid` is the object."""
    ways = lifts(solid, lines)
    sunk = np.flatnonzero(ways > 0.0)
    if not len(sunk):
        return 0.0
    place = np.zeros((LINES, LINES), dtype=bool)
    place[tuple(lines.index[sunk].T)] = True
    group = label(place, NEIGHBOURS)[0][tuple(lines.index[sunk].T)]
    deepest = np.zeros(group.max() + 1)
    np.maximum.at(deepest, group, ways[sunk])
    found = 0.0
    for one in np.argsort(-deepest):
        if deepest[one] <= found:  # the rest are less deep, whatever is next to them
            break
        own = sunk[group == one]
        first = own[ways[own].argmax()]
        aside = ways_aside(lines, own, float(lines.top[first] - 0.5 * ways[first]))
        found = max(found, float(np.minimum(ways[own], aside).max()))
    return found


def lifts(solid: MeshDistance, lines: Columns) -> Array:
    """Lift of each line that brings the object on it above the surface [m], 0 if it is above, shape (k,).

    The surface faces up and lies inside the object, or above an object that is entirely inside a solid.
    """
    ways = np.zeros(len(lines.plan))
    over = lines.upward & (lines.gap < 0.0)
    drowned = over & lines.drowned
    ways[drowned] = -lines.gap[drowned]
    cut = np.flatnonzero(over & ~drowned)
    points = np.column_stack([lines.plan[cut], lines.top[cut]])
    inside = solid.inside(points)
    cut, points = cut[inside], points[inside]
    down = Raycaster(solid.mesh).cast(points, np.tile(DOWN, (len(points), 1))).distance
    ways[cut] = np.where(np.isfinite(down), down, 0.0)
    return ways


def ways_aside(lines: Columns, own: NDArray[np.int64], level: float) -> Array:
    """Distance from lines (m,) to the nearest line on which the object is in the open at a height [m], inf without one,
    (m,)."""
    free = np.flatnonzero(~lines.drowned & (np.maximum(lines.under, lines.top) < level) & (level < lines.high))
    if not len(free):
        return np.full(len(own), np.inf)
    taken = np.ones((LINES, LINES), dtype=bool)
    taken[tuple(lines.index[free].T)] = False
    away = distance_transform_edt(taken, sampling=lines.step)
    return np.asarray(away[tuple(lines.index[own].T)])


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
