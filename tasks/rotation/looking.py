"""Viewing direction of an object: along its front, or by a side without one."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.upright import outermost
from dcap.scene.types.mesh import Mesh
from tasks.requests.surroundings import horizontal

Array = NDArray[np.float64]

LEVEL = 0.3
"""Horizontal part of a unit vector below which it points up or down [-]."""


def looking(front: Array, up: Array) -> Array:
    """Horizontal viewing direction of the object: along its front, or, if that is vertical, along its own up."""
    for axis in (front, up):
        flat = horizontal(axis)
        if flat is not None and np.linalg.norm(axis[:2]) > LEVEL:
            return flat
    return np.array([0.0, -1.0, 0.0])


def nearest_side(mesh: Mesh, matrix: Array, ahead: Array) -> Array:
    """The outward side of the plan's smallest rectangle that is nearest to a direction, for objects without a front."""
    along, _ = smallest_rectangle((outermost(mesh.vertices) @ matrix.T)[:, :2])
    sides = [np.array([x, y, 0.0]) for x, y in (along, -along, (-along[1], along[0]), (along[1], -along[0]))]
    return max(sides, key=lambda side: float(side @ ahead))
