"""A room seen in plan: its outline and the boxes of its things, and a map of free, occupied and unknown places."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

FREE, OCCUPIED, UNKNOWN = 255, 0, 127
"""Values of the cells, as InteriorGS stores them."""


@dataclass(frozen=True, eq=False, slots=True)
class PlanBox:
    """A thing, or a part of one, as an upright box with a front."""

    thing: str
    """Instance id."""
    part: int
    """Index into the instance's parts, -1 for the whole thing."""
    label: str
    """Name: bed, or bed blanket for a part."""
    center: NDArray[np.float64]
    """Middle of the box [m], shape (3,)."""
    size: NDArray[np.float64]
    """Extents to the right, to the front and upwards [m], shape (3,)."""
    yaw: float
    """Counterclockwise turn about the vertical, seen from above, relative to facing -y [rad]."""

    def __post_init__(self) -> None:
        check_array("center of a plan's box", self.center, 3)
        check_array("size of a plan's box", self.size, 3)

    @property
    def front(self) -> NDArray[np.float64]:
        """Direction of its front, a horizontal unit vector, shape (2,)."""
        return np.array([np.sin(self.yaw), -np.cos(self.yaw)])

    @property
    def right(self) -> NDArray[np.float64]:
        """Direction to the right of a viewer facing its front, a horizontal unit vector, shape (2,)."""
        return np.array([np.cos(self.yaw), np.sin(self.yaw)])

    @property
    def ring(self) -> NDArray[np.float64]:
        """Corners seen from above [m], counter-clockwise, shape (4, 2)."""
        half = 0.5 * self.size[:2]
        signs = np.array([[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]) * half
        return np.asarray(self.center[:2] + signs[:, :1] * self.right + signs[:, 1:] * self.front)

    @property
    def bottom(self) -> float:
        """Height of its lower face [m]."""
        return float(self.center[2] - 0.5 * self.size[2])

    @property
    def top(self) -> float:
        """Height of its upper face [m]."""
        return float(self.center[2] + 0.5 * self.size[2])


@dataclass(frozen=True, eq=False, slots=True)
class FloorPlan:
    """The outline of a room's floor and the things in the room."""

    kind: str
    """Kind of room: bedroom, living room ...; room if its things do not determine it."""
    outline: NDArray[np.float64]
    """Corners [m], counter-clockwise, the first not repeated, shape (k, 2)."""
    floor: float
    """Height of the floor [m]."""
    boxes: tuple[PlanBox, ...]
    """Things without walls, floors and ceilings; a thing with several parts is followed by its parts."""

    def __post_init__(self) -> None:
        check_array("outline of a floor plan", self.outline, None, 2)

    @property
    def low(self) -> NDArray[np.float64]:
        """Minimum x and y of the outline, and height of the floor [m], shape (3,)."""
        return np.array([*self.outline.min(axis=0), self.floor])

    @property
    def extents(self) -> NDArray[np.float64]:
        """Extents of the outline along x and y [m], shape (2,)."""
        return np.asarray(np.ptp(self.outline, axis=0))

    @property
    def things(self) -> tuple[PlanBox, ...]:
        """The boxes of whole things."""
        return tuple(box for box in self.boxes if box.part < 0)


@dataclass(frozen=True, eq=False, slots=True)
class FloorPlans:
    """The plans of several rooms."""

    plans: tuple[FloorPlan, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Occupancy:
    """Square cells along the world's axes."""

    cells: NDArray[np.uint8]
    """FREE, OCCUPIED or UNKNOWN, shape (rows, columns)."""
    first: NDArray[np.float64]
    """World xy of the middle of the cell in row 0 and column 0 [m], shape (2,)."""
    step: NDArray[np.float64]
    """Step of world x from column to column and of world y from row to row [m], either sign, shape (2,)."""

    def __post_init__(self) -> None:
        check_array("cells of an occupancy map", self.cells, None, None)
        check_array("first cell of an occupancy map", self.first, 2)
        check_array("step of an occupancy map", self.step, 2)
        if not np.isin(self.cells, (FREE, OCCUPIED, UNKNOWN)).all():
            raise GeometryError(f"an occupancy map may contain only {OCCUPIED}, {UNKNOWN} and {FREE}")
        if not self.step.all():
            raise GeometryError(f"step of an occupancy map is {self.step.tolist()} m, expected no zero")

    @property
    def free(self) -> NDArray[np.bool_]:
        """Free cells, shape (rows, columns)."""
        return np.asarray(self.cells == FREE)

    @property
    def scale(self) -> float:
        """Side of a cell [m]."""
        return float(np.abs(self.step).min())

    def world(self, rows: NDArray[np.integer], columns: NDArray[np.integer]) -> NDArray[np.float64]:
        """Middles of cells in the world [m], shape (n, 2)."""
        return self.first + np.stack([columns, rows], axis=1) * self.step

    def value(self, points: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Values of the map at world points (n, 2 or more), UNKNOWN outside the map, shape (n,)."""
        columns, rows = np.rint((points[:, :2] - self.first) / self.step).T
        there = (rows >= 0) & (rows < self.cells.shape[0]) & (columns >= 0) & (columns < self.cells.shape[1])
        out = np.full(len(points), UNKNOWN, dtype=np.uint8)
        out[there] = self.cells[rows[there].astype(np.int64), columns[there].astype(np.int64)]
        return out

    def within(self, polygons: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
        """Mask of the cells whose middle lies in one of the polygons (k, 2) [m], shape (rows, columns)."""
        rows, columns = self.cells.shape
        x = self.first[0] + np.arange(columns) * self.step[0]
        y = self.first[1] + np.arange(rows) * self.step[1]
        out = np.zeros(self.cells.shape, dtype=bool)
        for polygon in polygons:
            low, high = polygon.min(axis=0), polygon.max(axis=0)
            wide, tall = np.flatnonzero((x >= low[0]) & (x <= high[0])), np.flatnonzero((y >= low[1]) & (y <= high[1]))
            if len(wide) and len(tall):
                block = (slice(tall[0], tall[-1] + 1), slice(wide[0], wide[-1] + 1))
                out[block] |= crossed_oddly(polygon, x[wide], y[tall])
        return out


def crossed_oddly(polygon: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the points (x_j, y_i) that lie in a polygon (k, 2), shape (len(y), len(x)): a ray along x crosses its
    edges an odd number of times."""
    odd = np.zeros((len(y), len(x)), dtype=bool)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        between = (a[1] > y) != (b[1] > y)
        if between.any():
            crossing = a[0] + (y[between] - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
            odd[between] ^= x[None, :] < crossing[:, None]
    return odd
