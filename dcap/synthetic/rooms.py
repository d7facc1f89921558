"""A room of a recipe: furnished, then built into a scan with its annotations and truth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.writers.interiorgs import Hole, Label, RoomRecord, Wall
from dcap.synthetic.furniture.decor import book_row, ceiling_lamp, curtain
from dcap.synthetic.recipes import (
    BookFill,
    CurtainRecipe,
    RoomRecipe,
    ThingRecipe,
    UponPlace,
    WindowRecipe,
    room_recipe,
)
from dcap.synthetic.room import WALL_THICKNESS, WALLS, FurnishedRoom, Opening, Placed, to_room, wall_length
from dcap.synthetic.scan import RoomScan, ScanSurface, scan
from dcap.synthetic.shapes import Assembly, moved, rotation
from dcap.synthetic.shell import shell

BOOK_SHARES = (0.52, 0.74, 0.40, 0.62)
"""Shares of a board's length that books take, from board to board."""
SIDE_BOARDS = 0.06
"""Width taken by a shelf's sides and some clearance [m]."""
HEADROOM = 0.03
"""Distance between a book of full height and the board above, including the board's thickness [m]."""
SEEDS_APART = 1000
"""Difference between the seeds of a room in successive rounds of a dataset."""
BOX_MARGIN = 0.001
"""Margin of boxes around their content [m]."""
NOT_STANDING = ("rug", "ceiling lamp", "picture", "mirror", "window", "curtain")
"""Things that leave the floor free in the occupancy map."""


def furnish(recipe: RoomRecipe, seed: int) -> FurnishedRoom:
    """The furnished room; pieces that vary depend on the seed."""
    room = FurnishedRoom(recipe.kind, *recipe.size, recipe.wall, recipe.floor, seed, _openings(recipe))
    named: dict[str, Placed] = {}
    for thing in recipe.things:
        built = thing.piece.build(**_varied(thing, seed))
        placed = _set(room, built, thing, named)
        named[thing.name] = placed
        if thing.books:
            _fill_shelf(room, built, placed, thing.books)
    for window in recipe.windows:
        if window.curtains:
            _hang(room, window, window.curtains)
    room.put(ceiling_lamp(room.height), room.width / 2, room.depth / 2)
    return room


def _openings(recipe: RoomRecipe) -> tuple[Opening, ...]:
    return (
        *(Opening(o.wall, o.along, o.width, o.sill, o.height, "WINDOW") for o in recipe.windows),
        *(Opening(o.wall, o.along, o.width, 0.0, o.height, "DOOR") for o in recipe.doors),
    )


def _varied(thing: ThingRecipe, room_seed: int) -> dict[str, object]:
    """The arguments that differ from the recipe."""
    own = thing.piece.arguments.get("seed")
    return {"seed": room_seed + own} if thing.varies and isinstance(own, int) else {}


def _set(room: FurnishedRoom, built: Assembly, thing: ThingRecipe, named: dict[str, Placed]) -> Placed:
    """Put a piece in the place of its recipe."""
    if thing.at:
        return room.put(built, **dict(thing.at))
    if thing.stand:
        return room.stand(built, **dict(thing.stand))
    if thing.against:
        return room.against(built, **dict(thing.against))
    assert thing.upon is not None, "a thing has exactly one place"
    below, place = named[thing.upon.thing], thing.upon
    return room.upon(built, below, place.right, place.front, place.yaw_deg, _height(place, below))


def _height(place: UponPlace, below: Placed) -> float | None:
    return place.top if place.board is None else board_heights(below.thing)[place.board]


def board_heights(shelf: Assembly) -> list[float]:
    """Heights of the upper faces of a shelf's boards, from the lowest [m]."""
    return [float(solid.bounds[1, 2]) for part in shelf.parts if part.name == "board" for solid in part.solids]


def _fill_shelf(room: FurnishedRoom, shelf: Assembly, placed: Placed, books: BookFill) -> None:
    """Put books on the left of every board except the free ones and the topmost."""
    width, depth, _ = np.ptp(shelf.bounds, axis=0)
    levels = board_heights(shelf)
    for index, level in enumerate(levels[:-1]):
        if index not in books.free:
            length = BOOK_SHARES[(index + books.seed) % len(BOOK_SHARES)] * (width - SIDE_BOARDS)
            row = book_row(length, depth - 0.04, levels[1] - levels[0] - HEADROOM, books.seed + index)
            room.upon(row, placed, right=-(width - SIDE_BOARDS - length) / 2 + 0.005, top=level)


def _hang(room: FurnishedRoom, window: WindowRecipe, curtains: CurtainRecipe) -> None:
    """A curtain on both sides of a window."""
    for side in (-1, 1):
        cloth = curtain(0.34, room.height - 0.20, curtains.fabric, curtains.seed + side)
        room.against(cloth, window.wall, window.along + side * (window.width / 2 + 0.17), gap=0.075, z=0.05)


@dataclass(frozen=True, eq=False, slots=True)
class BuiltRoom:
    """A room ready to be written."""

    record: RoomRecord
    instance_ids: tuple[str, ...]
    """Truth: id per instance index; unlike in the annotation, never empty."""
    instance_labels: tuple[str, ...]
    """Labels of the instances in lower case."""
    face_instance: NDArray[np.int32]
    """Truth: index of the instance of each face of the mesh, shape (m,)."""
    face_part: NDArray[np.object_]
    """Truth: part name of each face, shape (m,)."""


@dataclass(frozen=True, eq=False, slots=True)
class _Labelled:
    label: str
    yaw_deg: float
    boxed: bool


def build_room(name: str, seed: int) -> BuiltRoom:
    """Furnish, scan and annotate one of the embedded rooms."""
    return build_recipe(room_recipe(name), seed)


def build_recipe(recipe: RoomRecipe, seed: int) -> BuiltRoom:
    """Furnish, scan and annotate a room; each room has its own place in the world."""
    own_seed = seed * SEEDS_APART + recipe.seed
    room = furnish(recipe, own_seed)
    rng = np.random.default_rng(own_seed)
    offset = np.round(rng.uniform(-4.0, 4.0, 2), 3)
    things, surfaces = _surfaces(room, offset)
    scanned = scan(surfaces, own_seed, recipe.scan)
    ids = tuple(str(int(n)) for n in rng.choice(np.arange(100, 1000), len(things), replace=False))
    boxes = [_box(scanned, index, thing.yaw_deg) for index, thing in enumerate(things)]
    record = RoomRecord(
        kind=room.kind,
        profile=offset + np.array([[0, 0], [room.width, 0], [room.width, room.depth], [0, room.depth]]),
        walls=_walls(room, offset),
        holes=tuple(_hole(room, o, offset) for o in room.openings),
        labels=_labels(room, things, boxes, ids, rng),
        obstacles=tuple(
            box.corners[:4, :2]
            for thing, box in zip(things, boxes, strict=True)
            if thing.boxed and thing.label not in ("floor", "ceiling", *NOT_STANDING) and box.bottom < 1.8
        ),
        mesh=scanned.mesh,
    )
    return BuiltRoom(record, ids, tuple(t.label.lower() for t in things), scanned.face_instance, scanned.face_part)


def _surfaces(room: FurnishedRoom, offset: Array) -> tuple[list[_Labelled], list[ScanSurface]]:
    """Every instance of the room and every surface, in world coordinates."""
    around = shell(room)
    things: list[_Labelled] = []
    surfaces: list[ScanSurface] = []
    walls: dict[str, int] = {}
    for label, mesh in around.sheets:
        walls[label] = len(things)
        things.append(_Labelled(label.split()[0], 0.0, boxed=not label.startswith("wall")))
        surfaces.append(ScanSurface(moved(mesh, *offset), walls[label], label.split()[0], closed=False))
    placed = [(item, 0.0) for item in around.things] + [(p.thing, p.yaw_deg) for p in room.things]
    for item, yaw_deg in placed:
        if item.label not in walls:
            things.append(_Labelled(item.label, yaw_deg, boxed=True))
        index = walls.get(item.label, len(things) - 1)
        surfaces += [ScanSurface(moved(m, *offset), index, p.name, closed=True) for p in item.parts for m in p.solids]
    return things, surfaces


def _box(scanned: RoomScan, instance: int, yaw_deg: float) -> OrientedBox:
    """The box of an instance's faces, turned like the piece."""
    axes = rotation("z", yaw_deg)
    faces = scanned.mesh.faces[scanned.face_instance == instance]
    local = scanned.mesh.vertices[np.unique(faces)] @ axes
    low, high = local.min(axis=0) - BOX_MARGIN, local.max(axis=0) + BOX_MARGIN
    return OrientedBox(axes @ ((low + high) / 2), axes, (high - low) / 2)


def _labels(room: FurnishedRoom, things: list[_Labelled], boxes: list[OrientedBox], ids: tuple[str, ...],
            rng: np.random.Generator) -> tuple[Label, ...]:  # fmt: skip
    """Annotations in mixed case and random order: a room and walls without boxes, a ceiling lamp without an id."""
    labels = [Label("", "room", None)]
    for index, thing in enumerate(things):
        name = thing.label.capitalize() if rng.random() < 0.4 else thing.label
        box = boxes[index] if thing.boxed else None
        labels.append(Label("" if thing.label == "ceiling lamp" else ids[index], name, box))
    return tuple(labels[int(i)] for i in rng.permutation(len(labels)))


def _walls(room: FurnishedRoom, offset: Array) -> tuple[Wall, ...]:
    """Centre lines of the four walls, which lie outside the floor polygon."""
    walls = []
    for name in WALLS:
        length = wall_length(room, name)
        middle = WALL_THICKNESS / 2
        ends = to_room(room, name, np.array([[-middle, middle, 0.0], [length + middle, middle, 0.0]]))[:, :2] + offset
        walls.append(Wall(ends[0], ends[1], WALL_THICKNESS, room.height))
    return tuple(walls)


def _hole(room: FurnishedRoom, o: Opening, offset: Array) -> Hole:
    low, high, a, b = o.sill, o.sill + o.height, o.at - o.width / 2, o.at + o.width / 2
    depth = WALL_THICKNESS / 2
    corners = to_room(room, o.wall, np.array([[a, depth, low], [b, depth, low], [b, depth, high], [a, depth, high]]))
    return Hole(o.kind, corners + np.array([*offset, 0.0]), WALL_THICKNESS)
