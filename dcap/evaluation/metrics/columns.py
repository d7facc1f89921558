"""Measures the object over its support along vertical lines: the surface beneath, its distance, and the overlap.

A line starts at the object's highest point on it: the desk over a chair's seat does not carry the chair. Only if that
point is inside a solid does it start at the top of the whole object, so that it finds the surface of the solid that the
object intersects. A surface that a line meets from behind in the upper half of the object is above the object, such as
a board that its top touches. Nothing here knows a method's intention: only the meshes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.raycast import Raycaster
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
