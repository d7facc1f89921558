"""The lines of a layout as rectangles, and the requested spot for a box on one of them.

In: the interpretation of the sentence and the rectangles of a layout. Out: the middle of the box, seen from above.
Sides are those of a viewer who looks at the front.

The lines of a layout as rectangles with a front, in metres: the representation of the offline writer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.language.protocol.questions import LayoutRequest, parsed_line
from dcap.language.protocol.replies import Constraint, IntentReply
from dcap.language.protocol.requests import InstanceView

PART = "part:"
SIDES = {"left": (-1, 0), "right": (1, 0), "front": (0, 1), "back": (0, -1), "head": (0, -1), "foot": (0, 1)}
"""Directions (right, front)."""
QUARTER, THIRD = 0.5, 0.65
"""Distances of the aims of a half, and of head or foot, from the middle, over the half extent [-]."""
BRINK = 0.02
"""Rim left free at an edge [m]."""
BESIDE = 0.05
"""Gap between a new box and the thing next to it [m]."""
RINGS, TURNS = 12, 16
"""Spots tried around the requested one: number of distances, and of directions at each."""
AS_FREE = 1e-4
"""Overlaps that differ by less than this are equal [m^2]."""


@dataclass(frozen=True, eq=False, slots=True)
class PlanRectangle:
    """A box of the layout."""

    thing: str
    part: int
    """Index of the part; -1 for the whole thing."""
    center: Array
    """Middle of the box [m], shape (2,)."""
    right: Array
    """Unit vector to the right of a viewer who looks at its front, shape (2,)."""
    front: Array
    """Unit vector out of its front, shape (2,)."""
    half: Array
    """Half extents along right and front [m], shape (2,)."""
    bottom: float
    top: float
    """Heights of the lower and upper face [m]."""

    def local(self, point: Array) -> Array:
        """A point (2,) relative to the middle, to the right and to the front [m]."""
        offset = point - self.center
        return np.array([offset @ self.right, offset @ self.front])

    def world(self, local: Array) -> Array:
        """The world point (2,) for a result of `local`."""
        return np.asarray(self.center + local[0] * self.right + local[1] * self.front)

    def reach(self, direction: Array) -> float:
        """Extent from the middle along a unit vector (2,) [m]."""
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
    """A thing without a line, the floor or a wall, by its bounds; its viewer is on the -y side."""
    low, high = np.array(one.low), np.array(one.high)
    right, front = np.array([1.0, 0.0]), np.array([0.0, -1.0])
    center, half = 0.5 * (low + high)[:2], 0.5 * (high - low)[:2]
    return PlanRectangle(one.id, -1, center, right, front, half, float(low[2]), float(high[2]))


def rectangle_of(request: LayoutRequest, thing: str, part: int = -1) -> PlanRectangle:
    """The rectangle of a thing or of its part; a thing with a single part has only a line for the whole."""
    lines = {(one.thing, one.part): one for one in rectangles(request)}
    if (thing, part) in lines:
        return lines[thing, part]
    if (thing, -1) in lines:
        return lines[thing, -1]
    return shell_rectangle(next(one for one in request.instances if one.id == thing))


def referred(request: LayoutRequest, meant: IntentReply, reference: str) -> list[PlanRectangle]:
    """The rectangles to which a reference of the sentence refers: an instance, or parts of the base."""
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


def wanted_spot(
    base: PlanRectangle,
    names: Sequence[str],
    references: Sequence[PlanRectangle],
    half: Array,
    view: PlanRectangle | None = None,
    taken: Sequence[PlanRectangle] = (),
) -> Array:
    """The requested spot [m], shape (2,).

    Args:
        base: what carries.
        names: region names.
        references: what "near", "between" ... refer to.
        half: half extents of the box along the base's right and front [m], shape (2,).
        view: whose left and front are meant next to a reference; the base's unless given.
        taken: what is in the way there.
    """
    sides = [SIDES[name] for name in names if name in SIDES]
    room = np.maximum(base.half - half - BRINK, 0.0)
    if references and "between" in names:
        return np.asarray(np.mean([one.center for one in references], axis=0))
    if references and "under" in names:
        return references[0].center
    if references and not {"corner", "edge", "end"} & set(names):
        return spots_next_to(base, references, sides, half, view or base, taken)
    if references and not sides:  # the edge or corner that faces them
        toward = base.local(np.mean([one.center for one in references], axis=0)) / np.maximum(base.half, 1e-9)
        if "corner" in names:
            sides = [(int(np.sign(toward[0])) or 1, 0), (0, int(np.sign(toward[1])) or 1)]
        else:
            axis = int(np.argmax(np.abs(toward)))
            sides = [SIDES["right" if toward[0] > 0 else "left"], SIDES["front" if toward[1] > 0 else "back"]][axis:][
                :1
            ]
    way = np.clip(np.sum(sides, axis=0), -1, 1).astype(float) if sides else np.zeros(2)
    if "corner" in names:
        way = np.where(way == 0.0, (1.0, 1.0), way)
        return base.world(way * room)
    if {"edge", "end"} & set(names):
        if not sides:
            way = np.array([0.0, 1.0]) if ("edge" in names) == (base.half[0] >= base.half[1]) else np.array([1.0, 0.0])
        return base.world(way * room)
    share = np.array([THIRD if {"head", "foot"} & set(names) else QUARTER] * 2)
    return base.world(np.clip(way * share * base.half, -room, room))


def spots_next_to(
    base: PlanRectangle,
    references: Sequence[PlanRectangle],
    sides: Sequence[tuple[int, int]],
    half: Array,
    view: PlanRectangle,
    taken: Sequence[PlanRectangle],
) -> Array:
    """The spot at a side of a reference where the box is over the base and unobstructed, the nearest of several."""
    ways = [np.clip(np.sum(sides, axis=0), -1, 1)] if sides else [(0, 1), (1, 0), (-1, 0), (0, -1)]
    found: list[tuple[float, float, int, Array]] = []
    for one in references:
        for right, front in ways:
            way = right * view.right + front * view.front
            length = float(np.linalg.norm(way))
            if length == 0.0:  # left and right at once
                continue
            way = way / length
            away = one.reach(way) + float(half @ np.abs([way @ base.right, way @ base.front])) + BESIDE
            spot = kept_on(base, one.center + away * way, half)
            cost = round(overlap(base, spot, half, [*taken, one]), 3)
            far = round(float(np.linalg.norm(spot - one.center - away * way)), 3)
            found.append((cost + far, float(np.linalg.norm(spot - base.center)), len(found), spot))
    return min(found)[3] if found else references[0].center


def kept_on(base: PlanRectangle, point: Array, half: Array) -> Array:
    """The point moved so that the box is over the base, shape (2,)."""
    room = np.maximum(base.half - half, 0.0)
    return base.world(np.clip(base.local(point), -room, room))


def limited(base: PlanRectangle, spot: Array, half: Array, limits: Sequence[tuple[Constraint, Array | None]]) -> Array:
    """The spot moved to meet distances: each constraint with the middle of its target, None for the base."""
    room = np.maximum(base.half - half - BRINK, 0.0)
    for limit, point in limits:
        sides = [np.array(SIDES[name], dtype=float) for name in limit.regions if name in SIDES]
        if limit.kind in ("exactly", "at_least", "at_most") and point is None and sides and limit.metres:
            local = base.local(spot)
            for side in sides:
                axis = int(np.argmax(np.abs(side)))
                local[axis] = side[axis] * max(base.half[axis] - half[axis] - limit.metres, 0.0)
            spot = base.world(local)
        elif limit.kind == "nearest" and point is not None:
            spot = base.world(np.clip(base.local(point), -room, room))
        elif limit.kind == "nearest" and sides:
            spot = base.world(np.sum(sides, axis=0) * room)
        elif limit.kind in ("farthest", "away") and point is not None:
            spot = base.world(-np.sign(base.local(point)) * room)
        elif limit.metres and point is not None:
            way = base.center - point if np.linalg.norm(base.center - point) > 1e-6 else base.front
            away = limit.metres + float(np.linalg.norm(half))
            spot = kept_on(base, point + away * way / np.linalg.norm(way), half)
    return spot


def free_spot(base: PlanRectangle, spot: Array, half: Array, taken: Sequence[PlanRectangle]) -> Array:
    """The nearest spot where the box overlaps nothing, or as little as possible, shape (2,)."""
    best, least = spot, overlap(base, spot, half, taken)
    reach = float(np.linalg.norm(base.half))
    for ring in range(1, RINGS + 1):
        if least < AS_FREE:
            return best
        for turn in range(TURNS):
            angle = 2.0 * np.pi * turn / TURNS
            offset = reach * ring / RINGS * np.array([np.sin(angle), np.cos(angle)])
            tried = kept_on(base, base.world(base.local(spot) + offset), half)
            if (cost := overlap(base, tried, half, taken)) < least - AS_FREE:
                best, least = tried, cost
    return best


def overlap(base: PlanRectangle, spot: Array, half: Array, taken: Sequence[PlanRectangle]) -> float:
    """Area of the box covered by others, seen from above [m^2]; turned boxes count with their bounds in the base's
    frame."""
    local, area = base.local(spot), 0.0
    for one in taken:
        reach = np.array([one.reach(base.right), one.reach(base.front)])
        common = np.minimum(local + half, base.local(one.center) + reach)
        common -= np.maximum(local - half, base.local(one.center) - reach)
        area += float(np.prod(np.maximum(common, 0.0)))
    return area
