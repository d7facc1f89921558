"""Where a thing without a backrest faces: away from the wall that it stands against."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.labels import Category, category_of
from dcap.geometry.segmentation.parts.partmap import SIDES
from dcap.scene.types.segmentation import Instance

AGAINST = 0.25
"""A thing stands against a wall that is nearer than this [m]."""

SMALLEST = 0.4
"""A small thing of no known kind turns no side to the wall [m]."""

WITHOUT_FRONT = frozenset({Category.LAMP, Category.STOOL, Category.FLAT, Category.STRUCTURE, Category.PLANT})
"""Categories that have no front."""


def facing_away_from_wall(thing: Instance, walls: list[Instance]) -> NDArray[np.float64] | None:
    """Horizontal unit vector away from the nearest wall, by the longest side that stands against one."""
    small = 2.0 * float(thing.box.half_extents.max()) < SMALLEST
    if category_of(thing.label) in WITHOUT_FRONT or (small and category_of(thing.label) is Category.OTHER):
        return None
    best, found = 0.0, None
    for side in SIDES:
        axis = int(np.argmax(np.abs(side)))
        outward = thing.box.axes @ side
        middle = thing.box.center + outward * thing.box.half_extents[axis]
        if any(_near(middle, outward, wall) for wall in walls) and thing.box.half_extents[1 - axis] > best:
            best, found = float(thing.box.half_extents[1 - axis]), 0.0 - outward
    return found


def _near(point: NDArray[np.float64], outward: NDArray[np.float64], wall: Instance) -> bool:
    """Whether a wall lies close behind a point, seen along `outward`."""
    local = wall.box.to_local(point[None])[0]
    direction = wall.box.axes.T @ outward
    axis = int(np.argmin(wall.box.half_extents[:2]))
    across = abs(float(direction[axis])) > 0.9
    beside = abs(float(local[1 - axis])) <= wall.box.half_extents[1 - axis] + AGAINST
    gap = -float(np.sign(direction[axis])) * float(local[axis]) - float(wall.box.half_extents[axis])
    return across and beside and -2.0 * wall.box.half_extents[axis] - 0.05 < gap < AGAINST
