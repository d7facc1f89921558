"""The lines of a layout as rectangles that look somewhere, in metres: what the offline writer reckons with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.language.protocol.baseline_questions import LayoutRequest
from dcap.language.protocol.layout_text import parsed_line
from dcap.language.protocol.replies import IntentReply
from dcap.language.protocol.requests import InstanceView

Array = NDArray[np.float64]
PART = "part:"


@dataclass(frozen=True, eq=False, slots=True)
class PlanRectangle:
    """A box of the layout."""

    thing: str
    part: int
    """-1 for the whole thing."""
    center: Array
    """[m], shape (2,)."""
    right: Array
    """Unit vector to the right of who looks at its front, shape (2,)."""
    front: Array
    """Unit vector out of its front, shape (2,)."""
    half: Array
    """Half extents along right and front [m], shape (2,)."""
    bottom: float
    top: float
    """Heights of its lower and upper face [m]."""

    def local(self, point: Array) -> Array:
        """A point (2,) to its right and to its front from its middle [m]."""
        offset = point - self.center
        return np.array([offset @ self.right, offset @ self.front])

    def world(self, local: Array) -> Array:
        """The point (2,) of what `local` gives."""
        return np.asarray(self.center + local[0] * self.right + local[1] * self.front)

    def reach(self, direction: Array) -> float:
        """How far it reaches from its middle along a unit vector (2,) [m]."""
        return float(self.half @ np.abs([direction @ self.right, direction @ self.front]))


def rectangles(request: LayoutRequest) -> list[PlanRectangle]:
    """All lines of a request's layout."""
    found = []
    for line in request.lines:
        box = parsed_line(line.text)
        if box is None:
            continue
        metres = 1.0 / request.pixels_per_metre
        angle = np.radians(box.orientation)
        center = np.array(request.origin) + metres * np.array([box.left, box.top, box.depth])
        found.append(
            PlanRectangle(
                line.thing,
                line.part,
                center[:2],
                np.array([np.cos(angle), np.sin(angle)]),
                np.array([np.sin(angle), -np.cos(angle)]),
                0.5 * metres * np.array([box.length, box.width]),
                float(center[2] - 0.5 * metres * box.height),
                float(center[2] + 0.5 * metres * box.height),
            )
        )
    return found


def shell_rectangle(one: InstanceView) -> PlanRectangle:
    """A thing that no line stands for, the floor or a wall, by its bounds; its viewer stands towards -y."""
    low, high = np.array(one.low), np.array(one.high)
    right, front = np.array([1.0, 0.0]), np.array([0.0, -1.0])
    center, half = 0.5 * (low + high)[:2], 0.5 * (high - low)[:2]
    return PlanRectangle(one.id, -1, center, right, front, half, float(low[2]), float(high[2]))


def rectangle_of(request: LayoutRequest, thing: str, part: int = -1) -> PlanRectangle:
    """The rectangle of a thing or of its part; a thing of one part has a line for the whole only."""
    lines = {(one.thing, one.part): one for one in rectangles(request)}
    if (thing, part) in lines:
        return lines[thing, part]
    if (thing, -1) in lines:
        return lines[thing, -1]
    return shell_rectangle(next(one for one in request.instances if one.id == thing))


def referred(request: LayoutRequest, meant: IntentReply, reference: str) -> list[PlanRectangle]:
    """The rectangles that a reference of the sentence means: an instance, or parts of the base."""
    if not reference.startswith(PART):
        return [rectangle_of(request, reference)]
    name, _, side = reference.removeprefix(PART).partition("/")
    base = next(one for one in request.instances if one.id == meant.base_id)
    found = [rectangle_of(request, base.id, part.index) for part in base.parts if part.name == name]
    if not side or not found:
        return found
    whole = rectangle_of(request, base.id)
    ways = {"left": -whole.right, "right": whole.right, "front": whole.front, "back": -whole.front}
    if side in ways:
        return [max(found, key=lambda one: float(one.center @ ways[side]))]
    return [max(found, key=lambda one: one.top if side == "top" else -one.top)]
