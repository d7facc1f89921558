"""Words such as "left edge" or "next to the pillow" as areas of a horizontal surface.

In: the frame of a part (its box, and the side from which a viewer looks at the furniture's front) and region names.
Out: areas with an aim, best first. Left and right are the viewer's, front is the viewer's side, back and head are the
far side.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dcap.arrays import Array
from dcap.geometry.placement.polygons import (
    clipped,
    clipped_half_plane,
    counter_clockwise,
    gap_between,
    grown,
    swept,
)
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import viewer_side

CENTER = 0.35
"""Half width of the central area over the part's half extent [-]."""
EDGE = 0.35
"""Depth of an edge area over the part's half extent [-]."""
BRINK = 0.02
"""Free rim left between the object and the edge near which it is put [m]."""
END = 0.3
"""Distance of the beginning of head and foot from the middle, over the half extent [-]."""
BESIDE = {"near": 0.5, "next_to": 0.15, "between": 0.0, "under": 0.0}
"""Distance from the reference's box at which a place next to it ends, in addition to the object's radius [m]."""
OFF = frozenset({"near", "next_to"})
"""Relations in which a thing is next to another and not over or under it."""
VIEWER = 0.03
"""Shift of the aim towards the viewer [m], which selects the viewer's side among places all around a thing."""
SIDES = {"left": (-1, 0), "right": (1, 0), "front": (0, 1), "back": (0, -1), "head": (0, -1), "foot": (0, 1)}
"""Directions (right, front)."""


@dataclass(frozen=True, eq=False, slots=True)
class ViewerFrame:
    """A part's rectangle seen by the viewer."""

    center: Array
    """World xy [m], shape (2,)."""
    right: Array
    """Unit vector to the viewer's right, shape (2,)."""
    front: Array
    """Unit vector towards the viewer, shape (2,)."""
    half: Array
    """Half extents along right and front [m], shape (2,)."""

    def world(self, local: object) -> Array:
        """Points (..., 2) given as right and front, -1..1, in world xy [m]."""
        scaled = np.asarray(local, dtype=np.float64) * self.half
        return np.asarray(self.center + scaled[..., :1] * self.right + scaled[..., 1:] * self.front)

    def local(self, points: Array) -> Array:
        """World xy points (..., 2) as right and front, -1..1."""
        offset = np.asarray(points) - self.center
        both = np.stack([offset @ self.right, offset @ self.front], axis=-1)
        return np.asarray(both / np.maximum(self.half, 1e-9))


@dataclass(frozen=True, eq=False, slots=True)
class Region:
    """An area and its aim."""

    polygon: Array
    """World xy [m], convex, counter-clockwise, shape (k, 2)."""
    target: Array
    """World xy [m], shape (2,)."""
    name: str = ""
    """The words of the area, if it is one of several requested areas; else empty."""
    excluded: tuple[Array, ...] = ()
    """Convex parts of the area that exclude the object's origin: world xy [m], shape (k, 2) each."""


def viewer_frame(box: OrientedBox, front: Array | None, room_center: Array) -> ViewerFrame:
    """The frame of a part: the box side nearest to the front; without a front the long side towards the room."""
    half, (direction, axis) = box.half_extents[:2], viewer_side(box, front, room_center)
    right = np.array([-direction[1], direction[0]])  # z x front
    return ViewerFrame(box.center[:2].copy(), right, np.asarray(direction), np.array([half[1 - axis], half[axis]]))


def regions(
    frame: ViewerFrame,
    names: Sequence[str],
    references: Sequence[OrientedBox],
    reach: Array,
    view: ViewerFrame | None = None,
    footprint: Array | None = None,
    farther: float = 0.0,
) -> list[Region]:
    """Areas for the names, best first; the whole part if there are no names.

    `reach`: half extents of the object along the frame's right and front [m], shape (2,).
    `view`: whose left and front are meant next to references; the part's unless given.
    `footprint`: corners of the object's outline from its origin [m], shape (k, 2): near and next to things it stays off
    them then, neither over nor under them. `farther`: at least so far a place next to things reaches, and one under
    them beyond their plan [m].
    """
    radius = float(reach.max())
    beside = [n for n in names if n in BESIDE]
    if references and "corner" in names and beside and beside[0] in OFF:
        return [strip(frame, corner_at(frame, view or frame, names, references), reach)]
    if references and "end" in names and beside and beside[0] in OFF:
        ends = end_directions(frame, [])
        return [end_region(frame, min(ends, key=lambda d: gap_to(frame.world([[d[0], d[1]]])[0], references)))]
    if beside and references:
        area = beside_region(frame, view or frame, beside[0], names, references, radius, farther)
        if area is None:
            return []
        if footprint is None or beside[0] not in OFF:
            return [area]
        return [off_them(area, view or frame, names, references, footprint)]
    sides = [n for n in names if n in SIDES]
    if "end" in names:
        return [end_region(frame, d) for d in end_directions(frame, [SIDES[n] for n in sides])]
    if "corner" in names:
        return [strip(frame, d, reach) for d in corner_directions([SIDES[n] for n in sides])]
    if "edge" in names and opposite(sides):
        return [replace(strip(frame, SIDES[n], reach), name=f"{n} edge") for n in sides]
    if "edge" in names:
        edges = edge_directions(frame, names, references)
        return [strip(frame, d, reach) for d in edges]
    if sides:
        return [half_region(frame, names)]
    if "center" in names or "middle" in names:
        return [rectangle(frame, (-CENTER, -CENTER), (CENTER, CENTER), (0.0, 0.0))]
    return [rectangle(frame, (-1.0, -1.0), (1.0, 1.0), (0.0, 0.0))]


def rectangle(frame: ViewerFrame, low: Sequence[float], high: Sequence[float], target: Sequence[float]) -> Region:
    """A rectangle in the part's frame."""
    ring = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return Region(counter_clockwise(frame.world(ring)), frame.world(target))


def half_region(frame: ViewerFrame, names: Sequence[str]) -> Region:
    """The area of the left half, back half, head, front left quarter ..."""
    low, high = np.array([-1.0, -1.0]), np.array([1.0, 1.0])
    target = np.zeros(2)
    for name in names:
        if name not in SIDES:
            continue
        axis = 0 if SIDES[name][0] else 1
        sign = SIDES[name][axis]
        bound = END if name in ("head", "foot") else 0.0
        if sign > 0:
            low[axis] = max(low[axis], bound)
        else:
            high[axis] = min(high[axis], -bound)
        target[axis] = sign * (1.0 + bound) / 2.0
    if (low >= high).any():  # "left" and "right" at once: both share the middle
        return rectangle(frame, (-CENTER, -1.0), (CENTER, 1.0), (0.0, 0.0))
    return rectangle(frame, low.tolist(), high.tolist(), target.tolist())


def end_directions(frame: ViewerFrame, directions: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The requested end, or both ends of the longer axis; a side that is not an end of it counts as that side."""
    if directions:
        return [directions[0]]
    return [(1, 0), (-1, 0)] if frame.half[0] >= frame.half[1] else [(0, 1), (0, -1)]


def end_region(frame: ViewerFrame, direction: tuple[int, int]) -> Region:
    """The outer part of the surface in a direction, beyond its middle."""
    low, high, target = [-1.0, -1.0], [1.0, 1.0], [0.0, 0.0]
    axis = 0 if direction[0] else 1
    target[axis] = direction[axis] * 0.5 * (1.0 + CENTER)
    (low if direction[axis] > 0 else high)[axis] = direction[axis] * CENTER
    return rectangle(frame, low, high, target)


def opposite(sides: Sequence[str]) -> bool:
    """Return whether two of the sides are opposite: no place is on both, so either is meant."""
    directions = {SIDES[n] for n in sides}
    return any((-right, -front) in directions for right, front in directions)


def corner_directions(directions: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """The requested corner, or all that fit, those at the viewer's side first."""
    right = {d[0] for d in directions if d[0]} or {1, -1}
    front = {d[1] for d in directions if d[1]} or {1, -1}
    corners = [(1, 1), (-1, 1), (1, -1), (-1, -1)]
    return [c for c in corners if c[0] in right and c[1] in front]


def corner_at(
    frame: ViewerFrame, view: ViewerFrame, names: Sequence[str], references: Sequence[OrientedBox]
) -> tuple[int, int]:
    """The corner nearest to one of the references, among those on its named side."""
    middle = np.mean([box.center[:2] for box in references], axis=0)
    ways = [SIDES[n][0] * view.right + SIDES[n][1] * view.front for n in names if n in SIDES]

    def away(corner: tuple[int, int]) -> tuple[int, float]:
        point = frame.world([[corner[0], corner[1]]])[0]
        return sum(float((point - middle) @ way) <= 0.0 for way in ways), gap_to(point, references)

    return min(corner_directions([]), key=away)


def gap_to(point: Array, references: Sequence[OrientedBox]) -> float:
    """Horizontal distance of a point (2,) from the nearest reference [m]."""
    return min(float(horizontal_gaps(point[None], box)[0]) for box in references)


def horizontal_gaps(points: Array, box: OrientedBox) -> Array:
    """Horizontal distances of points (n, 2) from a box [m], 0 over and under it, shape (n,)."""
    local = np.abs(box.to_local(np.c_[points, np.full(len(points), box.center[2])]))
    return np.asarray(np.linalg.norm(np.maximum(local - box.half_extents, 0.0)[:, :2], axis=1))


def edge_directions(
    frame: ViewerFrame, names: Sequence[str], references: Sequence[OrientedBox] = ()
) -> list[tuple[int, int]]:
    """The asked edge, the one that looks at the references, or all of the asked length, the viewer's first, then the
    longer ones."""
    directions = [SIDES[n] for n in names if n in SIDES]
    if directions:
        return [(sum(d[0] for d in directions), sum(d[1] for d in directions))]
    if references:
        return [edge_at(frame, references, names)]
    wide = bool(frame.half[0] >= frame.half[1])
    left_and_right, front_and_back = [(1, 0), (-1, 0)], [(0, 1), (0, -1)]
    if "end" in names or "long" in names:
        return front_and_back if wide == ("long" in names) else left_and_right
    return [(0, 1), (1, 0), (-1, 0), (0, -1)] if wide else [*left_and_right, *front_and_back]


def edge_at(frame: ViewerFrame, references: Sequence[OrientedBox], names: Sequence[str] = ()) -> tuple[int, int]:
    """The edge of the asked length that comes nearest to one of these, seen from above; of two that meet in a corner
    the one that looks at it."""
    sides, along = edge_directions(frame, [n for n in names if n not in SIDES]), np.linspace(-1.0, 1.0, 33)[:, None]

    def away(side: tuple[int, int]) -> tuple[float, float]:
        points = frame.world(np.array(side, dtype=float) + along * np.array(side[::-1], dtype=float))
        nearest = np.min([horizontal_gaps(points, box) for box in references], axis=0)
        return round(float(nearest.min()), 3), float(nearest.mean())

    return min(sides, key=away)


def strip(frame: ViewerFrame, direction: tuple[int, int], reach: Array) -> Region:
    """The outer strip on one side, or the outer corner of two sides."""
    low, high, target = [-1.0, -1.0], [1.0, 1.0], [0.0, 0.0]
    for axis in (0, 1):
        half = max(float(frame.half[axis]), 1e-9)
        depth = min(1.0, max(EDGE, 1.5 * reach[axis] / half))
        aim = max(0.0, 1.0 - (reach[axis] + BRINK) / half)
        if direction[axis] > 0:
            low[axis], target[axis] = 1.0 - depth, aim
        elif direction[axis] < 0:
            high[axis], target[axis] = depth - 1.0, -aim
    return rectangle(frame, low, high, target)


def beside_region(
    frame: ViewerFrame,
    view: ViewerFrame,
    relation: str,
    names: Sequence[str],
    references: Sequence[OrientedBox],
    radius: float,
    farther: float = 0.0,
) -> Region | None:
    """The area near, next to, between or under other things, cut to the part; None if nothing remains."""
    polygon, target = beside_area(view, relation, names, references, radius, farther)
    polygon = clipped(polygon, outline(frame))
    return Region(polygon, closest_inside(frame, target)) if len(polygon) >= 3 else None


def distance_beside(
    frame: ViewerFrame,
    names: Sequence[str],
    references: Sequence[OrientedBox],
    reach: Array,
    view: ViewerFrame | None = None,
) -> float:
    """Distance from the part of a place next to other things, if `regions` finds none on the part [m]."""
    relation = next(n for n in names if n in BESIDE)
    polygon, _ = beside_area(view or frame, relation, names, references, float(reach.max()))
    # no place is both left and right of a thing: use the thing itself
    ring = polygon if len(polygon) else np.concatenate([box.corners[:4, :2] for box in references])
    return gap_between(ring, outline(frame))


def beside_area(
    view: ViewerFrame,
    relation: str,
    names: Sequence[str],
    references: Sequence[OrientedBox],
    radius: float,
    farther: float = 0.0,
) -> tuple[Array, Array]:
    """The polygon near, next to, between or under other things, wherever it lies, and its aim [m]."""
    rings = [box.corners[:4, :2] for box in references]
    middle = np.mean([box.center[:2] for box in references], axis=0)
    reach = radius + max(BESIDE[relation], farther)
    if relation == "between" and len(references) > 1:
        polygon = grown(np.array([box.center[:2] for box in references]), max(radius, 0.1))
    else:
        polygon = grown(np.concatenate(rings), farther if relation == "under" else reach)
    target = middle
    if relation != "between" and not any(name in SIDES for name in names):
        target = middle + VIEWER * view.front
    for name in names:
        if name in SIDES and relation in ("near", "next_to"):
            direction = SIDES[name][0] * view.right + SIDES[name][1] * view.front
            polygon = clipped_half_plane(polygon, middle, -direction)
            target = target + direction * (float(np.max((rings[0] - middle) @ direction)) + radius)
    return polygon, target


def off_them(
    area: Region, view: ViewerFrame, names: Sequence[str], references: Sequence[OrientedBox], footprint: Array
) -> Region:
    """The area without the places where the object would be over or under the references; for "in front of" and the
    like, the part beyond the face on that side."""
    rings = [box.corners[:4, :2] for box in references]
    polygon = area.polygon
    middle = np.mean([box.center[:2] for box in references], axis=0)
    for name in names:
        if name in SIDES:
            direction = SIDES[name][0] * view.right + SIDES[name][1] * view.front
            face = middle + direction * float(np.max((rings[0] - middle) @ direction))
            beyond = clipped_half_plane(polygon, face, -direction)
            polygon = beyond if len(beyond) >= 3 else polygon
    return replace(area, polygon=polygon, excluded=(*area.excluded, *(swept(ring, footprint) for ring in rings)))


def outline(frame: ViewerFrame) -> Array:
    """The part's rectangle [m], shape (4, 2)."""
    return rectangle(frame, (-1.0, -1.0), (1.0, 1.0), (0.0, 0.0)).polygon


def both(areas: Sequence[Region]) -> list[Region]:
    """Intersection of all areas, aimed at its middle; empty if they do not overlap."""
    polygon = areas[0].polygon if areas else np.zeros((0, 2))
    for area in areas[1:]:
        polygon = clipped(polygon, area.polygon)
    return [Region(polygon, polygon.mean(axis=0))] if len(areas) > 1 and len(polygon) >= 3 else []


def closest_inside(frame: ViewerFrame, point: Array) -> Array:
    """The point moved onto the part's rectangle [m], shape (2,)."""
    return frame.world(np.clip(frame.local(point), -1.0, 1.0))
