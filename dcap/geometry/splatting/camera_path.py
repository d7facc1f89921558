"""Cameras that together show a scene of Gaussians: looking around where people can walk, and around its furniture.

In: Gaussians in metres and z up, and the available annotations (a map of the floor, rooms, labelled boxes). Out:
upright cameras that overlap, none of them inside a thing or directly in front of a surface. Without a map, cameras
stand where Gaussians lie all around; a scene without an inside is viewed from all sides. Same input, same cameras.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice, zip_longest
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field, NonNegativeInt, PositiveFloat, PositiveInt
from scipy.ndimage import distance_transform_edt

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.segmentation.labels import Category, category_of
from dcap.geometry.splatting.filled_cells import FilledCells, filled_cells
from dcap.geometry.splatting.viewpoints import CANDIDATES, bulk, far_apart_index, inner_places, outer_places
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.floor_plan import Occupancy
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.scan import LabelBox, Room

FURNITURE = frozenset({
    Category.BED, Category.SOFA, Category.CHAIR, Category.STOOL, Category.TABLE, Category.CABINET, Category.SHELF,
    Category.STORAGE, Category.BATHTUB, Category.BASIN,
})  # fmt: skip
"""Categories of furniture on or in which things are put, and which are viewed from all around."""
MOST_STANDS = 6000
"""Maximum number of places on the floor that are considered [-]."""
AIM_HEIGHT, AIM_AWAY = 1.2, 2.0
"""Height above the floor and distance of the target of a camera that looks around [m]: low cameras look up, high ones
down."""
NOD = np.deg2rad(12.0)
"""Pitch by which every other picture of a place is raised, and the others lowered [rad]."""
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
"""Turn from each place's first direction to that of the next [rad]: no two have the same direction."""
RAYS = (8, 6)
"""Columns and rows of rays that test the view of a camera [-]."""
OPEN, SEEN = 0.5, 0.2
"""Least shares of these rays that go far enough, and that hit anything [-]."""
ALONGSIDE = 0.4
"""Least distance of a camera from the box of its target [m]."""
STEEPNESS = (np.deg2rad(5.0), np.deg2rad(50.0))
"""Range of the downward pitch of a camera that looks at furniture, if possible [rad]."""
UNHIDDEN = 0.4
"""Least unobstructed share of a piece's box, relative to the best place [-]."""
RINGS = (0.8, 1.4)
"""Distances of cameras from a piece, over the distance that shows all of it [-]."""
RING_WIDTH = 0.15
"""Tolerance of such a distance, over it [-]."""
MOST_AROUND = 24
"""Maximum number of cameras for one piece of furniture while there are others [-]."""
MOST_LOOKS = 200
"""Number of places near a ring that are tested for a view of a piece [-]."""
BOX_POINTS = np.array([(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1)], dtype=np.float64)
"""Target points on a box, over its half extents [-]."""


class PathConfig(BaseModel, frozen=True, extra="forbid"):
    """Number and kind of the pictures."""

    views: PositiveInt = 300
    """Cameras."""
    width: PositiveInt = 960
    """[pixel]."""
    height: PositiveInt = 720
    field_of_view_deg: Annotated[float, Field(gt=0.0, lt=170.0)] = 75.0
    """Horizontal [degree]."""
    directions: PositiveInt = 8
    """Pictures per place when looking around."""
    orbits: Annotated[float, Field(ge=0.0, le=1.0)] = 0.5
    """Share of the cameras that look at furniture, if there is any [-]."""
    heights: tuple[PositiveFloat, ...] = (0.9, 1.5, 2.0)
    """Of the cameras above the floor [m]."""
    clearance: PositiveFloat = 0.25
    """Least distance of a camera from what is opaque [m]."""
    nearest: PositiveFloat = 1.0
    """A camera that sees nothing but what is nearer than this is left out [m]."""
    seed: NonNegativeInt = 0


@dataclass(frozen=True, eq=False, slots=True)
class CameraPath:
    """Cameras for pictures of a scene."""

    cameras: tuple[Camera, ...]
    notes: tuple[str, ...]
    """Assumptions and omissions, one sentence each."""


def camera_path(
    splats: Gaussians,
    config: PathConfig,
    *,
    boxes: Sequence[LabelBox] = (),
    rooms: Sequence[Room] = (),
    occupancy: Occupancy | None = None,
) -> CameraPath:
    """Up to `config.views` cameras: around furniture first, then looking around."""
    random = np.random.default_rng(config.seed)
    cells = filled_cells(splats)
    stands, notes = standing_places(splats, cells, config, random, rooms, occupancy)
    if not len(stands):
        return CameraPath(tuple(all_around(splats, config)), notes)
    pieces = [one for one in boxes if category_of(one.label) in FURNITURE]
    found, hidden = orbits(pieces, stands, cells, config)
    if hidden:
        notes += (f"no free place shows {', '.join(hidden)}",)
    around = worthwhile(found, cells, config)
    wanted = min(round(config.orbits * config.views), MOST_AROUND * len(pieces))
    cameras = list(islice(around, wanted))
    floor = cells.floor(stands)
    walk = walking(stands, float(bulk(splats)[0][2]) if floor is None else floor, config)
    cameras += islice(chain(worthwhile(walk, cells, config), around), config.views - len(cameras))
    if len(cameras) < config.views:
        notes += (f"{len(cameras)} of {config.views} views: there are no more places to stand",)
    return CameraPath(tuple(cameras), notes)


def standing_places(
    splats: Gaussians,
    cells: FilledCells,
    config: PathConfig,
    random: np.random.Generator,
    rooms: Sequence[Room],
    occupancy: Occupancy | None,
) -> tuple[Array, tuple[str, ...]]:
    """Possible camera positions [m], in random order, shape (n, 3), and notes."""
    if occupancy is None:
        return inner_places(splats, CANDIDATES, config.seed), ()
    inside = occupancy.within([room.profile for room in rooms])
    free = occupancy.free & inside if (occupancy.free & inside).any() else occupancy.free
    distance = distance_transform_edt(np.pad(free, 1))[1:-1, 1:-1] * occupancy.scale
    rows, columns = np.nonzero(distance > config.clearance)
    some = random.permutation(len(rows))[:MOST_STANDS]
    flat = np.c_[occupancy.world(rows[some], columns[some]), np.zeros(len(some))]
    floor = cells.floor(flat)
    if floor is not None:
        places = (flat[:, None] + [[0.0, 0.0, floor + height] for height in config.heights]).reshape(-1, 3)
        places = places[random.permutation(len(places))]
        places = places[cells.clearance(places) > config.clearance]
        if len(places):
            return places, ()
    note = "no free cell of occupancy.png has room for a camera; placing cameras where splats lie all around"
    return inner_places(splats, CANDIDATES, config.seed), (note,)


def walking(stands: Array, floor: float, config: PathConfig) -> Iterator[Camera]:
    """Cameras that look around at places far apart from each other; `floor` is its height [m]."""
    # twice as many places as needed, for cameras that will be left out
    count = -(-2 * config.views // config.directions)
    for number, k in enumerate(far_apart_index(stands[:, :2], count)):
        down = np.arctan2(stands[k, 2] - floor - AIM_HEIGHT, AIM_AWAY)
        for i in range(config.directions):
            yaw = number * GOLDEN + 2.0 * np.pi * i / config.directions
            pitch = -down + (NOD if i % 2 else -NOD)
            ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
            yield _looking(stands[k], stands[k] + ahead, config)


def orbits(
    pieces: Sequence[LabelBox], stands: Array, cells: FilledCells, config: PathConfig
) -> tuple[list[Camera], tuple[str, ...]]:
    """Cameras around the pieces in turn, largest piece first, alternating between two distances; and names of pieces
    that no place shows."""
    pieces = sorted(pieces, key=lambda one: (-float(np.prod(one.box.half_extents)), one.id))
    each = -(-2 * round(config.orbits * config.views) // max(len(pieces), 1)) if pieces else 0
    found = [_orbit(one.box, stands, cells, config, each) for one in pieces]
    hidden = tuple(one.label for one, cameras in zip(pieces, found, strict=True) if not cameras and each)
    return [camera for turn in zip_longest(*found) for camera in turn if camera is not None], hidden


def _orbit(box: OrientedBox, stands: Array, cells: FilledCells, config: PathConfig, count: int) -> list[Camera]:
    """Up to `count` cameras that look at a box, from all accessible sides."""
    whole = 0.5 * box.diagonal / np.sin(_least_half_angle(config))
    distance = np.linalg.norm(stands - box.center, axis=1)
    local = np.abs(box.to_local(stands)) - box.half_extents
    apart = np.linalg.norm(np.maximum(local, 0.0), axis=1) > ALONGSIDE
    rings = [
        _ring(box, stands[apart], distance[apart], max(factor * whole, config.nearest), cells, -(-count // 2))
        for factor in RINGS
    ]
    turns = chain.from_iterable(zip_longest(*rings))
    return [_looking(place, box.center, config) for place in turns if place is not None]


def _ring(
    box: OrientedBox, stands: Array, distance: Array, wanted: float, cells: FilledCells, count: int
) -> list[Array]:
    """Places at about a distance, or as near to it as available, that see a box."""
    off = np.abs(np.log(distance / wanted))
    order = np.argsort(off, kind="stable")
    near = order[: max(int((off < RING_WIDTH).sum()), 4 * count)]
    down = np.arcsin((stands[near, 2] - box.center[2]) / distance[near])
    steep = (down > STEEPNESS[0]) & (down < STEEPNESS[1])
    near = (near[steep] if steep.any() else near)[:MOST_LOOKS]
    shown = unhidden(box, stands[near], cells)
    places = stands[near[(shown > 0.0) & (shown >= UNHIDDEN * shown.max(initial=0.0))]]
    return list(places[far_apart_index(places[:, :2], count)])


def unhidden(box: OrientedBox, places: Array, cells: FilledCells) -> Array:
    """Unobstructed share of the box's corners, edges and sides, seen from places (n, 3) outside [-]."""
    targets = box.to_world(BOX_POINTS * box.half_extents)
    way = (targets[None] - places[:, None]).reshape(-1, 3)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    origins = np.repeat(places, len(targets), axis=0)
    # cells filled by the thing reach beyond its box
    entry = entries(box, origins, way, margin=2.0 * cells.size)
    clear = cells.cast(origins, way, entry - cells.size) == np.inf
    return np.asarray(clear.reshape(len(places), len(targets)).mean(axis=1))


def entries(box: OrientedBox, origins: Array, directions: Array, margin: float) -> Array:
    """Distance at which rays (n, 3) that meet a box grown by `margin` enter it [m], 0 from inside, shape (n,)."""
    start, way = box.to_local(origins), directions @ box.axes
    with np.errstate(divide="ignore", invalid="ignore"):  # along a side: infinite, or nan on it
        sides = (np.stack([-(box.half_extents + margin), box.half_extents + margin]) - start[:, None]) / way[:, None]
    return np.asarray(np.maximum(np.nanmin(sides, axis=1).max(axis=1), 0.0))


def worthwhile(cameras: Iterable[Camera], cells: FilledCells, config: PathConfig) -> Iterator[Camera]:
    """Yield the cameras that are in free space and see something farther away than right in front of them."""
    for camera in cameras:
        columns, rows = (
            np.floor((np.arange(count) + 0.5) * size / count) + 0.5
            for count, size in zip(RAYS, (camera.width, camera.height), strict=True)
        )
        row, column = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
        ways = camera.directions(np.stack([column, row], axis=1))
        distance = cells.cast(np.broadcast_to(camera.position, ways.shape), ways)
        free = distance.min() > 0.0 and (distance > config.nearest).mean() >= OPEN
        if free and np.isfinite(distance).mean() >= SEEN:
            yield camera


def all_around(splats: Gaussians, config: PathConfig) -> Iterator[Camera]:
    """Cameras around a scene without an inside, far enough away that all of it is in the picture."""
    places, center = outer_places(splats, config.views, 2.0 * _least_half_angle(config))
    return (_looking(place, center, config) for place in places)


def _looking(place: Array, target: Array, config: PathConfig) -> Camera:
    return looking_at(place, target, config.width, config.height, fov_deg=config.field_of_view_deg)


def _least_half_angle(config: PathConfig) -> float:
    """Half of the narrower field of view [rad]."""
    half = 0.5 * np.deg2rad(config.field_of_view_deg)
    return float(np.arctan(np.tan(half) * min(1.0, config.height / config.width)))
