"""The object over its support, seen along vertical lines: what lies beneath it, how far away, and how deep it is in.

A line starts at the object's top, so that what lies under an object that is partly, or wholly, inside its support is
found as well. Nothing here knows what a method meant: only where the meshes are.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

LINES = 96
"""Vertical lines along each side of the object's box in plan [-]: features under a hundredth of its size are missed."""
ABOVE = 1e-3
"""Lines start this far above the object's highest point [m]: a thing under a surface, not touching it, is below it."""
DOWN, UP = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False, slots=True)
class Columns:
    """Vertical lines through the object that meet something beneath its top."""

    plan: Array
    """Where they are in plan [m], shape (k, 2)."""
    under: Array
    """Height of the object's lowest point on each [m], shape (k,)."""
    top: Array
    """Height of the first surface of the scene below the object's top on each [m], -inf where there is none, (k,)."""
    face: NDArray[np.int64]
    """That face of the scene, -1 where there is none, shape (k,)."""
    start: float
    """Height at which the lines begin [m]."""

    @property
    def gap(self) -> Array:
        """How far the object is above the scene, negative where it is below its surface [m], inf over nothing, (k,)."""
        return self.under - self.top

    @property
    def nearest(self) -> int:
        """The line on which it is least far above, or deepest below; -1 where there is nothing beneath."""
        return int(np.argmin(self.gap)) if len(self.gap) and np.isfinite(self.gap.min()) else -1


def columns(thing: Mesh, beneath: Raycaster) -> Columns:
    """Lines through the object (world frame) over the scene without it."""
    own = Raycaster(thing)
    low, high = thing.bounds
    step = np.maximum((high - low)[:2], 1e-9) / LINES
    axes = [low[a] + step[a] * (np.arange(LINES) + 0.5) for a in range(2)]
    plan = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    from_below = np.column_stack([plan, np.full(len(plan), low[2] - ABOVE)])
    under = from_below[:, 2] + own.cast(from_below, np.tile(UP, (len(plan), 1))).distance
    there = np.isfinite(under)
    plan, under = plan[there], under[there]
    start = np.column_stack([plan, np.full(len(plan), high[2] + ABOVE)])
    hits = beneath.cast(start, np.tile(DOWN, (len(plan), 1)))
    met = np.isfinite(hits.distance)
    top = np.where(met, start[:, 2] - np.where(met, hits.distance, 0.0), -np.inf)
    return Columns(
        plan, under, top, np.where(met, hits.face, -1).astype(np.int64), start[0, 2] if len(start) else high[2]
    )
