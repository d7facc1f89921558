"""Contacts: segments of a scene, sampled, and the places where two of them are close."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from dcap.geometry.segmentation.faces import FaceTable, surface_points

Array = NDArray[np.float64]
Index = NDArray[np.int64]

SPACING = 0.015
"""Distance of the points that stand for surfaces [m]."""
REACH = 0.02
"""Surfaces nearer than this touch [m]: more than the spacing of the points, and what scans leave between things."""
FEW = 3
"""Fewer pairs of points are no contact [-]."""
UP = 0.7
"""A surface with a normal of at least this z carries what stands on it [-]."""
PARALLEL = 0.95
"""Cosine of the angle between normals of one plane [-]."""
FLUSH = 0.004
"""Surfaces nearer than this to a common plane are flush [m]."""
ON_TOP = 0.03
"""Segments that begin no deeper than this below the top of another one are above it [m]."""
SINK = 0.012
"""Segments that stand on something are nowhere deeper below its surface than this [m]: noise, and soft covers."""


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """Pairs of points of two segments that are close."""

    a: Index
    """Points of the first segment, shape (k,)."""
    b: Index
    """Points of the second one, shape (k,)."""

    def turned(self) -> "Touch":
        """Seen from the other side."""
        return Touch(self.b, self.a)


@dataclass(eq=False, slots=True)
class Segment:
    """A connected patch of surface, or several that belong together; merging changes it."""

    faces: Index
    points: Index
    area: float
    """[m^2]."""
    center: Array
    """Centre of the area [m], shape (3,)."""
    low: Array
    high: Array
    touches: dict[int, Touch] = field(default_factory=dict)
    """By number of the other segment."""


@dataclass(eq=False, slots=True)
class Segments:
    """All segments by number, over one set of points."""

    position: Array
    """[m], shape (n, 3)."""
    normal: Array
    """Unit normals, shape (n, 3)."""
    weight: Array
    """Area that a point stands for [m^2], shape (n,)."""
    alive: dict[int, Segment]

    def merge(self, keep: int, gone: int) -> None:
        """Make two segments one, under the first number."""
        a, b = self.alive[keep], self.alive.pop(gone)
        whole = a.area + b.area
        a.center = (a.center * a.area + b.center * b.area) / max(whole, 1e-30)
        a.area, a.faces, a.points = whole, np.concatenate([a.faces, b.faces]), np.concatenate([a.points, b.points])
        a.low, a.high = np.minimum(a.low, b.low), np.maximum(a.high, b.high)
        a.touches.pop(gone, None)
        for other, touch in b.touches.items():
            if other == keep:
                continue
            mine = a.touches.get(other)
            joined = (
                touch if mine is None else Touch(np.concatenate([mine.a, touch.a]), np.concatenate([mine.b, touch.b]))
            )
            a.touches[other] = joined
            neighbour = self.alive[other]
            del neighbour.touches[gone]
            neighbour.touches[keep] = joined.turned()

    def standing(self, name: int, other: int) -> NDArray[np.bool_]:
        """Which of the touching pairs are the first segment standing on the second, shape (k,).

        They are above it, where it looks up or, since what it carries hides that, at its very top.
        """
        touch = self.alive[name].touches[other]
        above = self.position[touch.a, 2] >= self.position[touch.b, 2] - SINK
        on_top = self.alive[name].low[2] > self.alive[other].high[2] - ON_TOP
        above &= self.position[touch.a, 2] < self.alive[name].center[2]
        return np.asarray(above & (on_top | (self.normal[touch.b, 2] > UP)))

    def sideways(self, touch: Touch) -> NDArray[np.bool_]:
        """Which of the pairs lie against each other sideways, shape (k,)."""
        a, b = self.normal[touch.a, 2], self.normal[touch.b, 2]
        return np.asarray((np.abs(a) <= UP) & (np.abs(b) <= UP))

    def flush(self, touch: Touch) -> NDArray[np.bool_]:
        """Which of the pairs lie in one plane, shape (k,)."""
        a, b = self.normal[touch.a], self.normal[touch.b]
        apart = np.einsum("ki,ki->k", self.position[touch.a] - self.position[touch.b], b)
        return np.asarray((np.einsum("ki,ki->k", a, b) > PARALLEL) & (np.abs(apart) < FLUSH))


def segments_of(table: FaceTable, segment: Index) -> Segments:
    """Sample the faces with `segment` >= 0, shape (m,), and find what touches."""
    used = np.flatnonzero(segment >= 0)
    if not len(used):  # a bare room, or one of which everything is known
        return Segments(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), {})
    position, owner = surface_points(table.corners[used], table.area[used], SPACING)
    face = used[owner]
    weight = table.area[face] / np.bincount(face, minlength=len(segment))[face]
    number = segment[face]
    result = Segments(position, table.normal[face], weight, {})
    for name, faces, points in zip(*_by_number(segment, used, number), strict=True):
        corners = table.corners[faces].reshape(-1, 3)
        area = float(table.area[faces].sum())
        center = np.average(table.center[faces], axis=0, weights=np.maximum(table.area[faces], 1e-15))
        result.alive[name] = Segment(faces, points, area, center, corners.min(axis=0), corners.max(axis=0))
    _touch(result, number)
    return result


def _by_number(segment: Index, used: Index, number: Index) -> tuple[list[int], list[Index], list[Index]]:
    names = np.unique(segment[used])
    faces = used[np.argsort(segment[used], kind="stable")]
    points = np.argsort(number, kind="stable")
    return (
        names.tolist(),
        np.split(faces, np.searchsorted(segment[faces], names)[1:]),
        np.split(points, np.searchsorted(number[points], names)[1:]),
    )


def _touch(segments: Segments, number: Index) -> None:
    """Fill in the touches of all pairs of segments."""
    near = cKDTree(segments.position).query_pairs(REACH, output_type="ndarray").astype(np.int64)
    near = near[number[near[:, 0]] != number[near[:, 1]]]
    swap = number[near[:, 0]] > number[near[:, 1]]
    near[swap] = near[swap][:, ::-1]
    key = number[near[:, 0]] * (int(number.max(initial=0)) + 1) + number[near[:, 1]]
    order = np.lexsort((near[:, 1], near[:, 0], key))
    near, key = near[order], key[order]
    for block in np.split(near, np.flatnonzero(np.diff(key)) + 1):
        if len(block):
            touch = Touch(block[:, 0], block[:, 1])
            a, b = int(number[block[0, 0]]), int(number[block[0, 1]])
            segments.alive[a].touches[b] = touch
            segments.alive[b].touches[a] = touch.turned()


def plan_hull(points: Array) -> ConvexHull | None:
    """The convex hull of points seen from above; None where they lie on a line."""
    if len(points) < 3:
        return None
    try:
        return ConvexHull(points[:, :2])
    except QhullError:
        return None


def plan_area(points: Array) -> float:
    """Area of the convex hull seen from above [m^2]."""
    hull = plan_hull(points)
    return 0.0 if hull is None else float(hull.volume)


def patch_area(points: Array) -> float:
    """Area of the convex hull of points, seen along the direction in which they extend least [m^2].

    What bodies that touch hide from cameras is missing in scans: the rim of a contact stands for all of it.
    """
    if len(points) < 3:
        return 0.0
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, :0:-1]
    return plan_area((points - middle) @ axes)


def inner_distance(points: Array, place: Array) -> float:
    """How far inside the convex hull of points, seen from above, a place is [m]; negative: outside, or no hull."""
    hull = plan_hull(points)
    if hull is None:
        return -1.0
    return -float((hull.equations[:, :2] @ place[:2] + hull.equations[:, 2]).max())


def all_of(parts: Iterable[Index]) -> Index:
    """One array of several, empty for none."""
    found = list(parts)
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)
