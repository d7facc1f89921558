"""The solid under what can be seen from where an object comes down: always closed, whatever the scan is like.

In: the faces of a thing (mended, `mending.py` beside this) and a bottom height for each, the region in which something
may touch it, and the object that hovers there. Out: one closed surface. Each column of the region is material from the
first surface below the object's top down to that surface's bottom; columns that the object cannot see over a surface,
because that goes on above it, are material all the way up. What is seen carries; nothing else counts: second layers,
sheets inside, missing undersides, backs and scraps change nothing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.height_map import HeightMap, TornHole, holes_closed, spacing_within
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.geometry.solid.soundness import agreement, well_formed
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.repair_report import Method, RepairReport

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

FINEST = 0.002  # width of a column, at least [m]
MOST_COLUMNS = 60_000  # looks at them: in large regions they are wider
THINNEST = 0.01  # a column is at least this high [m]
UP = 0.1  # vertical component of a unit normal that looks up
LIFT = 1e-4  # rays begin this far off [m]
AROUND = 5  # columns along the sides of the square in which most decide whether one is material all the way up
SEEN_FROM = 3  # of five places of the object from which a point is hidden
NEAR = 0.5  # how far around the object what is seen must be kept, over its larger horizontal side [-]
CRACK = 0.01  # holes shorter than this are not told [m]
RIDGES = 0.01  # share of what is seen that may be farther off than allowed: edges narrower than a column
PLACES = 4000  # at which the distance between what is seen and the solid is measured
LEVEL = 0.5  # vertical component of the unit normal of what may carry: sides are seen at their edges only


@dataclass(frozen=True, eq=False, slots=True)
class ColumnSolid:
    """The solid under what is seen."""

    mesh: Mesh
    """Closed, wound outwards."""
    source: IntArray
    """Face of the given mesh that is seen at each of its faces, shape (m,)."""
    top: Mask
    """Which of its faces are what is seen, shape (m,)."""
    holes: tuple[TornHole, ...]
    """Those that were closed."""
    report: RepairReport


def column_solid(
    mesh: Mesh, bottom: FloatArray, region: FloatArray, item: Mesh, tolerance: float, log: RepairLog
) -> ColumnSolid | None:
    """The solid under the faces, each down to its `bottom` [m], shape (m,), within the region (2, 3) [m] around the
    `item` that hovers over them; None where nothing is seen there.

    `tolerance` [m] is how far what is seen may be off its surface before the report calls that a problem.
    """
    caster = Raycaster(mesh)
    cell = spacing_within(np.ptp(region[:, :2], axis=0), FINEST, MOST_COLUMNS, 0)
    seen = seen_below(caster, region, item, cell)
    if not np.isfinite(seen.height).any():
        return None
    closed, holes = holes_closed(seen, caster, mesh)
    height, lowest = closed.height, bottoms(closed, bottom)
    surface, source, top = closed_columns(closed, np.minimum(lowest, height - THINNEST))
    log.add(RepairKind.COLUMNS, cell)
    for hole in holes:
        if hole.sides[0] > CRACK:
            log.add(RepairKind.HOLE, hole.sides[0])
    return ColumnSolid(
        surface, source, top, tuple(holes), reported(surface, seen, closed, caster, item, tolerance, log)
    )


def seen_below(caster: Raycaster, region: FloatArray, item: Mesh, cell: float) -> HeightMap:
    """The first surface below the top of an object, or below the object itself; up to the region's top where the
    surface between it and the object goes on above it."""
    count = np.maximum(np.round(np.ptp(region[:, :2], axis=0) / cell).astype(int), 2)
    index = np.indices(count + 1).reshape(2, -1).T
    plan = region[0, :2] + cell * index
    start = np.full(len(plan), float(item.bounds[1, 2]))
    down, up = (np.broadcast_to((0.0, 0.0, sign), (len(plan), 3)) for sign in (-1.0, 1.0))
    below = np.c_[plan, np.full(len(plan), region[0, 2] - 1.0)]
    under = Raycaster(item).cast(below, up)
    own = under.face >= 0
    start[own] = below[own, 2] + under.distance[own] - LIFT
    hits = caster.cast(np.c_[plan, start], down)
    shape = (int(count[0]) + 1, int(count[1]) + 1)
    inside = behind(caster, np.c_[plan, start], item).reshape(shape)
    most = uniform_filter(inside.astype(float), AROUND) > 0.5  # one look may pass through a hole
    buried = np.flatnonzero(most.reshape(-1) & ~own)
    height = np.where(hits.face >= 0, start - hits.distance, -np.inf)
    face = hits.face.astype(np.int64)
    above = caster.cast(np.c_[plan, start][buried], up[buried])
    height[buried] = np.minimum(start[buried] + above.distance, region[1, 2])
    face[buried] = np.where(above.face >= 0, above.face, face[buried])
    return HeightMap(region[0, :2].copy(), cell, height.reshape(shape), face.reshape(shape))


def behind(caster: Raycaster, points: FloatArray, item: Mesh) -> Mask:
    """Whether points (n, 3) lie in a thing: up from them one is met from below that looks up, and a surface hides them
    from most of five places of the object."""
    inside = np.zeros(len(points), dtype=bool)
    ahead = caster.cast(points, np.broadcast_to((0.0, 0.0, 1.0), points.shape))
    asked = np.flatnonzero(ahead.normal[:, 2] > UP)
    if len(asked) == 0:
        return inside
    low, high = item.bounds[:, :2]
    middle, half = 0.5 * (low + high), 0.4 * (high - low)
    hidden = np.zeros(len(asked), dtype=int)
    for side in ((0, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)):
        way = np.c_[points[asked, :2] - middle - half * side, np.zeros(len(asked))]
        origin = points[asked] - way - (0.0, 0.0, LIFT)
        length = np.linalg.norm(way, axis=1)
        hidden += caster.occluded(origin, way / np.maximum(length, LIFT)[:, None], length)
    inside[asked] = hidden >= SEEN_FROM
    return inside


def bottoms(seen: HeightMap, bottom: FloatArray) -> FloatArray:
    """Where the material of each column ends [m], shape (rows, columns): in a closed hole as deep as around it."""
    known = seen.face >= 0
    lowest = np.where(known, bottom[np.maximum(seen.face, 0)], np.inf)
    missing = np.isfinite(seen.height) & ~known
    if missing.any():
        lowest[missing] = float(np.median(lowest[known]))
    return np.asarray(lowest)


def closed_columns(seen: HeightMap, lowest: FloatArray) -> tuple[Mesh, IntArray, Mask]:
    """The surface around all columns, the face that is seen at each of its faces, and which are on top.

    Corners are the samples; four of them that are there are a piece of the top and of the bottom, and where a piece has
    no neighbour there is a wall.
    """
    there = np.isfinite(seen.height)
    whole = there[:-1, :-1] & there[1:, :-1] & there[1:, 1:] & there[:-1, 1:]
    number = np.arange(there.size).reshape(there.shape)
    place = np.argwhere(whole)
    a, b, c, d = (number[tuple((place + step).T)] for step in ((0, 0), (1, 0), (1, 1), (0, 1)))
    upper = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    sides = []
    for step, start, end in (((-1, 0), d, a), ((1, 0), b, c), ((0, -1), a, b), ((0, 1), c, d)):
        beside = np.pad(whole, 1)[tuple((place + 1 + step).T)]
        sides.append(np.stack([start, end], axis=1)[~beside])
    rim, size = np.concatenate(sides), there.size
    walls = [np.stack(corner, axis=1) for corner in (
        (rim[:, 1], rim[:, 0], rim[:, 0] + size), (rim[:, 1], rim[:, 0] + size, rim[:, 1] + size)
    )]  # fmt: skip
    faces = np.concatenate([upper, upper[:, ::-1] + size, *walls])
    plan = seen.world(np.argwhere(np.ones(there.shape, dtype=bool)))
    high, low = (np.where(there, level, 0.0).reshape(-1) for level in (seen.height, lowest))
    vertices = np.concatenate([np.c_[plan, high], np.c_[plan, low]])
    source = np.maximum(seen.face, 0).reshape(-1)[faces[:, 0] % size]
    surface = Mesh.of(vertices, faces).submesh(np.arange(len(faces)))
    return surface, source, np.arange(len(faces)) < len(upper)


def reported(
    surface: Mesh,
    seen: HeightMap,
    closed: HeightMap,
    caster: Raycaster,
    item: Mesh,
    tolerance: float,
    log: RepairLog,
) -> RepairReport:
    """How far what is seen under the object and near it, but not through holes, lies off the solid."""
    field, whole = MeshDistance(surface), well_formed(surface)
    margin = NEAR * float(np.ptp(item.bounds[:, :2], axis=0).max())
    near = np.stack([item.bounds[0] - margin, item.bounds[1] + margin])
    near[0, 2] = surface.bounds[0, 2]
    index = np.argwhere(np.isfinite(seen.height) & (seen.face >= 0) & (closed.height == seen.height))
    plan = seen.world(index)
    index = index[((plan >= near[0, :2]) & (plan <= near[1, :2])).all(axis=1)]
    off = np.zeros(1)
    if len(index):
        rng = np.random.default_rng(0)
        index = index[rng.integers(0, len(index), PLACES)]
        start = np.c_[seen.world(index) + rng.uniform(-0.5, 0.5, (PLACES, 2)) * seen.cell, seen.height[tuple(index.T)]]
        hits = caster.cast(start + np.array([0.0, 0.0, seen.cell]), np.broadcast_to((0.0, 0.0, -1.0), start.shape))
        carrying = (hits.normal[:, 2] > LEVEL) & (hits.distance < 2.0 * seen.cell)
        off = np.append(off, field.unsigned(hits.position[carrying]))
    most, mean = float(off.max()), float(off[1:].mean()) if len(off) > 1 else 0.0
    problem = ""
    if not whole:
        problem = "it is not closed"
    elif float((off > tolerance).mean()) > RIDGES:
        problem = f"what can be seen lies up to {1e3 * most:.2g} mm off its surface > {1e3 * tolerance:.2g} mm"
    return RepairReport(
        Method.COLUMNS, whole, agreement(surface) if whole else 0.0, most, mean, tolerance, seen.cell, field.volume,
        seen.cell, log.sentences(), problem, tuple(near.reshape(-1).tolist()),
    )  # fmt: skip
