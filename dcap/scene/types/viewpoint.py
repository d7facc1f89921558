"""Point of view on a thing: left and right are those of a viewer who looks at its front.

A thing without a front, such as a table in the middle of a room, has no natural viewer. The viewer is then assumed at
the long side that faces the room, and the result notes it.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.box import OrientedBox

VIEWED = frozenset({"left", "right", "front", "back", "head", "foot"})
"""Sides that depend on the viewer; up and down do not."""
MIDDLE = 0.1
"""Distance between the middles of thing and room up to which no side faces the room [m]."""


def viewer_side(
    box: OrientedBox, front: NDArray[np.float64] | None, room_center: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int]:
    """Unit vector towards the viewer, shape (2,), and the box axis along it: the side nearest to the front; without
    one the long side towards the room, whose middle is `room_center` [m], shape (2,) or (3,)."""
    axes, half = box.axes[:2, :2], box.half_extents[:2]
    sides = [(axes[:, k] * sign, k) for k in (0, 1) for sign in (1.0, -1.0)]
    if front is not None and np.linalg.norm(front[:2]) > 0:
        return max(sides, key=lambda s: float(s[0] @ front[:2]))
    axis = 1 if half[0] >= half[1] else 0
    direction = axes[:, axis]
    inward = float(direction @ (room_center[:2] - box.center[:2]))
    # in the middle of the room neither long side is nearer: the viewer stands towards -y, as on a floor plan
    away = inward < 0 if abs(inward) > MIDDLE else float(direction @ (0.01, 1.0)) > 0
    return (-direction if away else direction), axis


def axis_word(direction: NDArray[np.float64]) -> str:
    """The world axis nearest to a horizontal direction: +x, -x, +y or -y."""
    axis = int(abs(direction[1]) >= abs(direction[0]))
    return f"{'+' if direction[axis] > 0 else '-'}{'xy'[axis]}"
