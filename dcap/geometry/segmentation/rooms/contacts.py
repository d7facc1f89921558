"""Contacts: sampled segments of a scene, and the places where two of them are close.

A scanned surface as surfels: small discs, one per voxel and side, independent of the triangles.

Scans have slivers, holes, doubled sheets and millions of faces. Queries here (upward surfaces, neighbours, areas) use
at most one disc per voxel and side [P00], with normals averaged over neighbours.

[P00] Pfister, Zwicker, van Baar, Gross: Surfels: surface elements as rendering primitives. SIGGRAPH 2000.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError, cKDTree

from dcap.arrays import Array, IntArray
from dcap.geometry.segmentation.faces import FaceTable, surface_points

SPACING = 0.015
"""Spacing of the points that represent surfaces [m]."""
REACH = 0.02
"""Largest distance of touching surfaces [m]: more than the spacing of the points, and than the gaps in scans between
things."""
FEW = 3
"""Least number of pairs of points in a contact [-]."""
UP = 0.7
"""Least normal z of a surface that carries things [-]."""
PARALLEL = 0.95
"""Cosine of the angle between normals of one plane [-]."""
FLUSH = 0.004
"""Largest distance of flush surfaces from a common plane [m]."""
ON_TOP = 0.03
"""Largest depth below the top of another segment at which a segment above it may begin [m]."""
SINK = 0.012
"""Largest depth below the surface of its support at which a segment on it may lie [m]: noise, and soft covers."""
VOXEL = 0.02
"""Edge of a voxel [m]: the resolution of scans, and finer than carrying surfaces."""
NEAR = 2.25 * VOXEL
"""Largest distance of neighbouring surfels [m]: the next voxel but one, to bridge a missing voxel."""
SIDE = 0.5
"""Least normal z of an upward surfel, and its negative for a downward one [-]."""
SAME_SIDE = 0.3
"""Least cosine for a neighbour's normal to be included in an average [-]."""
ROUNDS = 2
"""Rounds of averaging [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Touch:
    """Pairs of points of two segments that are close."""

    a: IntArray
    """Points of the first segment, shape (k,)."""
    b: IntArray
    """Points of the second segment, shape (k,)."""

    def turned(self) -> "Touch":
        """The same contact seen from the other segment."""
        return Touch(self.b, self.a)


@dataclass(eq=False, slots=True)
class Segment:
    """A connected patch of surface, or several that belong together; merging modifies it."""

    faces: IntArray
    points: IntArray
    area: float
    """Area [m^2]."""
    center: Array
    """Centre of the area [m], shape (3,)."""
    low: Array
    high: Array
    touches: dict[int, Touch] = field(default_factory=dict)
    """Contacts by index of the other segment."""


@dataclass(eq=False, slots=True)
class Segments:
    """All segments by index, over a common set of points."""

    position: Array
    """Positions of the points [m], shape (n, 3)."""
    normal: Array
    """Unit normals, shape (n, 3)."""
    weight: Array
    """Area represented by each point [m^2], shape (n,)."""
    alive: dict[int, Segment]

    def merge(self, keep: int, gone: int) -> None:
        """Merge two segments into one, under the first index."""
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
        """Mask of the touching pairs at which the first segment stands on the second, shape (k,).

        There the first segment is above the second, where that faces up, or at its very top, since carried things hide
        the upward surface.
        """
        touch = self.alive[name].touches[other]
        above = self.position[touch.a, 2] >= self.position[touch.b, 2] - SINK
        on_top = self.alive[name].low[2] > self.alive[other].high[2] - ON_TOP
        above &= self.position[touch.a, 2] < self.alive[name].center[2]
        return np.asarray(above & (on_top | (self.normal[touch.b, 2] > UP)))

    def sideways(self, touch: Touch) -> NDArray[np.bool_]:
        """Mask of the pairs that lie against each other sideways, shape (k,)."""
        a, b = self.normal[touch.a, 2], self.normal[touch.b, 2]
        return np.asarray((np.abs(a) <= UP) & (np.abs(b) <= UP))

    def flush(self, touch: Touch) -> NDArray[np.bool_]:
        """Mask of the pairs that lie in one plane, shape (k,)."""
        a, b = self.normal[touch.a], self.normal[touch.b]
        apart = np.einsum("ki,ki->k", self.position[touch.a] - self.position[touch.b], b)
        return np.asarray((np.einsum("ki,ki->k", a, b) > PARALLEL) & (np.abs(apart) < FLUSH))


def segments_of(table: FaceTable, segment: IntArray) -> Segments:
    """Sample the faces with `segment` >= 0, shape (m,), and find their contacts."""
    used = np.flatnonzero(segment >= 0)
    if not len(used):  # an empty room, or one with only known things
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


def _by_number(segment: IntArray, used: IntArray, number: IntArray) -> tuple[list[int], list[IntArray], list[IntArray]]:
    names = np.unique(segment[used])
    faces = used[np.argsort(segment[used], kind="stable")]
    points = np.argsort(number, kind="stable")
    return (
        names.tolist(),
        np.split(faces, np.searchsorted(segment[faces], names)[1:]),
        np.split(points, np.searchsorted(number[points], names)[1:]),
    )


def _touch(segments: Segments, number: IntArray) -> None:
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
    """The convex hull of points seen from above; None if they lie on a line."""
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
    """Area of the convex hull of points, seen along the direction of their least extent [m^2].

    Touching bodies hide their contact from cameras, so it is missing in scans: its rim represents all of it.
    """
    if len(points) < 3:
        return 0.0
    middle = points.mean(axis=0)
    axes = np.linalg.eigh((points - middle).T @ (points - middle))[1][:, :0:-1]
    return plan_area((points - middle) @ axes)


def inner_distance(points: Array, place: Array) -> float:
    """Distance of a place inside the convex hull of points, seen from above [m]; negative: outside, or no hull."""
    hull = plan_hull(points)
    if hull is None:
        return -1.0
    return -float((hull.equations[:, :2] @ place[:2] + hull.equations[:, 2]).max())


def all_of(parts: Iterable[IntArray]) -> IntArray:
    """The concatenation of several arrays, empty for none."""
    found = list(parts)
    return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, eq=False, slots=True)
class Surfels:
    """Discs that represent a surface."""

    position: Array
    """Positions [m], shape (n, 3)."""
    normal: Array
    """Unit normals averaged over neighbours, shape (n, 3)."""
    area: Array
    """Areas [m^2], shape (n,)."""
    lab: Array
    """Mean colour in CIELAB, shape (n, 3)."""
    pairs: IntArray
    """Pairs of neighbours, shape (e, 2)."""
    face: IntArray
    """Faces represented by the surfels, one entry per sample of the surface, shape (k,)."""
    of_sample: IntArray
    """The surfel of each sample, shape (k,)."""
    sample_area: Array
    """Area represented by a sample [m^2], shape (k,)."""

    def faces_of(self, owner: IntArray, count: int) -> IntArray:
        """Owner of each of `count` faces, from the owner of most of its surface, -1 for none; `owner` of shape (n,),
        -1: none.

        Shape (count,).
        """
        mine = owner[self.of_sample]
        most = int(owner.max(initial=-1)) + 2
        key, inverse = np.unique(self.face * most + mine + 1, return_inverse=True)
        area = np.bincount(inverse, self.sample_area, len(key))
        order = np.lexsort((-area, key // most))
        first = np.r_[True, np.diff(key[order] // most) > 0] if len(key) else np.zeros(0, dtype=bool)
        best = key[order][first]
        result = np.full(count, -1, dtype=np.int64)
        result[best // most] = best % most - 1
        return result


def surfels_of(table: FaceTable, faces: IntArray) -> Surfels:
    """Surfels of the given faces, shape (f,)."""
    points, owner = surface_points(table.corners[faces], table.area[faces], VOXEL)
    face = faces[owner]
    weight = table.area[face] / np.bincount(owner, minlength=len(faces))[owner] + 1e-15
    number = _numbers(points, table.normal[face])
    total = np.bincount(number, weight).astype(np.float64)
    position = _mean(number, weight, points) / total[:, None]
    normal = _unit(_mean(number, weight, table.normal[face]))
    lab = _mean(number, weight, table.lab[face]) / total[:, None]
    pairs = cKDTree(position).query_pairs(NEAR, output_type="ndarray").astype(np.int64)
    return Surfels(position, _averaged(normal, total, pairs), total, lab, pairs, face, number, weight)


def _numbers(points: Array, normal: Array) -> IntArray:
    """A number per voxel and side, shape (k,)."""
    if not len(points):
        return np.zeros(0, dtype=np.int64)
    cell = np.floor(points / VOXEL).astype(np.int64)
    cell -= cell.min(axis=0)
    size = cell.max(axis=0) + 1
    side = np.where(normal[:, 2] > SIDE, 0, np.where(normal[:, 2] < -SIDE, 1, 2))
    key = ((cell[:, 0] * size[1] + cell[:, 1]) * size[2] + cell[:, 2]) * 3 + side
    return np.asarray(np.unique(key, return_inverse=True)[1], dtype=np.int64).reshape(-1)


def _mean(number: IntArray, weight: Array, values: Array) -> Array:
    """Weighted sums of rows (k, 3) per number, shape (n, 3)."""
    return np.stack([np.bincount(number, weight * values[:, axis]) for axis in range(3)], axis=1)


def _averaged(normal: Array, area: Array, pairs: IntArray) -> Array:
    """Normals averaged over neighbours with similar normals, shape (n, 3)."""
    a, b = np.r_[pairs[:, 0], pairs[:, 1]], np.r_[pairs[:, 1], pairs[:, 0]]
    alike = np.einsum("ki,ki->k", normal[a], normal[b]) > SAME_SIDE
    a, b = a[alike], b[alike]
    result = normal
    for _ in range(ROUNDS):
        total = area[:, None] * result
        for axis in range(3):
            total[:, axis] += np.bincount(a, area[b] * result[b, axis], len(normal))
        result = _unit(total)
    return result


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30))
