"""Floor, ceiling and walls of a scene: levels of horizontal area, annotated wall boxes, large vertical planes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.faces import FaceTable, level_of, plan_cells, surface_heights
from dcap.scene.types.box import OrientedBox

LEVEL_BAND = 0.03
"""A floor is no more uneven than this [m]: scan noise and a skirting's edge."""

PLANE_BAND = 0.05
"""A wall's faces lie within this distance of its plane or annotated box [m]."""

WALL_AREA = 1.2
"""Least area of a vertical plane that is a wall [m^2]."""

WALL_SHARE = 0.25
"""... and least share of the largest wall's area: the front of a wardrobe is smaller [-]."""

PLAN_STEP = 0.1
"""Cells in which the plan of a scene is measured [m]."""

MAX_WALLS = 40
"""Planes that are tried [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Levels:
    """Heights of floor and ceiling; nan where there is none."""

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
    """The level of the chosen faces if it covers a fifth of the footprint."""
    found = level_of(z[chosen], area[chosen], LEVEL_BAND)
    near = chosen & (np.abs(z - found) < LEVEL_BAND)
    return found if area[near].sum() > 0.2 * footprint else float("nan")


def floor_faces(table: FaceTable, levels: Levels) -> NDArray[np.bool_]:
    """Faces of the floor: level and at its height, or below it, shape (m,)."""
    if np.isnan(levels.floor):
        return np.zeros(len(table.area), dtype=bool)
    z = table.center[:, 2]
    at_level = (np.abs(z - levels.floor) < LEVEL_BAND) & (table.normal[:, 2] > 0.6)
    return np.asarray(at_level | (z < levels.floor - 0.01))


def ceiling_faces(table: FaceTable, levels: Levels) -> NDArray[np.bool_]:
    """Faces of the ceiling: level and at its height, or above it, shape (m,)."""
    if np.isnan(levels.ceiling):
        return np.zeros(len(table.area), dtype=bool)
    z = table.center[:, 2]
    at_level = (np.abs(z - levels.ceiling) < LEVEL_BAND) & (table.normal[:, 2] < -0.6)
    return np.asarray(at_level | (z > levels.ceiling + 0.01))


def wall_number(
    table: FaceTable, walls: list[OrientedBox], chosen: NDArray[np.bool_], inside_things: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Number of the wall of each chosen face, -1 for none: by annotated boxes if there are any, else by planes, (m,).

    Planes are found on faces that are not `inside_things`, so that the front of a wardrobe is none.
    """
    if walls:
        return _walls_by_box(table, walls, chosen)
    return _walls_by_plane(table, chosen & (np.abs(table.normal[:, 2]) < 0.6), inside_things)


def _walls_by_box(table: FaceTable, walls: list[OrientedBox], chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
    """The wall box whose surface is nearest, within `PLANE_BAND`."""
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
    """Greedy vertical planes, largest first, as long as they are large and nearly room-high."""
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
