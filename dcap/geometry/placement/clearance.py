"""How far an object hovers over a scene, and where the two cut through each other.

In: an object, a scene, and where the object's origin goes. Out: the smallest vertical gap along gravity, and points at
which an edge of one goes through a face of the other. Between two surfaces of triangles the smallest gap lies under a
vertex of the upper, over a vertex of the lower, or where two edges cross in plan: vertices are looked at exactly, edges
at samples that are refined around the closest. Two surfaces that cut through each other do so along lines whose ends
lie on edges: rays along the edges find them all.

The start over a support: the best spot at which an object hovers with exact clearance and cuts through nothing.

In: an object over a scene, sampled (`PlacementSearch`) and exact (`Clearance`), and the areas to try. Out: the spot
nearest to an area's aim, and the height there. The samples propose; the meshes decide. Where they cut through each
other, what the samples missed is added to them, and they propose again.
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
"""Distance of the samples along edges [m]; with slopes up to 1 the gap is known to this before it is refined."""
MOST_SAMPLES = 200_000
"""Samples on edges; an object with more is sampled more coarsely."""
CLOSEST, FINER = 32, 40
"""Number of the closest samples that are refined, and parts of a step that each is refined into on both sides."""
DOWN, UP = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)
LEVEL = 0.7
"""Least share with which a level place is searched before an uneven one is taken [-]."""
PASSES = (
    (SHARES[0], True, True),
    *((share, True, False) for share in SHARES if share >= LEVEL),
    *((share, False, False) for share in SHARES),
)
"""Supported share of the underside, whether the support must be level there, and the place steady; best first."""
EXACT = 1e-5
"""How near the gap comes to what is asked [m]."""
ROUNDS = 3
"""A gap is measured, corrected and measured again; the second time it is right unless something is in the way."""
ALIKE = 0.05
"""Distances from the aim that differ by less than this are alike [m]: any of four corners, the viewer's first."""
PATIENCE = 2
"""Failed spots after which the neighbourhood that is left out around the next one grows by one sample [-]."""


class Clearance:
    """One object over one scene: both prepared once, then asked for places of the object's origin."""

    def __init__(
        self, item: Mesh, scene: Mesh, caster: Raycaster, edges: tuple[Array, Array] | None = None
    ) -> None:  # fmt: skip
        """`caster`: of the scene. `edges`: those of the item, where they are known already (see `edges_of`)."""
        self.item_caster, self.caster = Raycaster(item), caster
        self.bounds = item.bounds
        self.vertices = item.vertices[np.unique(item.faces)]
        self.start, self.edge = edges_of(item) if edges is None else edges
        self.scene = scene
        self.corner = scene.triangles
        self.low, self.high = self.corner.min(axis=1), self.corner.max(axis=1)

    def gap(self, place: Array) -> float:
        """Smallest vertical distance down from the object to the scene [m]; inf where nothing is below it."""
        along = self._along_edges(place)
        return min(self._down(self.vertices + place), self._up(place), along)

    def cuts(self, place: Array) -> tuple[Array, NDArray[np.int64]]:
        """Where object and scene go through each other: points [m], shape (k, 3), and faces of the scene, (k,)."""
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
        """Smallest way down from points to the scene [m]."""
        return float(self.caster.cast(points, np.tile(DOWN, (len(points), 1))).distance.min(initial=np.inf))

    def _up(self, place: Array) -> float:
        """Smallest way up from the scene's vertices below the object [m]."""
        low, high = self.bounds + place
        points = self.scene.vertices
        beneath = ((points[:, :2] >= low[:2]) & (points[:, :2] <= high[:2])).all(axis=1) & (points[:, 2] < high[2])
        points = points[beneath] - place
        return float(self.item_caster.cast(points, np.tile(UP, (len(points), 1))).distance.min(initial=np.inf))

    def _along_edges(self, place: Array) -> float:
        """Smallest way down from the object's edges [m]."""
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
        """Way down from points on edges [m], shape (n,)."""
        points = self.start[which] + share[:, None] * self.edge[which] + place
        return self.caster.cast(points, np.tile(DOWN, (len(points), 1))).distance


def edges_of(mesh: Mesh) -> tuple[Array, Array]:
    """Each edge once: where it starts and how it goes [m], shape (n, 3) each."""
    corner = mesh.triangles
    a, b = corner.reshape(-1, 3), np.roll(corner, -1, axis=1).reshape(-1, 3)
    swap = (a > b)[np.arange(len(a)), np.argmax(a != b, axis=1)]
    pair: Array = np.unique(np.where(swap[:, None], np.c_[b, a], np.c_[a, b]), axis=0)
    edge = pair[:, 3:] - pair[:, :3]
    kept = np.any(edge != 0.0, axis=1)
    return pair[kept, :3], edge[kept]


def ends(caster: Raycaster, start: Array, edge: Array) -> tuple[Array, NDArray[np.int64], NDArray[np.int64]]:
    """Where edges meet a mesh [m], shape (k, 3), on which of its faces, (k,), and which edges these are, (k,)."""
    hits = caster.cast(start, edge)  # edges instead of unit directions: they end at distance 1
    met = np.flatnonzero(hits.distance <= 1.0)
    return hits.position[met], hits.face[met].astype(np.int64), met


@dataclass(frozen=True, slots=True)
class Start:
    """Where the object starts."""

    region: Region
    """The area it is in."""
    spot: Spot
    height: float
    """Of the object's origin [m]."""
    gap: float
    """Smallest vertical distance to what lies below, measured there [m]."""


def set_down(
    search: PlacementSearch, exact: Clearance, areas: Sequence[Region], gap: float, *, anywhere: bool = False
) -> Start | None:
    """The best supported free spot, a steady one if there is one nearby, or `anywhere` in the areas; of equally good
    ones the nearest to its area's aim, earlier areas first."""
    failed, before = 0, None
    for share, level, steady in PASSES:
        while (found := nearest(search, areas, share, level, steady, anywhere)) is not None:
            area, spot = found
            start = hover(search, exact, spot, gap)
            if start is not None:
                return Start(area, spot, *start)
            if steady and anywhere:
                break  # something is in the way at the steadiest place: the next passes look near the aim
            if spot == before:  # with all that is known now it looked free again, and is not
                search.exclude(spot, failed // PATIENCE)
                failed += 1
            before = spot
    return None


def nearest(
    search: PlacementSearch, areas: Sequence[Region], share: float, level: bool, steady: bool, anywhere: bool
) -> tuple[Region, Spot] | None:
    """Of each area's best spot the one nearest to its aim, the earlier area's if they are about as near."""
    best: tuple[int, Region, Spot] | None = None
    for area in areas:
        spot = search.find(area, share, level=level, steady=steady, anywhere=anywhere)
        if spot is not None:
            steps = round(float(np.hypot(*(area.target - (spot.x, spot.y)))) / ALIKE)
            if best is None or steps < best[0]:
                best = steps, area, spot
    return None if best is None else best[1:]


def hover(search: PlacementSearch, exact: Clearance, spot: Spot, gap: float) -> tuple[float, float] | None:
    """Height of the origin with the asked gap and the gap measured there [m]; None where something is in the way."""
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
