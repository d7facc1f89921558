"""Stable poses of a thing on a plane, its symmetry, and the direction of its front.

In: a mesh. Out: stable poses of its convex hull with the share of directions that lead to each, the order of its
rotational symmetry about z, and the horizontal direction of its front. Everything is deterministic.

A face of the hull is stable if the centre of mass lies above it. From an unstable face the body tips over the edge
beyond which the centre's projection lies farthest, onto the neighbour behind it; the solid angles of such faces count
for the face where the tipping ends [G94].

[G94] Goldberg, Mirtich, Zhuang, Craig, Carlisle, Canny: Part pose statistics, 1999 (quasi-static estimate).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, cKDTree

from dcap.arrays import Array
from dcap.geometry.pieces import is_closed, signed_volume
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh

MERGE_ANGLE = np.radians(8.0)
"""Stable faces closer than this are the same pose [rad]: the foot of a scanned mug has many faces."""
MOST_POSES = 24
"""Maximum number of poses; a mesh with more is a ball or a pebble, for which any pose is as good as another [-]."""
LEAST_SHARE = 0.004
"""Poses with less than this share of all directions are left out [-]."""
LEAST_FILLED = 1e-3
"""Share of its box below which the volume of a closed mesh makes it a sheet with two sides [-]."""
SHEET = 1e-4
"""Half thickness given to a flat mesh over its largest extent [-]."""
SYMMETRY_SAMPLES = 4000
SYMMETRY_TOLERANCE = 0.025
"""Largest mean distance between surface and turned surface, over the radius, that counts as equal [-]; scans have
0.01."""
DEFAULT_FRONT = np.array([0.0, -1.0, 0.0])
USUAL_FRONTS = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Usual directions of the front in files that are long in x or y."""
OBLONG = 1.15
"""Least ratio of length to width of a thing with a long side [-]."""
FRONTS = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
BEYOND = 0.1
"""Least share of the larger horizontal extent by which one half must reach beyond the other to indicate a front [-]."""
FRONT_REACH = 0.06
"""Least distance between the halves' middles that indicates a front, over the larger horizontal extent [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class StablePose:
    """A pose of rest on a horizontal plane."""

    rotation: Array
    """From the mesh frame to the world: turns the resting face down by the smallest angle, shape (3, 3)."""
    probability: float
    """Share of all directions from which it comes to rest in this pose [-]."""
    down: Array
    """Outward normal of the resting face in the mesh frame, shape (3,)."""
    height: float
    """Height of the centre of mass over the plane [m]."""
    area: float
    """Area of the resting face [m^2]."""


def center_of_mass(mesh: Mesh) -> Array:
    """Centre of the volume if the mesh is closed, else of the surface [m], shape (3,)."""
    origin = mesh.bounds.mean(axis=0)
    corner = mesh.triangles - origin
    box = float(np.prod(np.ptp(mesh.bounds, axis=0)))
    if is_closed(mesh) and signed_volume(mesh.vertices, mesh.faces) > LEAST_FILLED * box:
        import trimesh  # takes a quarter of a second, which cached results need not wait for

        return np.asarray(origin + trimesh.triangles.mass_properties(corner, skip_inertia=True).center_mass)
    area = mesh.face_areas
    if area.sum() == 0.0:
        raise GeometryError("the mesh has no area")
    return np.asarray(origin + np.average(corner.mean(axis=1), axis=0, weights=area))


def stable_poses(mesh: Mesh, *, most: int = MOST_POSES, least: float = LEAST_SHARE) -> list[StablePose]:
    """Stable poses, most probable first: at least one, otherwise up to `most` with a share of at least `least`."""
    center = center_of_mass(mesh)
    points = mesh.vertices[np.unique(mesh.faces)] - center
    hull = ConvexHull(with_thickness(points))
    points = hull.points
    normal, offset = hull.equations[:, :3], -hull.equations[:, 3]
    corners = points[hull.simplices]
    rest = ends_of_tipping(normal, offset, corners, hull.neighbors)
    share = np.bincount(rest, solid_angles(corners), len(normal)) / (4.0 * np.pi)
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    poses = merged(normal, np.maximum(offset, 0.0), share, area)
    return [pose for pose in poses if pose.probability >= least][:most] or poses[:1]


def with_thickness(points: Array) -> Array:
    """The points, or, if they lie in a plane, the points shifted slightly to both sides of it [m], shape (n, 3)."""
    _, extents, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    if extents[2] > 1e-6 * extents[0]:
        return points
    shift = SHEET * float(np.ptp(points, axis=0).max()) * axes[2]
    return np.concatenate([points + shift, points - shift])


def ends_of_tipping(normal: Array, offset: Array, corners: Array, neighbors: NDArray[np.int32]) -> NDArray[np.int64]:
    """The face on which the body comes to rest, for each face, shape (m,)."""
    count = len(normal)
    following = np.arange(count)
    foot = offset[:, None] * normal  # projection of the centre of mass (the origin) onto each face's plane
    beyond = np.full((count, 3), -np.inf)
    for k in range(3):  # neighbour k lies across the edge opposite to corner k
        a, b, c = corners[:, (k + 1) % 3], corners[:, (k + 2) % 3], corners[:, k]
        edge = b - a
        outward = np.cross(edge, normal)
        outward *= np.sign(np.einsum("ij,ij->i", outward, a - c))[:, None]
        length = np.linalg.norm(outward, axis=1)
        beyond[:, k] = np.einsum("ij,ij->i", foot - a, outward) / np.maximum(length, 1e-30)
    worst = np.argmax(beyond, axis=1)
    unstable = beyond[np.arange(count), worst] > 1e-9 * max(float(offset.max()), 1e-30)
    across = neighbors[np.arange(count), worst].astype(np.int64)
    # tipping lowers the centre, or keeps its height between triangles of the same side
    lower = offset[across] < offset + 1e-9 * max(float(offset.max()), 1e-30)
    following[unstable & lower] = across[unstable & lower]
    for _ in range(count.bit_length() + 1):
        following = following[following]
    return following


def solid_angles(corners: Array) -> Array:
    """Solid angle of each triangle seen from the origin [sr], shape (m,) (van Oosterom and Strackee 1983)."""
    a, b, c = (corners[:, k] for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    top = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c)))
    bottom = la * lb * lc + sum(np.einsum("ij,ij->i", x, y) * z for x, y, z in ((a, b, lc), (b, c, la), (c, a, lb)))
    return np.asarray(2.0 * np.arctan2(top, bottom))


def merged(normal: Array, offset: Array, share: Array, area: Array) -> list[StablePose]:
    """Neighbouring stable faces merged into poses, the most probable first."""
    left = np.flatnonzero(share > 0)
    # equal shares (a box's two triangles per side) are ordered by direction, so that rounding does not decide
    order = left[np.lexsort((*np.round(normal[left], 6).T, -np.round(share[left], 9)))]
    poses: list[StablePose] = []
    taken = np.zeros(len(normal), dtype=bool)
    for first in order:
        if taken[first]:
            continue
        group = order[(normal[order] @ normal[first] > np.cos(MERGE_ANGLE)) & ~taken[order]]
        taken[group] = True
        weight = share[group] * np.maximum(area[group], 1e-30)
        down = (weight[:, None] * normal[group]).sum(axis=0)
        down /= np.linalg.norm(down)
        poses.append(
            StablePose(
                turn_between(down, np.array([0.0, 0.0, -1.0])),
                float(share[group].sum()),
                down,
                float(np.average(offset[group], weights=weight)),
                float(area[group].sum()),
            )
        )
    poses.sort(key=lambda pose: (-round(pose.probability, 6), *np.round(-pose.down, 4)))
    return poses


def turn_between(a: Array, b: Array) -> Array:
    """The rotation by the smallest angle that takes unit vector a to b; about y for opposite ones, shape (3, 3)."""
    cosine = float(a @ b)
    if cosine < -1.0 + 1e-9:
        return np.diag([-1.0, 1.0, -1.0]) if abs(a[2]) > 0.5 else np.diag([-1.0, -1.0, 1.0])
    axis = np.cross(a, b)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.asarray(np.eye(3) + cross + cross @ cross / (1.0 + cosine))


def about_z(angle: float) -> Array:
    """Rotation about the vertical [rad], shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotated(mesh: Mesh, rotation: Array) -> Mesh:
    """The mesh under a rotation about its origin, shape (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3] = rotation
    return mesh.transformed(pose)


def symmetry_about_z(mesh: Mesh) -> int:
    """Order of the rotational symmetry about the vertical through its centroid: 0 any angle, n n-fold, 1 none."""
    points = surface_points(mesh, SYMMETRY_SAMPLES)
    points = points - np.array([*points.mean(axis=0)[:2], 0.0])
    radius = float(np.linalg.norm(points[:, :2], axis=1).max())
    if radius == 0.0:
        return 0
    tree = cKDTree(points)
    spacing = float(np.median(tree.query(points, k=2)[0][:, 1]))
    limit = SYMMETRY_TOLERANCE * radius + spacing

    def same(angle_deg: float) -> bool:
        turned = points @ about_z(np.radians(angle_deg)).T
        distance = tree.query(turned)[0]
        return bool(distance.mean() < limit and np.quantile(distance, 0.99) < 4.0 * limit)

    # 37 and 53 degrees are not multiples of a fraction of a full turn, so a match is not a coincidence
    if same(37.0) and same(53.0):
        return 0
    return next((n for n in (8, 6, 5, 4, 3, 2) if same(360.0 / n)), 1)


def surface_points(mesh: Mesh, count: int) -> Array:
    """Points spread over the surface by area with a fixed low-discrepancy sequence [m], shape (count, 3)."""
    total = np.cumsum(mesh.face_areas)
    steps = (np.arange(count) + 0.5) / count
    face = np.minimum(np.searchsorted(total, steps * total[-1]), len(total) - 1)
    u, v = np.mod(0.5 + np.arange(count)[:, None] * (0.7548776662466927, 0.5698402909980532), 1.0).T  # R2 sequence
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a, b, c = mesh.corners(face).transpose(1, 0, 2)
    return np.asarray(a + u[:, None] * (b - a) + v[:, None] * (c - a))


def front_of(mesh: Mesh, side: str = "") -> tuple[Array, bool]:
    """Horizontal unit vector out of the front in the mesh frame, and whether shape or category determine it.

    The front is where the lower half reaches out beyond the upper (a keyboard in front of its screen, the legs of a
    sitting bear, the seat in front of a backrest); else where the upper half overhangs (the head of an animal on four
    legs); else where the middle of the lower half is in front of that of the upper half (the toe of a shoe). Without
    any difference it is -y, which is the front of a glTF file (its +z) after the change to z up. `side` is given by the
    category: `long`, the front is at an end of the longer side (a car), `short`, in the middle of it (a screen); it
    decides the axis, not the end.
    """
    front, told = shaped_front(mesh)
    size = np.ptp(mesh.bounds, axis=0)[:2]
    if not side or size.max() < OBLONG * size.min():
        return front, told
    axis = int(np.argmax(size)) if side == "long" else int(np.argmin(size))
    return (front if abs(front[axis]) > 0.5 else USUAL_FRONTS[axis]), True


def shaped_front(mesh: Mesh) -> tuple[Array, bool]:
    """The front, and whether the shape determines it."""
    points = surface_points(mesh, SYMMETRY_SAMPLES)
    low, high = points.min(axis=0), points.max(axis=0)
    upper = points[:, 2] > 0.5 * (low[2] + high[2])
    if upper.sum() < 20 or (~upper).sum() < 20:
        return DEFAULT_FRONT, False
    size = float(np.max(high[:2] - low[:2]))
    reach = reaches(points[~upper, :2], points[upper, :2]) / size
    ahead = int(np.argmax(reach - np.roll(reach, 2)))
    if reach[ahead] > BEYOND and reach[ahead] - reach[(ahead + 2) % 4] > BEYOND:
        return FRONTS[ahead], True
    over = int(np.argmin(reach))
    if reach[over] < -BEYOND and reach[(over + 2) % 4] > -0.5 * BEYOND:
        return FRONTS[over], True
    middle = FRONTS[:, :2] @ (points[~upper, :2].mean(axis=0) - points[upper, :2].mean(axis=0)) / size
    if middle.max() < FRONT_REACH:
        return DEFAULT_FRONT, False
    return FRONTS[int(np.argmax(middle))], True


def reaches(lower: Array, upper: Array) -> Array:
    """Distance by which lower points reach beyond upper ones towards +x, +y, -x, -y [m]; negative: an overhang, shape
    (4,)."""
    ways = FRONTS[:, :2]
    # the outermost two per cent may be an ear, a lace or scan noise
    return np.asarray(np.quantile(lower @ ways.T, 0.98, axis=0) - np.quantile(upper @ ways.T, 0.98, axis=0))
