"""The shell of a room without annotations: floor, ceiling and walls, without the things that lie flat on them.

A rug, a picture or a door leaf is within centimetres of the surface that carries it. Patches of the shell's level that
are raised, or differ in colour from most of it, are separate things.

Floor, ceiling and walls of a scene: levels of horizontal area, annotated wall boxes, large vertical planes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, Mask
from dcap.geometry.segmentation.faces import FaceTable, level_of, pairs_among, plan_cells, surface_heights
from dcap.geometry.segmentation.oversegmentation import COLOR_STEP, color_regions
from dcap.geometry.segmentation.rooms.contacts import plan_hull
from dcap.scene.types.boxes import OrientedBox

LEVEL_BAND = 0.03
"""Largest unevenness of a floor [m]: scan noise and a skirting's edge."""

PLANE_BAND = 0.05
"""Largest distance of a wall's faces from its plane or annotated box [m]."""

WALL_AREA = 1.2
"""Least area of a vertical plane that is a wall [m^2]."""

WALL_SHARE = 0.25
"""... and least share of the largest wall's area [-]: the front of a wardrobe is smaller."""

PLAN_STEP = 0.1
"""Size of the cells for measuring the plan of a scene [m]."""

MAX_WALLS = 40
"""Maximum number of planes that are tried [-]."""

RAISED = 0.005
"""Least distance of a patch from the level of the shell for it to be a thing [m]: a thin rug, above the noise of
scans."""
FACING = 0.7
"""Cosine of the angle between a patch and its level [-]."""
LEAST_PATCH = 0.02
"""Area below which a patch is noise or dirt [m^2]."""
COMPACT = 0.6
"""Least share of its convex hull filled by a thing [-]; a patch that runs around the room fills less."""
DEEPEST_FRONT = 0.9
"""Largest depth of furniture [m]."""
LARGEST_FLUSH = 12.0
"""Surface of the largest thing on a wall, both sides of a wide window [m^2]; a larger one is a room fused by the
scan."""
SKIRTING = 0.16
"""Largest height of the top of a patch of wall that is its skirting [m]."""
CRUMBS = 1e-4
"""Share of the level's area below which patches join their neighbours [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Levels:
    """Heights of floor and ceiling; nan if there is none."""

    floor: float
    ceiling: float


def find_levels(table: FaceTable) -> Levels:
    """Floor: the heaviest level of upward faces in the lowest third; ceiling: of downward faces in the highest."""
    z = table.center[:, 2]
    low, high = surface_heights(z, table.area)
    height = high - low
    up = (table.normal[:, 2] > 0.8) & (z < low + 0.35 * height)
    down = (table.normal[:, 2] < -0.8) & (z > high - 0.3 * height)
    footprint = plan_cells(table.corners, table.area, PLAN_STEP) * PLAN_STEP**2
    return Levels(_level(z, table.area, up, footprint), _level(z, table.area, down, footprint))


def _level(z: NDArray[np.float64], area: NDArray[np.float64], chosen: NDArray[np.bool_], footprint: float) -> float:
    """The level of the chosen faces if it covers a fifth of the footprint; else nan."""
    found = level_of(z[chosen], area[chosen], LEVEL_BAND)
    near = chosen & (np.abs(z - found) < LEVEL_BAND)
    return found if area[near].sum() > 0.2 * footprint else float("nan")


def floor_faces(table: FaceTable, levels: Levels) -> NDArray[np.bool_]:
    """Mask of the floor's faces: level and at its height, or below it, shape (m,)."""
    if np.isnan(levels.floor):
        return np.zeros(len(table.area), dtype=bool)
    z = table.center[:, 2]
    at_level = (np.abs(z - levels.floor) < LEVEL_BAND) & (table.normal[:, 2] > 0.6)
    return np.asarray(at_level | (z < levels.floor - 0.01))


def ceiling_faces(table: FaceTable, levels: Levels) -> NDArray[np.bool_]:
    """Mask of the ceiling's faces: level and at its height, or above it, shape (m,)."""
    if np.isnan(levels.ceiling):
        return np.zeros(len(table.area), dtype=bool)
    z = table.center[:, 2]
    at_level = (np.abs(z - levels.ceiling) < LEVEL_BAND) & (table.normal[:, 2] < -0.6)
    return np.asarray(at_level | (z > levels.ceiling + 0.01))


def wall_number(
    table: FaceTable, walls: list[OrientedBox], chosen: NDArray[np.bool_], inside_things: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Index of the wall of each chosen face, -1 for none: by annotated boxes if there are any, else by planes, (m,).

    Planes are found on faces outside `inside_things`, so that the front of a wardrobe is not a wall.
    """
    if walls:
        return _walls_by_box(table, walls, chosen)
    return _walls_by_plane(table, chosen & (np.abs(table.normal[:, 2]) < 0.6), inside_things)


def _walls_by_box(table: FaceTable, walls: list[OrientedBox], chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Index of the nearest wall box, within `PLANE_BAND`."""
    number = np.full(len(table.area), -1, dtype=np.int64)
    nearest = np.full(len(table.area), PLANE_BAND)
    index = np.flatnonzero(chosen)
    for i, wall in enumerate(walls):
        outside = np.abs(wall.to_local(table.center[index])) - wall.half_extents
        distance = np.linalg.norm(np.maximum(outside, 0.0), axis=1)
        closer = distance < nearest[index]
        number[index[closer]] = i
        nearest[index[closer]] = distance[closer]
    return number


def _walls_by_plane(
    table: FaceTable, upright: NDArray[np.bool_], inside_things: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Vertical planes found greedily, largest first, as long as they are large and nearly room-high."""
    number = np.full(len(table.area), -1, dtype=np.int64)
    height = float(np.ptp(table.center[:, 2]))
    angle = np.degrees(np.arctan2(table.normal[:, 1], table.normal[:, 0]))
    left = upright & ~inside_things
    largest = 0.0
    for wall in range(MAX_WALLS):
        index = np.flatnonzero(left)
        if not len(index) or table.area[index].sum() < WALL_AREA:
            break
        heading = np.round(angle[index] / 10.0).astype(int) % 36
        main = int(np.argmax(np.bincount(heading, table.area[index], 36)))
        index = index[heading == main]
        direction = np.average(table.normal[index, :2], axis=0, weights=table.area[index])
        direction /= np.linalg.norm(direction)
        offset = table.center[:, :2] @ direction
        level = level_of(offset[index], table.area[index], PLANE_BAND)
        plane = (np.abs(offset - level) < PLANE_BAND) & (table.normal[:, :2] @ direction > 0.8)
        near = left & plane
        left[near if near.any() else index] = False
        area = float(table.area[near].sum())
        largest = max(largest, area)
        tall = near.any() and np.ptp(table.corners[near][..., 2]) > 0.5 * height
        if tall and area > max(WALL_AREA, WALL_SHARE * largest):
            number[upright & plane & (number < 0)] = wall
    return number


@dataclass(frozen=True, eq=False, slots=True)
class ScannedShell:
    """Masks of the faces that belong to the shell of a room."""

    floor: Mask
    """Mask of the floor, shape (m,)."""
    ceiling: Mask
    wall: NDArray[np.int64]
    """Index of the wall of each face, -1 for none, shape (m,)."""
    planes: Array
    """Unit normal into the room and offset of each wall, normal . x = offset, shape (walls, 4)."""
    levels: Levels

    @property
    def any(self) -> Mask:
        """Mask of floor, ceiling and walls, shape (m,)."""
        return np.asarray(self.floor | self.ceiling | (self.wall >= 0))

    def distance(self, points: Array) -> Array:
        """Distance of points (n, 3) to the nearest wall plane or the ceiling [m], shape (n,)."""
        away = np.abs(points @ self.planes[:, :3].T - self.planes[:, 3])
        if not np.isnan(self.levels.ceiling):
            away = np.concatenate([away, np.abs(points[:, 2:] - self.levels.ceiling)], axis=1)
        return np.asarray(away.min(axis=1, initial=np.inf))


def find_shell(table: FaceTable, inside: Mask) -> ScannedShell:
    """Floor, ceiling and walls among the faces in `inside`, shape (m,)."""
    levels = find_levels(table)
    floor = inside & floor_faces(table, levels)
    ceiling = inside & ceiling_faces(table, levels) & ~floor
    wall = wall_number(table, [], inside & ~floor & ~ceiling, np.zeros_like(inside))
    wall = _without_fronts(table, wall)
    planes = np.array([_plane(table, wall == i) for i in range(int(wall.max(initial=-1)) + 1)]).reshape(-1, 4)
    if floor.any():
        floor &= ~_patches(table, floor, np.array([0.0, 0.0, 1.0, levels.floor]))
    for i, plane in enumerate(planes):
        flat = _patches(table, wall == i, plane)
        wall[flat] = -1
    wall[_skirting(table, inside & ~floor & ~ceiling & (wall < 0), planes, levels)] = 0
    wall = _nearest_wall(table, _whole(table, wall), planes)
    return ScannedShell(floor, ceiling, wall, planes, levels)


def _without_fronts(table: FaceTable, wall: NDArray[np.int64]) -> NDArray[np.int64]:
    """Walls without planes that have a larger one close behind them, which are fronts of furniture, shape (m,)."""
    wall = np.where(wall >= 0, np.unique(wall, return_inverse=True)[1].reshape(-1) - int((wall < 0).any()), -1)
    count = int(wall.max(initial=-1)) + 1
    planes = [_plane(table, wall == i) for i in range(count)]
    area = np.bincount(wall[wall >= 0], table.area[wall >= 0], count)
    number, result = 0, np.full_like(wall, -1)
    for i, plane in enumerate(planes):
        behind = [
            plane[3] - other[3] for j, other in enumerate(planes) if area[j] > area[i] and plane[:3] @ other[:3] > 0.95
        ]
        if not any(0.0 < depth < DEEPEST_FRONT for depth in behind):
            result[wall == i] = number
            number += 1
    return result


def _whole(table: FaceTable, wall: NDArray[np.int64]) -> NDArray[np.int64]:
    """Walls without components that are mostly not wall: the frame of a picture with the picture, shape (m,)."""
    on_wall = np.bincount(table.component, table.area * (wall >= 0))
    whole = np.bincount(table.component, table.area)
    small = whole < LARGEST_FLUSH
    return np.where((on_wall < 0.5 * whole)[table.component] & small[table.component], -1, wall)


def _plane(table: FaceTable, faces: Mask) -> Array:
    """Mean normal, horizontal, and median offset of a wall's faces, shape (4,)."""
    normal = np.average(table.normal[faces], axis=0, weights=table.area[faces] + 1e-15)
    normal[2] = 0.0
    normal /= max(float(np.linalg.norm(normal)), 1e-12)
    offset = table.center[faces] @ normal
    order = np.argsort(offset)
    half = np.searchsorted(np.cumsum(table.area[faces][order]), 0.5 * table.area[faces].sum())
    return np.append(normal, offset[order[min(int(half), len(order) - 1)]])


def _patches(table: FaceTable, level: Mask, plane: Array) -> Mask:
    """Mask of the faces of a level in compact patches that are off it or of another colour, shape (m,).

    The other side of a two-sided floor or wall is not a patch.
    """
    near = np.abs(table.center @ plane[:3] - plane[3]) < PLANE_BAND
    faces = np.flatnonzero(level & near & (table.normal @ plane[:3] > FACING))
    if not len(faces):
        return np.zeros(len(level), dtype=bool)
    pairs = pairs_among(table.pairs, faces, len(level))
    region = color_regions(table.lab[faces], table.area[faces], pairs, smallest=CRUMBS)
    area = np.bincount(region, table.area[faces])
    offset = table.center[faces] @ plane[:3] - plane[3]
    main = region == int(np.argmax(area))
    shade = np.average(table.lab[faces][main], axis=0, weights=table.area[faces][main])
    base = float(np.median(offset[main]))
    odd = []
    for patch in np.flatnonzero(area > LEAST_PATCH):
        mine = region == patch
        other = np.linalg.norm(np.average(table.lab[faces][mine], axis=0, weights=table.area[faces][mine]) - shade)
        if not main[mine].any() and (abs(float(np.median(offset[mine])) - base) > RAISED or other > COLOR_STEP):
            odd.append(mine)
    result = np.zeros(len(level), dtype=bool)
    result[faces[_compact(table, faces, odd, plane[:3])]] = True
    return result


def _compact(table: FaceTable, faces: NDArray[np.int64], patches: list[Mask], normal: Array) -> Mask:
    """Mask of the faces in patches that fill most of their convex hull, together with the patches inside them, shape
    (k,)."""
    across = np.array([normal[1], -normal[0], 0.0]) if abs(normal[2]) < 0.5 else np.array([1.0, 0.0, 0.0])
    axes = np.stack([across, np.cross(normal, across)], axis=1)
    middle = table.center[faces] @ axes
    odd = np.any(patches, axis=0) if patches else np.zeros(len(faces), dtype=bool)
    result = np.zeros(len(faces), dtype=bool)
    for mine in patches:
        hull = plan_hull(table.corners[faces[mine]].reshape(-1, 3) @ axes)
        if hull is None:
            continue
        inside = odd & (middle @ hull.equations[:, :2].T + hull.equations[:, 2] < 1e-6).all(axis=1)
        if table.area[faces[inside]].sum() > COMPACT * hull.volume:
            result |= inside
    return result


def _skirting(table: FaceTable, rest: Mask, planes: Array, levels: Levels) -> Mask:
    """Mask of low strips along the walls, shape (m,)."""
    if not len(planes) or np.isnan(levels.floor):
        return np.zeros_like(rest)
    near = np.abs(table.center @ planes[:, :3].T - planes[:, 3]).min(axis=1) < PLANE_BAND
    top = np.full(int(table.component.max(initial=0)) + 1, -np.inf)
    np.maximum.at(top, table.component, table.corners[:, :, 2].max(axis=1))
    return np.asarray(rest & near & (top[table.component] < levels.floor + SKIRTING))


def _nearest_wall(table: FaceTable, wall: NDArray[np.int64], planes: Array) -> NDArray[np.int64]:
    """Index of the wall in whose plane each face of a wall lies, shape (m,)."""
    faces = np.flatnonzero(wall >= 0)
    result = wall.copy()
    if len(faces):
        away = np.abs(table.center[faces] @ planes[:, :3].T - planes[:, 3])
        away += 1.0 - np.abs(table.normal[faces] @ planes[:, :3].T)
        result[faces] = np.argmin(away, axis=1)
    return result
