"""Measures of an unnamed thing in a room: its size, its build, its holder.

In: a room divided into things. Out: one `Traits` per thing, in the same order. Nothing is named here.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree
from skimage.color import lab2rgb

from dcap.arrays import Array, IntArray
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.rooms.contacts import FEW, Segments, segments_of
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom, FusedThing
from dcap.scene.types.boxes import OrientedBox, min_area_box

FLOOR, WALL, CEILING, NOTHING = "floor", "wall", "ceiling", "nothing"
"""Parts of the room that may hold a thing, or nothing."""
ON_FLOOR = 0.04
"""Largest distance from the floor of a thing that stands on it [m]."""
NEAR_WALL = 0.15
"""Largest distance from a wall of a thing that hangs there, if it stands nowhere [m]."""
CELL = 0.04
"""Size of the cells for measuring outlines [m]: larger than the spacing of the points that represent surfaces."""
CELLS = 24
"""... and maximum number of cells along the longer side of an outline [-]."""
LEVEL_BAND = 0.03
"""Height within which points are on one level [m]."""
LEVEL_SHARE = 0.3
"""Least share of the thing's plan covered by a level [-]."""
LOOKS_UP = 0.75
"""Least normal z of an upward surface [-]."""
NEIGHBOURS = 9
"""Number of points for measuring roughness by their normals [-]."""
SLICES = 16
"""Number of slices of height for measuring the outline [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Traits:
    """Measures of one thing. Lengths in metres, heights above the floor, shares 0..1."""

    box: OrientedBox
    """Smallest upright box around the thing."""
    length: float
    """Longer horizontal side of the box."""
    width: float
    """Shorter horizontal side of the box."""
    height: float
    bottom: float
    top: float
    level_height: float
    """Height of the main upward surface; nan if there is none."""
    level_area: float | None
    """Area of that surface [m^2]; None, like the next one, if a scan has not seen the top."""
    rise: float | None
    """Height by which the thing rises above its main upward surface."""
    levels: int
    """Number of upward surfaces that cover a good part of the plan."""
    closed: float | None
    """Filled share of its outline seen from the side, the smaller of both sides; None, like the following ones, if a
    fused scan shows too little of it."""
    covered: float
    """Filled share of the plan's rectangle, seen from above."""
    waist: float | None
    """Ratio of the smallest to the largest breadth."""
    rough: float | None
    """Roughness; 0: smooth surfaces, towards 2/3: leaves."""
    holder: int
    """Index of the thing on which it stands or that it touches most, -1: none."""
    held_by: str
    """FLOOR, WALL, CEILING, NOTHING, or empty if it is `holder`."""
    wall_gap: float
    """Distance of its nearest point to a wall; inf without walls."""
    carries: int
    """Number of things that stand on it."""
    color: tuple[float, float, float]
    """Mean sRGB colour, 0..1."""
    varied: float
    """Distance from its mean colour that is exceeded by a twentieth of its surface [CIELAB units]."""
    balance: float | None
    """Height of the middle of the surface within the box: 0 at its bottom, 1 at its top."""


def describe_things(table: FaceTable, room: DecomposedRoom, segments: Segments) -> tuple[Traits, ...]:
    """Measure all things of a room; `segments` come from `thing_segments`."""
    if room.fused:
        holder = [(one.held_by, one.shape.held_by or NOTHING if one.held_by < 0 else "") for one in room.fused]
    else:
        holder = [_holder(segments, room, i) for i in range(len(room.things))]
    carries = np.bincount([h for h, _ in holder if h >= 0], minlength=len(holder))
    found = tuple(_traits(table, room, segments, i, *holder[i], int(carries[i])) for i in range(len(room.things)))
    return tuple(map(_as_fused, found, room.fused)) if room.fused else found


def _as_fused(traits: Traits, thing: FusedThing) -> Traits:
    """Traits with the measures that a fused scan gives more reliably, and without those that it does not give."""
    shape = thing.shape
    bottom, level, area, rise = shape.bottom or 0.0, float("nan"), None, None
    if shape.top_seen:
        level = shape.level_height if shape.level_height is not None else level
        area, rise = shape.level_area, shape.top - (bottom if np.isnan(level) else level)
    return replace(
        traits, length=shape.length, width=shape.width, height=shape.top - bottom, bottom=bottom,
        top=shape.top, level_height=level, level_area=area, rise=rise, levels=shape.levels,
        wall_gap=float("inf") if shape.wall_gap is None else shape.wall_gap,
        closed=None, waist=None, rough=None, balance=None,
    )  # fmt: skip


def thing_segments(table: FaceTable, room: DecomposedRoom) -> Segments:
    """The things as sampled segments, numbered in their order."""
    number = np.full(len(table.area), -1, dtype=np.int64)
    for i, faces in enumerate(room.things):
        number[faces] = i
    return segments_of(table, number)


def _traits(
    table: FaceTable, room: DecomposedRoom, segments: Segments, i: int, holder: int, held_by: str, carries: int
) -> Traits:  # fmt: skip
    faces, one = room.things[i], segments.alive[i]
    floor = _floor(table, room)
    box = min_area_box(table.corners[faces].reshape(-1, 3))
    position, weight = segments.position[one.points], segments.weight[one.points]
    local, up = (position - box.center) @ box.axes, segments.normal[one.points, 2] > LOOKS_UP
    width, length = sorted(2.0 * box.half_extents[:2])
    heights, areas = _levels(local[up, 2], weight[up], 4.0 * float(np.prod(box.half_extents[:2])))
    main = int(np.argmax(areas)) if len(areas) else -1
    level = float(heights[main]) + box.center[2] if main >= 0 else float("nan")
    return Traits(
        box=box, length=float(length), width=float(width), height=float(2.0 * box.half_extents[2]),
        bottom=float(box.bottom - floor), top=float(box.top - floor),
        level_height=float(level - floor), level_area=float(areas[main]) if main >= 0 else 0.0,
        rise=float(box.top - (level if main >= 0 else box.bottom)),
        levels=int((areas > LEVEL_SHARE * 4.0 * np.prod(box.half_extents[:2])).sum()),
        closed=min(_filled(local[:, [axis, 2]]) for axis in (0, 1)), covered=_filled(local[:, :2]),
        waist=_waist(local), rough=_roughness(position, segments.normal[one.points]),
        holder=holder, held_by=held_by, wall_gap=_wall_gap(room, position), carries=carries,
        color=_color(table, faces), varied=_varied(table, faces),
        balance=float(np.average(local[:, 2], weights=weight) / max(2.0 * box.half_extents[2], 1e-9) + 0.5),
    )  # fmt: skip


def _floor(table: FaceTable, room: DecomposedRoom) -> float:
    """Height of the floor, or of the lowest point without a floor [m]."""
    level = room.shell.levels.floor
    return float(table.corners[..., 2].min()) if np.isnan(level) else level


def _color(table: FaceTable, faces: IntArray) -> tuple[float, float, float]:
    red, green, blue = lab2rgb(np.average(table.lab[faces], axis=0, weights=table.area[faces] + 1e-15))
    return float(red), float(green), float(blue)


def _varied(table: FaceTable, faces: IntArray) -> float:
    """Distance from the mean colour that is exceeded by a twentieth of the surface [CIELAB units]."""
    weight = table.area[faces] + 1e-15
    away = np.linalg.norm(table.lab[faces] - np.average(table.lab[faces], axis=0, weights=weight), axis=1)
    order = np.argsort(away, kind="stable")
    total = np.cumsum(weight[order])
    return float(away[order[min(int(np.searchsorted(total, 0.95 * total[-1])), len(order) - 1)]])


def _wall_gap(room: DecomposedRoom, position: Array) -> float:
    """Distance to the nearest wall plane [m]."""
    planes = room.shell.planes
    if not len(planes):
        return float("inf")
    return float(np.abs(position @ planes[:, :3].T - planes[:, 3]).min())


def _holder(segments: Segments, room: DecomposedRoom, i: int) -> tuple[int, str]:
    """Holder of a thing, on, at or against which it rests: (index of a thing or -1, name of a part of the room)."""
    one, levels = segments.alive[i], room.shell.levels
    position = segments.position[one.points]
    if not np.isnan(levels.floor) and one.low[2] < levels.floor + ON_FLOOR:
        return -1, FLOOR
    standing = {other: int(segments.standing(i, other).sum()) for other in one.touches}
    best = max(standing, key=lambda other: (standing[other], -other), default=-1)
    if best >= 0 and standing[best] >= FEW:
        return best, ""
    if not np.isnan(levels.ceiling) and one.high[2] > levels.ceiling - ON_FLOOR:
        return -1, CEILING
    if _wall_gap(room, position) < NEAR_WALL:
        return -1, WALL
    beside = {other: len(touch.a) for other, touch in one.touches.items() if len(touch.a) >= FEW}
    most = max(beside, key=lambda other: (beside[other], -other), default=-1)
    return (most, "") if most >= 0 else (-1, NOTHING)


def _levels(height: Array, area: Array, plan: float) -> tuple[Array, Array]:
    """Heights and areas of the upward surfaces, in order of decreasing area, each of shape (k,)."""
    heights, areas = [], []
    order = np.argsort(height, kind="stable")
    z, weight = height[order], area[order].copy()
    while weight.sum() > 0.02 * plan:
        total = np.concatenate([[0.0], np.cumsum(weight)])
        end = np.searchsorted(z, z + LEVEL_BAND, side="right")
        inside = total[end] - total[:-1]
        best = int(np.argmax(inside))
        window = slice(best, int(end[best]))
        if inside[best] <= 0.02 * plan:
            break
        heights.append(float(np.average(z[window], weights=weight[window] + 1e-15)))
        areas.append(float(inside[best]))
        weight[window] = 0.0
    return np.array(heights), np.array(areas)


def _filled(points: Array) -> float:
    """Share of the cells of the bounding rectangle of points (n, 2) that contain a point."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    cell = max(CELL, float(size.max()) / CELLS)
    count = np.maximum(np.rint(size / cell).astype(np.int64), 1)
    number = np.minimum((points - low) / np.maximum(size, 1e-9) * count, count - 1).astype(np.int64)
    return len(np.unique(number[:, 0] * count[1] + number[:, 1])) / float(count.prod())


def _waist(local: Array) -> float:
    """Breadth of the narrowest slice of height over that of the widest."""
    z = local[:, 2]
    number = np.minimum((z - z.min()) / max(float(np.ptp(z)), 1e-9) * SLICES, SLICES - 1).astype(np.int64)
    breadth = [float(np.ptp(local[number == k, :2], axis=0).max()) for k in np.unique(number)]
    return min(breadth) / max(*breadth, 1e-9) if len(breadth) > 1 else 1.0


def _roughness(position: Array, normal: Array) -> float:
    """One minus the share of the normals of neighbouring points that lies along their main direction, 0..2/3."""
    if len(position) < NEIGHBOURS:
        return 0.0
    near = normal[cKDTree(position).query(position, NEIGHBOURS)[1]]
    spread = np.linalg.eigvalsh(np.einsum("nki,nkj->nij", near, near) / NEIGHBOURS)
    return float(1.0 - spread[:, -1].mean())
