"""The gap between an object and the scene below it, and a start above its support without intersection.

In: an object, a scene, and the position of the object's origin. Out: the smallest vertical gap along gravity, and
points at which an edge of one goes through a face of the other. Between two surfaces of triangles the smallest gap lies
under a vertex of the upper surface, over a vertex of the lower surface, or where two edges cross in plan: vertices are
checked exactly, edges at samples that are refined around the closest. Two surfaces intersect along lines whose ends lie
on edges: rays along the edges find them all.

The start over a support: the best spot at which an object hovers with exact clearance and intersects nothing.

In: an object over a scene, sampled (`PlacementSearch`) and exact (`Clearance`), and the areas to try. Out: the spot
nearest to an area's aim, and the height there. The samples propose; the meshes decide. Where the meshes intersect, the
parts missed by the samples are added to them, and they propose again.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.search import SHARES, PlacementSearch, Spot
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

STEP = 0.002
"""Spacing of the samples along edges [m]; for slopes up to 1 the gap is known to this precision before it is
refined."""
MOST_SAMPLES = 200_000
"""Maximum number of samples on edges; an object with more is sampled more coarsely."""
CLOSEST, FINER = 32, 40
"""Number of the closest samples that are refined, and parts of a step that each is refined into on both sides."""
DOWN, UP = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
LEVEL = 0.7
"""Least share at which a level place is searched before an uneven one is accepted [-]."""
PASSES = (
    (SHARES[0], True, True),
    *((share, True, False) for share in SHARES if share >= LEVEL),
    *((share, False, False) for share in SHARES),
)
"""Supported share of the underside, and whether the support must be level there and the place steady; best first."""
EXACT = 1e-5
"""Tolerance of the requested gap [m]."""
ROUNDS = 3
"""Rounds of measuring and correcting a gap; it is right the second time unless something is in the way."""
ALIKE = 0.05
"""Distances from the aim that differ by less than this count as equal [m]: any of four corners, the viewer's first."""
PATIENCE = 2
"""Failed spots after which the excluded neighbourhood of the next one grows by one sample [-]."""


class Clearance:
    """An object over a scene, both prepared once and evaluated for positions of the object's origin."""

    def __init__(
        self, item: Mesh, scene: Mesh, caster: Raycaster, edges: tuple[Array, Array] | None = None
    ) -> None:  # fmt: skip
        """`caster`: ray caster of the scene. `edges`: edges of the item, if already known (see `edges_of`)."""
        self.item_caster, self.caster = Raycaster(item), caster
        self.bounds = item.bounds
        self.vertices = item.vertices[np.unique(item.faces)]
        self.start, self.edge = edges_of(item) if edges is None else edges
        self.scene = scene
        self.corner = scene.triangles
        self.low, self.high = self.corner.min(axis=1), self.corner.max(axis=1)

    def gap(self, place: Array) -> float:
        """Smallest vertical distance down from the object to the scene [m]; inf if nothing is below it."""
        along = self._along_edges(place)
        return min(self._down(self.vertices + place), self._up(place), along)

    def cuts(self, place: Array) -> tuple[Array, NDArray[np.int64]]:
        """Intersections of object and scene: points [m], shape (k, 3), and faces of the scene, (k,)."""
        point, face, _ = ends(self.caster, self.start + place, self.edge)
        near = self._near(place)
        corner = self.corner[near]
        start, edge = corner.reshape(-1, 3), (np.roll(corner, -1, axis=1) - corner).reshape(-1, 3)
        other, _, which = ends(self.item_caster, start - place, edge)
        return np.concatenate([point, other + place]), np.concatenate([face, near[which // 3]])

    def _near(self, place: Array) -> NDArray[np.int64]:
        """Faces of the scene whose box meets the object's, shape (k,)."""
        low, high = self.bounds + place
        return np.flatnonzero(((self.low <= high) & (self.high >= low)).all(axis=1))

    def _down(self, points: Array) -> float:
        """Smallest distance down from points to the scene [m]."""
        return float(self.caster.cast(points, np.tile(DOWN, (len(points), 1))).distance.min(initial=np.inf))

    def _up(self, place: Array) -> float:
        """Smallest distance up from the scene's vertices below the object [m]."""
        low, high = self.bounds + place
        points = self.scene.vertices
        beneath = ((points[:, :2] >= low[:2]) & (points[:, :2] <= high[:2])).all(axis=1) & (points[:, 2] < high[2])
        points = points[beneath] - place
        return float(self.item_caster.cast(points, np.tile(UP, (len(points), 1))).distance.min(initial=np.inf))

    def _along_edges(self, place: Array) -> float:
        """Smallest distance down from the object's edges [m]."""
        length = np.linalg.norm(self.edge, axis=1)
        step = max(STEP, float(length.sum()) / MOST_SAMPLES)
        count = np.ceil(length / step).astype(int) - 1
        which = np.repeat(np.arange(len(count)), count)
        if len(which) == 0:
            return np.inf
        number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 1
        share = number / (count[which] + 1)
        way = self._ways(which, share, place)
        closest = np.argsort(way, kind="stable")[:CLOSEST]
        finer = np.linspace(-1.0, 1.0, 2 * FINER + 1) / (count[which[closest]] + 1)[:, None]
        refined = np.clip(share[closest, None] + finer, 0.0, 1.0)
        return float(self._ways(np.repeat(which[closest], refined.shape[1]), refined.ravel(), place).min())

    def _ways(self, which: NDArray[np.int64], share: Array, place: Array) -> Array:
        """Distance down from points on edges [m], shape (n,)."""
        points = self.start[which] + share[:, None] * self.edge[which] + place
        return self.caster.cast(points, np.tile(DOWN, (len(points), 1))).distance


def edges_of(mesh: Mesh) -> tuple[Array, Array]:
    """Each edge once: start and vector [m], shape (n, 3) each."""
    corner = mesh.triangles
    a, b = corner.reshape(-1, 3), np.roll(corner, -1, axis=1).reshape(-1, 3)
    swap = (a > b)[np.arange(len(a)), np.argmax(a != b, axis=1)]
    pair: Array = np.unique(np.where(swap[:, None], np.c_[b, a], np.c_[a, b]), axis=0)
    edge = pair[:, 3:] - pair[:, :3]
    kept = np.any(edge != 0.0, axis=1)
    return pair[kept, :3], edge[kept]


def ends(caster: Raycaster, start: Array, edge: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Points where edges meet a mesh [m], shape (k, 3), the faces there, (k,), and the indices of the edges, (k,)."""
    hits = caster.cast(start, edge)  # edges instead of unit directions: they end at distance 1
    met = np.flatnonzero(hits.distance <= 1.0)
    return hits.position[met], hits.face[met].astype(np.int64), met


@dataclass(frozen=True, slots=True)
class Start:
    """Start of the object over its support."""

    region: Region
    """The area of the start."""
    spot: Spot
    height: float
    """Height of the object's origin [m]."""
    gap: float
    """Smallest vertical distance to the surface below, measured at the start [m]."""


def set_down(
    search: PlacementSearch, exact: Clearance, areas: Sequence[Region], gap: float, *, anywhere: bool = False
) -> Start | None:
    """The best supported free spot, preferably a steady one nearby, or `anywhere` in the areas; of equally good spots
    the nearest to its area's aim, earlier areas first."""
    failed, before = 0, None
    for share, level, steady in PASSES:
        while (found := nearest(search, areas, share, level, steady, anywhere)) is not None:
            area, spot = found
            start = hover(search, exact, spot, gap)
            if start is not None:
                return Start(area, spot, *start)
            if steady and anywhere:
                break  # the steadiest place is obstructed: the next passes search near the aim
            if spot == before:  # it still looks free with all added samples, but is not
                search.exclude(spot, failed // PATIENCE)
                failed += 1
            before = spot
    return None


def nearest(
    search: PlacementSearch, areas: Sequence[Region], share: float, level: bool, steady: bool, anywhere: bool
) -> tuple[Region, Spot] | None:
    """Among the best spots of the areas the one nearest to its aim; the earlier area's if they are about equally
    near."""
    best: tuple[int, Region, Spot] | None = None
    for area in areas:
        spot = search.find(area, share, level=level, steady=steady, anywhere=anywhere)
        if spot is not None:
            steps = round(float(np.hypot(*(area.target - (spot.x, spot.y)))) / ALIKE)
            if best is None or steps < best[0]:
                best = steps, area, spot
    return None if best is None else best[1:]


def hover(search: PlacementSearch, exact: Clearance, spot: Spot, gap: float) -> tuple[float, float] | None:
    """Height of the origin with the requested gap, and the gap measured there [m]; None if something is in the way."""
    place = np.array([spot.x, spot.y, search.start_height(spot) + gap])
    measured = exact.gap(place)
    for _ in range(ROUNDS):
        if abs(measured - gap) <= EXACT or not np.isfinite(measured):
            break
        place[2] += gap - measured
        measured = exact.gap(place)
    points, faces = exact.cuts(place)
    if len(points) or abs(measured - gap) > EXACT:
        search.add(points, faces)
        return None
    return float(place[2]), measured
