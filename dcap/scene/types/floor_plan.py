"""A room for methods that plan on boxes: its outline and the boxes of its things."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array


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
    """Extents to its right, to its front and up [m], shape (3,)."""
    yaw: float
    """Turn about the vertical from facing -y, counterclockwise seen from above [rad]."""

    def __post_init__(self) -> None:
        check_array("center of a plan's box", self.center, 3)
        check_array("size of a plan's box", self.size, 3)

    @property
    def front(self) -> NDArray[np.float64]:
        """Direction of its front, a horizontal unit vector, shape (2,)."""
        return np.array([np.sin(self.yaw), -np.cos(self.yaw)])

    @property
    def right(self) -> NDArray[np.float64]:
        """Direction to the right of a viewer of its front, a horizontal unit vector, shape (2,)."""
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
    """bedroom, living room ...; room if its things do not determine it."""
    outline: NDArray[np.float64]
    """Corners [m], counter-clockwise, the first not repeated, shape (k, 2)."""
    floor: float
    """Height of the floor [m]."""
    boxes: tuple[PlanBox, ...]
    """Things without walls, floors and ceilings, each followed by its parts where it has several."""

    def __post_init__(self) -> None:
        check_array("outline of a floor plan", self.outline, None, 2)

    @property
    def low(self) -> NDArray[np.float64]:
        """The outline's least x and y and the floor's height [m], shape (3,)."""
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
