"""Furnishes a room by its recipe: builds every piece and puts it in its place."""

import numpy as np

from dcap.synthetic.assembly import Assembly
from dcap.synthetic.furniture.decor import book_row, ceiling_lamp, curtain
from dcap.synthetic.recipes import BookFill, CurtainRecipe, RoomRecipe, ThingRecipe, UponPlace, WindowRecipe
from dcap.synthetic.room import FurnishedRoom, Opening, Placed

BOOK_SHARES = (0.52, 0.74, 0.40, 0.62)
"""Shares of a board's length that books take, from board to board."""
SIDE_BOARDS = 0.06
"""Width taken by a shelf's sides and some clearance [m]."""
HEADROOM = 0.03
"""Distance between a book of full height and the board above, including the board's thickness [m]."""


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
