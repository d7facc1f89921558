"""Metres as the pixels of a layout, and back.

As in the source (`load_room_boxes` with normalisation): a 256th of the room's shorter side is a pixel, and numbers are
cut to integers. A room of 4 m has pixels of 16 mm: no height in a layout is finer.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.language.protocol.questions import CssBox
from dcap.scene.types.floor_plan import FloorPlan, PlanBox

PIXELS = 256
"""Pixels along the room's shorter side."""
LEAST_SIDE = 1e-3
"""Least width that a room is assumed to have [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class PixelGrid:
    """The pixels of one room."""

    origin: Array
    """World point of left 0, top 0, depth 0 [m], shape (3,)."""
    per_metre: float

    def pixels(self, metres: float) -> int:
        """A length [m] in pixels, cut as the source does."""
        return int(metres * self.per_metre)

    def box(self, one: PlanBox) -> CssBox:
        """The line of a box."""
        left, top, depth = (self.pixels(float(value)) for value in one.center - self.origin)
        length, width, height = (self.pixels(float(value)) for value in one.size)
        angle = round(float(np.degrees(one.yaw)))
        return CssBox(category_of(one.label), length, width, height, left, top, depth, angle)

    def center(self, box: CssBox) -> Array:
        """The middle of a line's box in the world [m], shape (3,)."""
        return np.asarray(self.origin + np.array([box.left, box.top, box.depth]) / self.per_metre)


def grid_of(plan: FloorPlan) -> PixelGrid:
    """The pixels of a plan."""
    return PixelGrid(plan.low, PIXELS / max(float(plan.extents.min()), LEAST_SIDE))


def category_of(label: str) -> str:
    """A label as the category that begins a line: one word, without characters that end or divide a line."""
    return "_".join("".join(c if c.isalpha() else " " for c in label).split()) or "thing"
