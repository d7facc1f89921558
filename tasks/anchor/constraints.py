"""Cuts areas to the constraints of a place: excluded places, distances, farthest and nearest.

In: areas of a part, the constraints of the intent, and the object's outline. Out: the remaining
areas with their aims; areas of which nothing remains are dropped. Distances are free gaps between the object and the
reference, seen from above.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import (
    BESIDE,
    SIDES,
    Region,
    ViewerFrame,
    beside_area,
    corner_directions,
    edge_at,
    edge_directions,
    outline,
    regions,
)
from dcap.geometry.placement.polygons import area_without, clipped, clipped_half_plane, grown, swept
from dcap.scene.types.choices import RegionConstraint
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.surroundings import PART, boxes_of, reference_frame

MIDDLES = frozenset({"center", "middle"})
RIM = frozenset({"edge", "end"})
"""Regions of a constraint whose reference says which edge."""
TOLERANCE = 0.015
"""Tolerance of a distance [m]: places are searched on a grid."""
AWAY, AWAY_FROM_EDGE = 0.5, 0.1
"""Least distance for "away from" a thing, and from an edge, if there is room [m]."""
SPOT = 1e-5
"""Area below which there is no room [m^2]: rounding."""
SAME_LEVEL = 0.05
"""Distance below the chosen part at which an excluded part is no obstacle on it [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Bounds:
    """A part, and the object that goes on it, to which areas are cut."""

    scene: Segmentation
    base: Instance
    index: int
    """The part."""
    frame: ViewerFrame
    footprint: Array
    """Corners of the object's outline from its origin [m], shape (k, 2)."""
    reach: Array
    """Half extents of the object along the frame's right and front [m], shape (2,)."""
    height: float
    """Of the object [m]."""


def constrained(areas: Sequence[Region], constraints: Sequence[RegionConstraint], bounds: Bounds) -> list[Region]:
    """The remaining areas in their order, each with its aim."""
    left = list(areas)
    for one in sorted(constraints, key=lambda one: one.kind in ("farthest", "nearest")):
        left = [cut for area in left for cut in cut_to(area, one, bounds) if len(cut.polygon) >= 3]
    near, far = (
        [ring for one in constraints if one.kind == kind for ring in rings_of(one, bounds)]
        for kind in ("nearest", "farthest")
    )
    left.sort(key=lambda area: round(distance(area.target, near), 3) if near else 0.0)
    left.sort(key=lambda area: -round(distance(area.target, far), 3) if far else 0.0)
    return [area for area in left if has_room(area)]


def cut_to(area: Region, one: RegionConstraint, bounds: Bounds) -> list[Region]:
    """An area under one constraint; a distance from an unspecified edge gives an area for each edge."""
    if one.kind == "not_on":
        return [with_exclusions(area, [swept(ring, bounds.footprint) for ring in barred_rings(one, bounds)])]
    if one.kind == "not_in":
        return [with_exclusions(area, barred_areas(one, bounds))]
    if not one.reference or RIM.intersection(one.regions):
        return from_edges(area, one, bounds)
    rings = [swept(ring, bounds.footprint) for ring in rings_of(one, bounds)]
    if one.kind in ("farthest", "nearest"):
        return [with_aim(area, one.kind, rings_of(one, bounds), bounds)]
    if one.kind == "away":
        far = with_exclusions(area, [grown(ring, AWAY) for ring in rings])
        return [
            far if has_room(far) else with_aim(with_exclusions(area, rings), "farthest", rings_of(one, bounds), bounds)
        ]
    return from_things(area, one, rings)


def from_things(area: Region, one: RegionConstraint, rings: Sequence[Array]) -> list[Region]:
    """An area at a minimum or maximum distance from things, or at an exact distance from one of several things."""
    assert one.metres is not None
    if one.kind == "at_least":
        return [with_exclusions(area, [grown(ring, one.metres) for ring in rings])]
    nearest, found = max(one.metres - TOLERANCE, 0.0), []
    for ring in rings:
        off = [grown(ring, nearest)] if one.kind == "exactly" and nearest > 0.0 else [ring]
        within = clipped(area.polygon, grown(ring, one.metres + TOLERANCE))
        target, line = area.target, grown(ring, one.metres)
        if one.kind == "exactly" or len(clipped(line, grown(target[None], SPOT))) < 3:
            target = nearest_on(line, area)
        cut = replace(area, polygon=within, target=target)
        found.append(with_exclusions(cut, [*off, *(other for other in rings if other is not ring)]))
    return found


def from_edges(area: Region, one: RegionConstraint, bounds: Bounds) -> list[Region]:
    """An area at a distance from an edge, a corner or an end of the part, or from the edge at a thing; from all edges
    if no single edge is meant."""
    frame, sides = bounds.frame, [SIDES[name] for name in one.regions if name in SIDES]
    if MIDDLES.intersection(one.regions) and one.metres is not None:  # from middle to middle
        return from_things(area, one, [grown(frame.center[None], 0.0)])
    if "corner" in one.regions:
        spots = [frame.world(np.array(d, dtype=float))[None] for d in corner_directions(sides)]
        rings = [swept(np.repeat(spot, 3, axis=0), bounds.footprint) for spot in spots]
        return from_things(area, one, rings) if one.metres is not None else [with_exclusions(area, rings)]
    edges = [(x, 0) for x, _ in sides if x] + [(0, y) for _, y in sides if y]
    if one.reference and not edges and (boxes := boxes_of(bounds.scene, bounds.base, one.reference)):
        edges = [edge_at(frame, boxes, one.regions)]
    edges = edges or edge_directions(frame, [name for name in one.regions if name not in SIDES])
    if one.kind in ("exactly", "at_most"):
        return [cut_to_band(area, [edge], one, bounds) for edge in edges]
    return [cut_to_band(area, edges, one, bounds)]


def cut_to_band(area: Region, edges: Sequence[tuple[int, int]], one: RegionConstraint, bounds: Bounds) -> Region:
    """The area in which the object's free gap to each of these edges is as requested; an exact gap becomes the aim."""
    polygon, target, frame = area.polygon, area.target, bounds.frame
    for x, y in edges:
        axis, sign = (0, x) if x else (1, y)
        outward = sign * (frame.right, frame.front)[axis]
        half, reach = float(frame.half[axis]), float((bounds.footprint @ outward).max())
        metres = one.metres if one.metres is not None else min(AWAY_FROM_EDGE, 0.5 * max(half - reach, 0.0))
        at = frame.center + outward * (half - reach - metres)
        missing = float((at - target) @ outward)
        if one.kind == "exactly" or (one.kind == "at_most" and missing > 0.0):
            target = target + outward * missing
        if one.kind != "at_most":
            slack = TOLERANCE if one.kind == "exactly" else 0.0
            polygon = clipped_half_plane(polygon, at + slack * outward, outward)
        if one.kind in ("exactly", "at_most") and len(polygon) >= 3:
            polygon = clipped_half_plane(polygon, at - TOLERANCE * outward, -outward)
        if len(polygon) < 3:
            break
    return aimed_inside(replace(area, polygon=polygon, target=target))


def nearest_on(ring: Array, area: Region) -> Array:
    """The place on a ring (k, 2), inside an area where possible, that is nearest to its aim [m], shape (2,)."""
    places = np.linspace(ring, np.roll(ring, -1, axis=0), 17)[:-1].reshape(-1, 2)
    inside = [place for place in places if len(clipped(area.polygon, grown(place[None], SPOT))) >= 3]
    places = np.array(inside) if inside else places
    return np.asarray(places[np.linalg.norm(places - area.target, axis=1).argmin()])


def with_aim(area: Region, kind: str, rings: Sequence[Array], bounds: Bounds) -> Region:
    """The area with its aim farthest from, or nearest to, things: a corner of it, as distances grow outwards."""
    kept = 1.0 - bounds.reach / np.maximum(bounds.frame.half, 1e-9)
    inner = outline(bounds.frame)
    if (kept > 0.0).all():
        inner = bounds.frame.world(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * kept)
    room = clipped(area.polygon, inner)
    corners = room if len(room) >= 3 else area.polygon
    edges = np.linspace(corners, np.roll(corners, -1, axis=0), 9)[:-1].reshape(-1, 2)
    away = np.array([distance(point, rings) for point in edges])
    best = edges[int(np.argmax(np.round(away if kind == "farthest" else -away, 6)))]
    return replace(area, target=best)


def distance(point: Array, rings: Sequence[Array]) -> float:
    """From a point to the nearest of rings, by the middles of their corners and sides [m]."""
    along = np.concatenate([np.linspace(ring, np.roll(ring, -1, axis=0), 9).reshape(-1, 2) for ring in rings])
    return float(np.linalg.norm(along - point, axis=1).min())


def aimed_inside(area: Region) -> Region:
    """The area with its aim moved onto the remaining part."""
    if len(area.polygon) < 3:
        return area
    edges = np.linspace(area.polygon, np.roll(area.polygon, -1, axis=0), 17)[:-1].reshape(-1, 2)
    points = np.concatenate([edges, area.polygon.mean(axis=0)[None]])
    inner = clipped(area.polygon, grown(area.target[None], 2e-3))
    if len(inner) >= 3:
        return area
    return replace(area, target=points[int(np.argmin(np.linalg.norm(points - area.target, axis=1)))])


def with_exclusions(area: Region, rings: Sequence[Array]) -> Region:
    """The area with further rings excluded."""
    return replace(area, excluded=(*area.excluded, *rings))


def has_room(area: Region) -> bool:
    """Return whether a part of the area is not excluded."""
    return len(area.polygon) >= 3 and area_without(area.polygon, area.excluded) > SPOT


# references -----------------------------------------------------------------------------------------------------


def rings_of(one: RegionConstraint, bounds: Bounds) -> list[Array]:
    """The plans of a constraint's references [m], shape (4, 2) each."""
    return [box.corners[:4, :2] for box in boxes_of(bounds.scene, bounds.base, one.reference)]


def barred_rings(one: RegionConstraint, bounds: Bounds) -> list[Array]:
    """The plans of excluded things; among parts, only those that obstruct the chosen part."""
    boxes, top = boxes_of(bounds.scene, bounds.base, one.reference), bounds.base.parts[bounds.index].box.top
    if one.reference.startswith(PART):  # not a board above or below the object
        boxes = [box for box in boxes if top - SAME_LEVEL < box.top and box.bottom < top + bounds.height]
    return [box.corners[:4, :2] for box in boxes]


def barred_areas(one: RegionConstraint, bounds: Bounds) -> list[Array]:
    """The areas of regions that exclude the object's middle."""
    if not one.reference:
        return [area.polygon for area in regions(bounds.frame, one.regions, [], bounds.reach)]
    relation = next((name for name in one.regions if name in BESIDE), "near")
    view = reference_frame(bounds.scene, bounds.base, (one.reference,), one.regions) or bounds.frame
    radius = float(bounds.reach.max())
    farther = AWAY if any(name in SIDES for name in one.regions) else 0.0  # in front of it is more than next to it
    return [
        beside_area(view, relation, one.regions, [box], radius, farther)[0]
        for box in boxes_of(bounds.scene, bounds.base, one.reference)
    ]
