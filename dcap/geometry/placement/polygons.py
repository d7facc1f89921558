"""Convex polygons in the plane, as arrays of their corners; the geometry is computed by shapely.

In and out: rings of corners (k, 2) [m], counter-clockwise, the first corner not repeated. Rings built here begin at
their leftmost corner (the lowest of several), so that equal polygons have equal arrays.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from dcap.arrays import Array

DIGITS = 9
"""Corners nearer than a nanometre are the same, so that rounding creates no corners [decimals of a metre]."""
LEAST_RADIUS = 1e-3
"""Least radius of discs [m], so that their hull has an area."""
QUARTER = 4
"""Corners of a disc per quarter of a turn [-]."""
SAME_AREA = 1e-6
"""Rectangles whose areas differ by less than this share are equally small [-]."""


def counter_clockwise(polygon: Array) -> Array:
    """The same ring, counter-clockwise."""
    return polygon if shapely.is_ccw(shapely.linearrings(polygon)) else polygon[::-1].copy()


def ring_of(shape: shapely.Geometry) -> Array:
    """The corners of a polygon without holes, shape (k, 2); empty for a shape without area."""
    if shape.geom_type != "Polygon" or shape.is_empty:
        return np.zeros((0, 2))
    # a normalised ring is closed, clockwise and begins at its leftmost corner
    return np.asarray(shapely.get_coordinates(shapely.normalize(shape))[:0:-1])


def convex_hull(points: Array) -> Array:
    """Convex hull of points (n, 2), shape (k, 2)."""
    return ring_of(shapely.convex_hull(shapely.multipoints(np.round(points, DIGITS))))


def grown(points: Array, distance: float) -> Array:
    """Convex hull of discs about points (n, 2) as 16-gons [m], shape (k, 2)."""
    discs = shapely.buffer(shapely.points(points), max(distance, LEAST_RADIUS), quad_segs=QUARTER)
    return convex_hull(shapely.get_coordinates(discs))


def swept(ring: Array, footprint: Array) -> Array:
    """Region (m, 2) that the origin of a footprint (k, 2) must avoid for the footprint to stay off a convex ring (n,
    2)."""
    return convex_hull((ring[:, None] - footprint[None]).reshape(-1, 2))


def area_without(polygon: Array, holes: Sequence[Array]) -> float:
    """Area of a polygon minus the parts covered by other polygons [m^2]."""
    rings = [shapely.Polygon(one) for one in holes if len(one) >= 3]
    return float(shapely.area(shapely.difference(shapely.Polygon(polygon), shapely.union_all(rings))))


def clipped(polygon: Array, window: Array) -> Array:
    """Intersection of two convex polygons, shape (k, 2)."""
    if len(polygon) < 3 or len(window) < 3:
        return np.zeros((0, 2))
    return ring_of(shapely.intersection(shapely.Polygon(polygon), shapely.Polygon(window)))


def clipped_half_plane(polygon: Array, point: Array, outward: Array) -> Array:
    """Part of a convex polygon behind the line through a point across `outward`, shape (k, 2)."""
    away = outward / np.linalg.norm(outward)
    along = np.array([-away[1], away[0]])
    reach = 2.0 * float(np.linalg.norm(polygon - point, axis=1).max(initial=0.0)) + 1.0
    behind = np.array([reach * along, reach * (along - away), -reach * (along + away), -reach * along])
    return clipped(polygon, point + behind)


def gap_between(a: Array, b: Array) -> float:
    """Smallest distance between the boundaries of two polygons [m]."""
    return float(shapely.distance(shapely.linearrings(a), shapely.linearrings(b)))


def inside(polygon: Array, points: Array, *, margin: float = 1e-9) -> NDArray[np.bool_]:
    """Mask of the points (n, 2) in a convex polygon or within `margin` [m] of its boundary, shape (n,)."""
    area = shapely.buffer(shapely.Polygon(polygon), margin, join_style="mitre")
    shapely.prepare(area)
    return np.asarray(shapely.contains_xy(area, points))


def smallest_rectangle(points: Array) -> tuple[Array, Array]:
    """Long axis as a unit vector and extents, longer first [m], of the rectangle of least area about points (n, 2).

    It shares a direction with an edge of the hull (Freeman and Shapira 1975); among equally small rectangles, as for
    round things, the one along the hull's first such edge is taken, independently of the last digits.
    """
    ring = convex_hull(points)
    if len(ring) < 3:
        return _axis_of_line(points)
    edge = np.roll(ring, -1, axis=0) - ring
    along = edge / np.linalg.norm(edge, axis=1)[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    extents = np.stack([np.ptp(along @ ring.T, axis=1), np.ptp(across @ ring.T, axis=1)], axis=1)
    area = extents.prod(axis=1)
    first = int(np.argmax(area <= (1.0 + SAME_AREA) * area.min()))
    # for a square the two are equal up to rounding
    is_longer = extents[first, 0] >= (1.0 - SAME_AREA) * extents[first, 1]
    longer = along[first] if is_longer else across[first]
    return longer, np.sort(extents[first])[::-1]


def _axis_of_line(points: Array) -> tuple[Array, Array]:
    """The same for points on a line, or at a single spot."""
    ends = shapely.get_coordinates(shapely.convex_hull(shapely.multipoints(np.round(points, DIGITS))))
    way = ends[-1] - ends[0]
    length = float(np.linalg.norm(way))
    return (way / length, np.array([length, 0.0])) if length > 0.0 else (np.array([1.0, 0.0]), np.zeros(2))
