"""Search for places where an object fits on a surface, and the height above the surface at which it must start.

In: the scene, the mask of its faces that are the support, and the object in its orientation. Out: the spot nearest to a
requested point where the object's underside is over the support and nothing else is in the way, and the height of the
object there at contact.

The object's underside and the scene below it are sampled by vertical rays on the same grid, so that overhangs of the
object (the handle of a mug) may reach over lower neighbours. Rays may miss surfaces that are thinner than the grid or
upright: a caller that finds such a surface by measuring the meshes adds it (`add`) and searches again.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.polygons import inside, smallest_rectangle
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

HEADROOM = 0.012
"""Free height over the object during the search [m]: the clearance and some slack."""
STEPPED = 0.015
"""Largest lift of the object by its neighbours that does not count as an obstruction [m]: scan noise, seams."""
LOWEST = 0.08
"""Share of the height over the lowest point within which the underside must be supported [-]."""
SHARES = (0.97, 0.85, 0.7, 0.5)
"""Shares of the underside that should be over the support, best first; with less than half the object tips."""
DROP = 0.05
"""Depth of the support below the contact from which it does not carry [m]: a seat next to its arm, a lid in front of
its cistern; scans of soft things are less uneven."""
STEADY = float(np.tan(np.radians(4.0)))
"""Largest slope by which the object comes down at a steady place when it is moved slightly in any direction [-]: no
crest from which it rolls off, no slope down which it slides."""
MOVED = (0.25, 0.5, 1.0)
"""Distances by which it is moved to test that, in its larger horizontal extents [-]; much less would measure a scan's
noise."""
CIRCLE = np.c_[np.cos(np.radians(45.0 * np.arange(8))), np.sin(np.radians(45.0 * np.arange(8)))]
"""Directions all around, shape (8, 2)."""
CLOSE = 1e-3
"""Largest distance of points in contact [m]."""
NEARBY = 2.0
"""Distance from the aim within which a steady place is searched, in the same extents [-]."""
SAMPLES = 24
"""Samples along the object's shorter horizontal side [-]."""
FINEST, COARSEST = 0.003, 0.025
"""Limits of the sampling distance [m]."""
ROOM_HEIGHT = 3.0
"""Distance up to which a ray that began inside a door or a wardrobe searches for its top [m]."""
CRACK = 2
"""Maximum number of the eight samples around a sample in a crack that are in a crack too [-]."""
MOST_SAMPLES = 600_000
"""Maximum number of rays for one surface; larger surfaces are sampled more coarsely."""
BATCH = 256
"""Number of grid points fitted at once."""


@dataclass(frozen=True, eq=False, slots=True)
class HeightField:
    """The scene seen from above the support, on the grid."""

    height: Array
    """Height of the first surface [m]; inf inside a thing, -inf where nothing is, shape (rows, columns)."""
    support: NDArray[np.bool_]
    """Whether the first surface is the support, shape (rows, columns)."""
    face: NDArray[np.int64]
    """Face of the scene at the first surface, -1 for none, shape (rows, columns)."""


@dataclass(frozen=True, eq=False, slots=True)
class CandidateFits:
    """Fits of the object at some grid points."""

    index: NDArray[np.int64]
    """Row and column of each grid point, shape (n, 2)."""
    lift: Array
    """Lift of the object by surfaces other than the support [m], shape (n,)."""
    share: Array
    """Share of the underside over the support [-], shape (n,)."""
    level: Array
    """Share over the support where it is no further than DROP below the contact [-], shape (n,)."""
    height: Array
    """Height of the object's origin at contact [m], shape (n,)."""


@dataclass(frozen=True, slots=True)
class Spot:
    """A position for the object."""

    x: float
    """Position of the object's origin [m]."""
    y: float
    share: float
    """Share of the underside over the support [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class SearchFailure:
    """Reason why no spot was found."""

    hit: bool
    """Whether the support has a surface in the region, covered or not."""
    best_share: float
    """Largest supported share of the underside at an unobstructed spot [-]."""
    blocked: float
    """Share of the aimed-at spots that are obstructed [-]."""
    blockers: NDArray[np.int64]
    """Face of the scene that obstructs most at each such spot, shape (k,)."""


class PlacementSearch:
    """An object over a support, both sampled once and searched for places."""

    def __init__(self, scene: Mesh, caster: Raycaster, is_support: NDArray[np.bool_], item: Mesh) -> None:
        """`is_support`: mask of the scene's faces. `item`: oriented, with its origin at the point that goes over the
        spot."""
        self.caster, self.is_support = caster, is_support
        self.support = scene.submesh(np.flatnonzero(is_support))
        low, high = self.support.bounds
        size = np.ptp(item.bounds, axis=0)
        self.height = float(size[2])
        area = float(np.prod(high[:2] - low[:2] + 2.0 * size[:2]))
        cell = float(np.clip(size[:2].min() / SAMPLES, FINEST, COARSEST))
        self.cell = max(cell, float(np.sqrt(area / MOST_SAMPLES)))
        self.top = float(high[2]) + self.height + HEADROOM
        self._sample_item(item)
        reach = np.abs(item.bounds[:, :2]).max(axis=0) + 4 * self.cell
        self.origin = low[:2] - reach
        self.count = np.ceil((high[:2] + reach - self.origin) / self.cell).astype(int) + 1
        self.excluded = np.zeros(self.count, dtype=bool)
        self._known: dict[bytes, tuple[list[CandidateFits], Iterator[NDArray[np.int64]]]] = {}

    def _sample_item(self, item: Mesh) -> None:
        """Compute the height of the underside over the object's origin on the grid."""
        low = np.floor(item.bounds[0, :2] / self.cell).astype(int)
        high = np.ceil(item.bounds[1, :2] / self.cell).astype(int)
        i, j = (
            k.ravel()
            for k in np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij")
        )
        start = np.c_[i * self.cell, j * self.cell, np.full(len(i), item.bounds[0, 2] - 1.0)]
        hits = Raycaster(item).cast(start, np.tile([0.0, 0.0, 1.0], (len(i), 1)))
        hit = hits.face >= 0
        self.offset = np.c_[i[hit], j[hit]]
        self.under = start[hit, 2] + hits.distance[hit]
        self.lowest = self.under <= self.under.min() + max(LOWEST * self.height, 0.004)
        self.extent = float(np.ptp(item.bounds[:, :2], axis=0).max())
        self.long_axis, size = smallest_rectangle(item.vertices[:, :2])
        self.breadth = float(size[1])
        self.around, self.around_under = widened(self.offset, self.under)

    @cached_property
    def surface(self) -> HeightField:
        """The scene under each grid point."""
        i, j = np.meshgrid(np.arange(self.count[0]), np.arange(self.count[1]), indexing="ij")
        start = np.c_[self.origin + self.cell * np.c_[i.ravel(), j.ravel()], np.full(i.size, self.top)]
        hits = self.caster.cast(start, np.tile([0.0, 0.0, -1.0], (i.size, 1)))
        hit = hits.face >= 0
        height = np.where(hit, self.top - hits.distance, -np.inf)
        support = np.zeros(i.size, dtype=bool)
        support[hit] = self.is_support[hits.face[hit]]
        upward = hits.normal[:, 2] >= 0
        # if the support itself is wound the wrong way round, normals have no meaning
        if support.any() and upward[support].mean() > 0.8:
            height[hit & (hits.normal[:, 2] < -0.1) | self._inside(start)] = np.inf
            support &= np.isfinite(height)
        return over_cracks(
            HeightField(height.reshape(i.shape), support.reshape(i.shape), hits.face.astype(np.int64).reshape(i.shape))
        )

    def add(self, points: Array, faces: NDArray[np.int64]) -> None:
        """Add points (n, 3) on faces (n,) of the scene that no ray met: their columns are at least that high.

        The highest surface in a column determines its face, and a single surface that does not carry blocks the column.
        """
        index = np.rint((points[:, :2] - self.origin) / self.cell).astype(np.int64)
        known = ((index >= 0) & (index < self.count)).all(axis=1)
        rising = np.flatnonzero(known)[np.argsort(points[known, 2], kind="stable")]
        column, height, face = tuple(index[rising].T), points[rising, 2], faces[rising]
        own = self.is_support[face]
        # a surface inside the support, below its top, is still an obstruction there
        named = (height >= self.surface.height[column]) | (self.surface.support[column] & ~own)
        # the highest comes last; for repeated indices numpy keeps the last
        self.surface.face[tuple(index[rising[named]].T)] = face[named]
        np.maximum.at(self.surface.height, column, height)
        np.logical_and.at(self.surface.support, column, own)
        self._known.clear()

    def exclude(self, spot: Spot, reach: int) -> None:
        """Exclude a spot and all others within `reach` samples of it."""
        low = np.maximum(self._index(spot) - reach, 0)
        high = self._index(spot) + reach + 1
        self.excluded[low[0] : high[0], low[1] : high[1]] = True

    def _inside(self, start: Array) -> NDArray[np.bool_]:
        """Mask of the points (n, 3) that lie inside a thing, which an upward ray leaves again below a room's height."""
        return np.asarray(self.caster.left_at(start, np.tile([0.0, 0.0, 1.0], (len(start), 1))) < ROOM_HEIGHT)

    def find(
        self, region: Region, share: float, *, level: bool, steady: bool = False, anywhere: bool = False
    ) -> Spot | None:
        """The spot nearest to the region's target that has this much support and is unobstructed.

        `level`: only support no further than DROP below the contact counts; `steady`: the object must not come down
        when it is moved slightly, and the spot must be nearby. On a narrow support, where the edge is next to the
        nearest spot, no steady spot is searched: a request for a ridge means the ridge. `anywhere`: no place was
        requested, so a steady spot may be far away, and also on a narrow support if it is held on all sides there.
        """
        nearest = True
        for seen in self._fits(region):
            supported = seen.level if level else seen.share
            good = np.flatnonzero((seen.lift <= STEPPED) & (supported >= share) & ~self.excluded[tuple(seen.index.T)])
            if steady:
                away = np.linalg.norm(self.origin + self.cell * seen.index - region.target, axis=1)
                farthest = np.inf if anywhere else NEARBY * self.extent
                if away.min() > farthest:
                    return None
                good = good[away[good] <= farthest]
                if anywhere:  # where the support ends nearby, the object may tip without coming down
                    good = good[self._held(seen.index[good])]
                descent, broad = self._surroundings(seen.index[good], seen.height[good])
                if nearest and len(good) and not (broad[0] or anywhere):
                    return None
                nearest &= len(good) == 0
                good = good[descent <= STEADY]
            if len(good):
                x, y = self.origin + self.cell * seen.index[good[0]]
                return Spot(float(x), float(y), float(seen.share[good[0]]))
        return None

    def failure(self, region: Region) -> SearchFailure:
        """Reason why the region has no spot."""
        best, blocked, total = 0.0, 0, 0
        blockers: list[NDArray[np.int64]] = []
        for seen in self._fits(region):
            free = (seen.lift <= STEPPED) & ~self.excluded[tuple(seen.index.T)]
            best = max(best, float(seen.share[free].max(initial=0.0)))
            blocked, total = blocked + int((~free).sum()), total + len(free)
            blockers.append(self._in_the_way(seen.index[~free]))
        if total == 0:
            covered, faces = self._covered(region)
            return SearchFailure(covered, 0.0, float(covered), faces)
        return SearchFailure(True, best, blocked / total, np.concatenate(blockers))

    def _covered(self, region: Region) -> tuple[bool, NDArray[np.int64]]:
        """Whether the support is covered by other things everywhere in the region, and the faces of these things."""
        index = np.argwhere(np.ones(self.count, dtype=bool))
        index = index[inside(region.polygon, self.origin + self.cell * index, margin=1e-6)]
        above = np.c_[self.origin + self.cell * index, np.full(len(index), self.support.bounds[1, 2] + 1.0)]
        under = Raycaster(self.support).cast(above, np.tile([0.0, 0.0, -1.0], (len(above), 1))).face >= 0
        faces = self.surface.face[tuple(index[under].T)]
        return bool(under.any()), faces[faces >= 0]

    def _in_the_way(self, index: NDArray[np.int64]) -> NDArray[np.int64]:
        """For each grid point the face of the scene that lifts the object most, shape (n,)."""
        rows, columns = index[:, :1] + self.around[:, 0], index[:, 1:] + self.around[:, 1]
        own = self.surface.support[rows, columns]
        lift = np.where(own, -np.inf, self.surface.height[rows, columns] - self.around_under)
        most = (np.arange(len(index)), lift.argmax(axis=1))
        faces = self.surface.face[rows, columns][most]
        return np.asarray(faces[faces >= 0])

    def _fits(self, region: Region) -> Iterator[CandidateFits]:
        """Fits of the region's grid points over the support, nearest to the target first, each computed once."""
        key = b"|".join(ring.tobytes() for ring in (region.polygon, region.target, *region.excluded))
        if key not in self._known:
            self._known[key] = ([], self._batches(region))
        known, rest = self._known[key]
        yield from known
        for batch in rest:
            known.append(self._fit(batch))
            yield known[-1]

    def _batches(self, region: Region) -> Iterator[NDArray[np.int64]]:
        """The grid points to fit, in batches."""
        index = np.argwhere(self.surface.support)
        position = self.origin + self.cell * index
        keep = inside(region.polygon, position, margin=1e-6)
        for ring in region.excluded:
            if len(ring) >= 3:
                keep &= ~inside(ring, position, margin=-1e-6)
        index, position = index[keep], position[keep]
        reach = self.around.min(axis=0), self.around.max(axis=0)
        fits = ((index + reach[0] >= 0) & (index + reach[1] < self.count)).all(axis=1)
        index, position = index[fits], position[fits]
        distance = np.linalg.norm(position - region.target, axis=1)
        order = np.lexsort((index[:, 1], index[:, 0], np.round(distance, 6)))
        for begin in range(0, len(order), BATCH):
            yield index[order[begin : begin + BATCH]]

    def _fit(self, index: NDArray[np.int64]) -> CandidateFits:
        """Fits of the object over each grid point (n, 2)."""
        below, on = self._below(index, self.offset)
        needed = below - self.under
        alone = np.where(on, needed, -np.inf).max(axis=1)
        below, own = self._below(index, self.around)
        others = np.where(own, -np.inf, below - self.around_under).max(axis=1)
        with np.errstate(invalid="ignore"):
            lift = np.where(np.isfinite(alone), others - alone, np.inf)
        near = on[:, self.lowest] & (needed[:, self.lowest] >= alone[:, None] - DROP)
        return CandidateFits(index, lift, on[:, self.lowest].mean(axis=1), near.mean(axis=1), needed.max(axis=1))

    def _surroundings(self, index: NDArray[np.int64], height: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Largest slope by which the object comes down when it is moved about the support from each grid point, at
        which it touches at such a height [-], and whether the support continues all around; both of shape (n,)."""
        low, high = -self.around.min(axis=0), self.count - 1 - self.around.max(axis=0)
        steepest, broad = np.zeros(len(index)), np.ones(len(index), dtype=bool)
        for part in MOVED if len(index) else ():
            reach = max(round(part * self.extent / self.cell), 1)
            moved = np.clip(index[:, None] + np.rint(reach * CIRCLE).astype(np.int64), low, high).reshape(-1, 2)
            there = [self._fit(moved[k : k + BATCH]) for k in range(0, len(moved), BATCH)]
            on = np.concatenate([seen.level for seen in there]).reshape(-1, len(CIRCLE)) >= SHARES[-1]
            lowest = np.where(on, np.concatenate([seen.height for seen in there]).reshape(on.shape), np.inf).min(axis=1)
            steepest = np.maximum(steepest, (height - lowest) / (reach * self.cell))
            broad &= on.all(axis=1)
        return steepest, broad

    def _held(self, index: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Mask of the grid points at which the object touches the support on all sides of its origin, shape (n,), or
        would after tilting as far as steady places allow: an object with one of its edges on a crest tips over."""
        across = np.array([-self.long_axis[1], self.long_axis[0]])
        along = self.offset @ (CIRCLE @ np.stack([self.long_axis, across])).T
        below, on = self._below(index, self.offset)
        needed = np.where(on, below - self.under, -np.inf)
        contact = needed.max(axis=1, initial=-np.inf)[:, None]
        touching = needed >= contact - max(0.5 * STEADY * self.breadth, CLOSE)
        sides = [np.where(touching, one, -np.inf).max(axis=1) for one in along.T]
        return np.asarray(np.stack(sides, axis=1).min(axis=1, initial=np.inf) >= 0.0)

    def _below(self, index: NDArray[np.int64], offset: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Height of the surface, and whether it is the support, under each offset from each grid point."""
        rows, columns = index[:, :1] + offset[:, 0], index[:, 1:] + offset[:, 1]
        return self.surface.height[rows, columns], self.surface.support[rows, columns]

    def start_height(self, spot: Spot) -> float:
        """Height of the origin at which the sampled underside touches [m]."""
        return float(self._fit(self._index(spot)[None]).height[0])

    def _index(self, spot: Spot) -> NDArray[np.int64]:
        """Row and column of a spot, shape (2,)."""
        steps: NDArray[np.int64] = np.rint((np.array([spot.x, spot.y]) - self.origin) / self.cell).astype(np.int64)
        return steps


def over_cracks(field: HeightField) -> HeightField:
    """The heights, where single samples that seem to be inside a thing get the value of those around them: through a
    crack in a scan, narrower than the samples, back faces are seen."""
    rows, columns = field.height.shape
    steps = [(a, b) for a in (0, 1, 2) for b in (0, 1, 2) if (a, b) != (1, 1)]

    def around(values: NDArray[np.generic]) -> NDArray[np.generic]:
        padded = np.pad(values, 1, mode="edge")
        return np.stack([padded[a : a + rows, b : b + columns] for a, b in steps])

    inside = np.isposinf(field.height)
    crack = inside & (around(inside).sum(axis=0) <= CRACK)
    if not crack.any():
        return field
    level, place = around(field.height)[:, crack], np.arange(int(crack.sum()))
    middle = np.argsort(level, axis=0)[len(steps) // 2 - 1]  # the inside ones are last
    height, support, face = field.height.copy(), field.support.copy(), field.face.copy()
    height[crack] = level[middle, place]
    support[crack] = around(field.support)[:, crack][middle, place]
    face[crack] = around(field.face)[:, crack][middle, place]
    return HeightField(height, support, face)


def widened(offset: NDArray[np.int64], under: Array) -> tuple[NDArray[np.int64], Array]:
    """The underside extended by one sample all around, with each sample as low as its lowest neighbour."""
    low = offset.min(axis=0) - 1
    grid = np.full(np.ptp(offset, axis=0) + 3, np.inf)
    grid[tuple((offset - low).T)] = under
    padded = np.pad(grid, 1, constant_values=np.inf)
    spread = np.min([padded[i : i + grid.shape[0], j : j + grid.shape[1]] for i in range(3) for j in range(3)], axis=0)
    where = np.argwhere(np.isfinite(spread))
    return where + low, spread[tuple(where.T)]
