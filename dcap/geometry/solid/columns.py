"""The solid under what can be seen from where an object comes down: always closed, whatever the scan is like.

In: the faces of a thing (mended, `mending.py` next to this) and a bottom height for each, the region in which something
may touch it, and the object that hovers there. Out: one closed surface. Each column of the region is material from the
first surface below the object's top down to that surface's bottom; columns that the object cannot see over a surface,
because that goes on above it, are material all the way up. What is seen carries; nothing else counts: second layers,
sheets inside, missing undersides, backs and scraps change nothing.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, uniform_filter

from dcap.arrays import Array, IntArray, Mask
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.height_map import HeightMap, TornHole, holes_closed, spacing_within
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.geometry.solid.soundness import agreement, well_formed
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Method, RepairReport

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
LOOKS = 0.5  # distance of the looks that measure how far what is seen is off the solid, in columns
PLACES, FARTHEST = 4000, 20_000  # of what they meet, at random and farthest over or under it, where that is measured
STEP = 1.5  # columns that what is seen at a step may be off the slope there
FEW = 10  # looks that meet what the columns missed: fewer are noise
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
    """Holes that were closed."""
    report: RepairReport


def column_solid(
    mesh: Mesh, bottom: Array, region: Array, item: Mesh, tolerance: float, log: RepairLog
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


def seen_below(caster: Raycaster, region: Array, item: Mesh, cell: float) -> HeightMap:
    """The first surface below the top of an object, or below the object itself; up to the region's top where the
    surface between it and the object goes on above it."""
    count = np.maximum(np.round(np.ptp(region[:, :2], axis=0) / cell).astype(int), 2)
    index = np.indices(count + 1).reshape(2, -1).T
    plan = region[0, :2] + cell * index
    start, own = heights_over(item, plan, float(region[0, 2]) - 1.0)
    down, up = (np.broadcast_to((0.0, 0.0, sign), (len(plan), 3)) for sign in (-1.0, 1.0))
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


def behind(caster: Raycaster, points: Array, item: Mesh) -> Mask:
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


def bottoms(seen: HeightMap, bottom: Array) -> Array:
    """Where the material of each column ends [m], shape (rows, columns): in a closed hole as deep as around it."""
    known = seen.face >= 0
    lowest = np.where(known, bottom[np.maximum(seen.face, 0)], np.inf)
    missing = np.isfinite(seen.height) & ~known
    if missing.any():
        lowest[missing] = float(np.median(lowest[known]))
    return np.asarray(lowest)


def closed_columns(seen: HeightMap, lowest: Array) -> tuple[Mesh, IntArray, Mask]:
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
    """How far what is seen under the object and near it lies off the solid, by looks of their own, which may meet what
    is narrower than a column."""
    field, whole = MeshDistance(surface), well_formed(surface)
    margin = NEAR * float(np.ptp(item.bounds[:, :2], axis=0).max())
    near = np.stack([item.bounds[0] - margin, item.bounds[1] + margin])
    near[0, 2] = surface.bounds[0, 2]
    points, over = looked_at(caster, closed, seen.height != closed.height, near, item, surface)
    rng = np.random.default_rng(0)
    some = rng.integers(0, len(points), PLACES) if len(points) else np.zeros(0, dtype=np.int64)
    farthest = np.argsort(-np.abs(over))[:FARTHEST]  # none is farther off than it is over or under the solid
    asked = np.concatenate([some, farthest])
    off = field.unsigned(points[asked])
    # a step is a slope one column wide; what lies deeper is in a cleft narrower than a column, or behind a surface
    met = (over[asked] >= 0.0) | (off < STEP * seen.cell)
    off = np.where(met, off, 0.0)
    usual = off[: len(some)][met[: len(some)]]
    most, mean = float(off.max(initial=0.0)), float(usual.mean()) if len(usual) else 0.0
    missed = (off > max(tolerance, STEP * seen.cell)) & (over[asked] > 0.0)
    problem = ""
    if not whole:
        problem = "it is not closed"
    elif len(some) and float((off[: len(some)] > tolerance).mean()) > RIDGES:
        problem = f"what can be seen lies up to {1e3 * most:.2g} mm off its surface > {1e3 * tolerance:.2g} mm"
    elif int(missed[len(some) :].sum()) >= FEW:
        problem = (
            f"what is narrower than its columns of {1e3 * seen.cell:.2g} mm stands up to {1e3 * most:.2g} mm out of it "
            f"> {1e3 * tolerance:.2g} mm"
        )
    return RepairReport(
        Method.COLUMNS, whole, agreement(surface) if whole else 0.0, most, mean, tolerance, seen.cell, field.volume,
        seen.cell, log.sentences(), problem, tuple(near.reshape(-1).tolist()),
    )  # fmt: skip


def looked_at(
    caster: Raycaster, columns: HeightMap, filled: Mask, near: Array, item: Mesh, surface: Mesh
) -> tuple[Array, Array]:
    """Points that may carry and are met from above near an object, (n, 3) [m], and how high each lies over the solid's
    surface [m], below 0 under it, inf where there is none, (n,). None lie under closed holes (`filled` samples).

    Looks are half a column apart, at random places of their squares.
    """
    spacing = LOOKS * columns.cell
    low = np.maximum(near[0, :2], columns.origin)
    high = np.minimum(near[1, :2], columns.world(np.array([columns.height.shape])[0] - 1))
    count = np.maximum(np.floor((high - low) / spacing).astype(int), 0)
    rng = np.random.default_rng(1)
    plan = low + spacing * (np.indices(count).reshape(2, -1).T + rng.random((int(count.prod()), 2)))
    down = np.broadcast_to((0.0, 0.0, -1.0), (len(plan), 3))
    hits = caster.cast(np.c_[plan, heights_over(item, plan, near[0, 2] - 1.0)[0]], down)
    carrying = hits.normal[:, 2] > LEVEL
    points = hits.position[carrying]
    top = float(surface.bounds[1, 2]) + 1.0
    under = Raycaster(surface).cast(np.c_[plan[carrying], np.full(len(points), top)], down[carrying])
    over = points[:, 2] - (top - under.distance)
    index = np.round((points[:, :2] - columns.origin) / columns.cell).astype(int)
    hole = binary_dilation(filled, np.ones((3, 3)))[tuple(index.T)] & (over < 0.0)
    return points[~hole], over[~hole]


def heights_over(item: Mesh, plan: Array, below: float) -> tuple[Array, Mask]:
    """Where looks down at places (n, 2) begin [m], shape (n,): at the underside of the object, which is higher than
    `below` [m], next to it as high as its top; and which are under it, shape (n,)."""
    start = np.full(len(plan), float(item.bounds[1, 2]))
    origin = np.c_[plan, np.full(len(plan), below)]
    under = Raycaster(item).cast(origin, np.broadcast_to((0.0, 0.0, 1.0), origin.shape))
    own = under.face >= 0
    start[own] = below + under.distance[own] - LIFT
    return start, own
