"""Bedrooms, children's rooms and bathrooms."""

from dcap.synthetic.furniture.bath import basin_cabinet, bathtub, mirror, toilet
from dcap.synthetic.furniture.beds import BedStyle, bed
from dcap.synthetic.furniture.decor import (
    book_row,
    book_stack,
    ceiling_lamp,
    curtain,
    floor_lamp,
    picture,
    plant,
    round_rug,
    rug,
    small_vase,
    table_lamp,
    toy_crate,
)
from dcap.synthetic.furniture.seats import chair, ottoman, sofa, stool
from dcap.synthetic.furniture.tables import (
    bedside_table,
    bookshelf,
    cabinet,
    desk,
    round_table,
    shelf_levels,
    table,
    wardrobe,
)
from dcap.synthetic.paint import Rgb, checks, dots, plain, planks, stripes, tiles
from dcap.synthetic.room import FurnishedRoom, Opening, Placed

OAK, WALNUT, PINE, CREAM = (188, 142, 92), (116, 78, 52), (218, 178, 122), (236, 230, 218)
SHELF = (0.90, 0.30, 1.80)
LINEN = (244, 242, 236)


def fill_shelf(
    room: FurnishedRoom,
    unit: Placed,
    seed: int,
    *,
    size: tuple[float, float, float] = SHELF,
    free: tuple[int, ...] = (2,),
) -> None:
    """Books on the left of every board but the free ones and the topmost, which stay empty."""
    levels = shelf_levels(size)
    room_above = levels[1] - levels[0] - 0.03
    for index, level in enumerate(levels[:-1]):
        if index not in free:
            length = (0.52, 0.74, 0.40, 0.62)[(index + seed) % 4] * (size[0] - 0.06)
            row = book_row(length, size[1] - 0.04, room_above, seed + index)
            room.upon(row, unit, right=-(size[0] - 0.06 - length) / 2 + 0.005, front=0.0, top=level)


def curtains(room: FurnishedRoom, opening: Opening, fabric: Rgb, seed: int) -> None:
    """A curtain on both sides of a window."""
    for side in (-1, 1):
        cloth = curtain(0.34, room.height - 0.20, fabric, seed + side)
        room.against(cloth, opening.wall, opening.at + side * (opening.width / 2 + 0.17), gap=0.075, z=0.05)


def light(room: FurnishedRoom) -> None:
    """A lamp in the middle of the ceiling."""
    room.put(ceiling_lamp(room.height), room.width / 2, room.depth / 2)


def bedroom_01(seed: int) -> FurnishedRoom:
    """A double bed between two bedside tables, a wardrobe, a bench under the window."""
    window = Opening("east", 2.3, 1.5, 0.85, 1.35, "WINDOW")
    room = FurnishedRoom(
        "bedroom_01",
        "Master Bedroom",
        4.2,
        4.0,
        2.7,
        (226, 230, 228),
        planks(OAK, 1),
        seed,
        (window, Opening("north", 0.75, 0.9, 0.0, 2.05, "DOOR")),
    )
    style = BedStyle(
        1.6,
        2.0,
        OAK,
        "channels",
        (108, 124, 142),
        LINEN,
        stripes((98, 130, 162), (232, 234, 232), "x", 0.30),
        (240, 240, 236),
        (250, 249, 245),
    )
    room.against(bed(style, seed + 1), "south", 2.05)
    left = room.against(bedside_table(OAK, CREAM, 3), "south", 2.95 + 0.22)
    room.against(bedside_table(OAK, CREAM, 4), "south", 1.15 - 0.22)
    room.upon(table_lamp((244, 228, 192), (70, 106, 128), 5), left, front=-0.05)
    room.against(wardrobe(CREAM, (240, 236, 226), 6), "west", 2.75)
    room.put(rug(2.4, 1.5, stripes((196, 202, 200), (150, 166, 172), "y", 0.5, 0.4), 7), 2.05, 2.2)
    room.against(ottoman((132, 146, 158), 8, (0.95, 0.42, 0.46)), "east", 2.3, gap=0.16)
    room.stand(plant(seed + 9, 1.15), 3.72, 3.5)
    room.against(picture(0.9, 0.6, 10), "south", 2.05, gap=0.0, z=1.62)
    curtains(room, window, (196, 204, 208), 11)
    light(room)
    return room


def bedroom_02(seed: int) -> FurnishedRoom:
    """A single bed of turned wood, a desk with a chair, a bookshelf."""
    window = Opening("north", 1.9, 1.3, 0.9, 1.3, "WINDOW")
    room = FurnishedRoom(
        "bedroom_02",
        "Bedroom",
        3.4,
        3.8,
        2.6,
        (238, 228, 208),
        planks(PINE, 2),
        seed,
        (window, Opening("south", 2.75, 0.85, 0.0, 2.05, "DOOR")),
    )
    style = BedStyle(
        1.0,
        2.0,
        PINE,
        "bars",
        (0, 0, 0),
        LINEN,
        checks((182, 78, 70), (242, 222, 194), 0.22),
        (240, 226, 206),
        stripes((246, 244, 238), (206, 140, 128), "x", 0.08, 0.25),
        1,
    )
    room.against(bed(style, seed + 1), "west", 0.75, gap=0.03)
    table_ = room.against(bedside_table(PINE, PINE, 2), "west", 1.58)
    room.upon(book_stack(2, 3), table_, right=-0.08, front=-0.09)
    worktop = room.against(desk(PINE, CREAM, 4, 1.20, 0.62), "east", 2.55)
    room.upon(table_lamp((236, 214, 170), (150, 70, 60), 5), worktop, right=-0.44, front=-0.12)
    room.put(chair(PINE, (182, 84, 74), 6), 2.35, 2.50, -90.0)
    unit = room.against(bookshelf(PINE, 7), "west", 2.70)
    fill_shelf(room, unit, 8)
    room.put(round_rug(0.72, (238, 222, 196), (186, 96, 82), 9), 1.75, 1.95)
    room.against(picture(0.5, 0.7, 12), "east", 1.0, gap=0.0, z=1.5)
    curtains(room, window, (222, 196, 160), 13)
    light(room)
    return room


def bedroom_03(seed: int) -> FurnishedRoom:
    """A king bed with a panel headboard, an armchair and a round table in the corner, a floor lamp."""
    window = Opening("south", 3.6, 1.6, 0.8, 1.4, "WINDOW")
    room = FurnishedRoom(
        "bedroom_03",
        "Master Bedroom",
        5.0,
        4.4,
        2.8,
        (208, 214, 202),
        planks(WALNUT, 3),
        seed,
        (window, Opening("east", 3.6, 0.9, 0.0, 2.1, "DOOR")),
    )
    style = BedStyle(
        1.8,
        2.1,
        WALNUT,
        "panel",
        (0, 0, 0),
        (240, 238, 228),
        plain((104, 124, 96)),
        (222, 218, 196),
        (244, 242, 232),
        mattress=0.27,
    )
    room.against(bed(style, seed + 1), "west", 2.2)
    room.against(bedside_table(WALNUT, WALNUT, 2), "west", 3.42)
    right = room.against(bedside_table(WALNUT, WALNUT, 3), "west", 0.98)
    room.upon(table_lamp((240, 232, 206), (196, 170, 110), 4), right, front=-0.04)
    room.put(rug(2.6, 2.0, checks((206, 200, 178), (150, 158, 130), 0.5), 5), 2.2, 2.2)
    room.put(sofa(1, (188, 150, 92), (200, 162, 104), 6, "armchair", seat=0.60, depth=0.82, arm=0.16), 4.35, 0.78, 40.0)
    room.put(round_table(0.27, 0.52, WALNUT, 7, "side table"), 3.45, 0.52)
    room.put(floor_lamp((246, 232, 200), (70, 62, 52), 8), 4.72, 1.62)
    low = room.against(cabinet((1.4, 0.42, 0.80), WALNUT, WALNUT, 9, "cabinet", columns=3, rows=2), "north", 2.6)
    room.upon(small_vase((190, 150, 90), 10), low, right=0.45)
    room.against(picture(1.2, 0.7, 14), "west", 2.2, gap=0.0, z=1.75)
    room.stand(plant(seed + 11, 1.3, (120, 120, 116)), 4.5, 2.75)
    curtains(room, window, (214, 206, 184), 12)
    light(room)
    return room


def guest_01(seed: int) -> FurnishedRoom:
    """A guest room: a bed without headroom clutter, a stool as bedside, a wardrobe."""
    window = Opening("west", 1.7, 1.2, 0.9, 1.25, "WINDOW")
    room = FurnishedRoom(
        "guest_01",
        "Guest Room",
        3.3,
        3.5,
        2.6,
        (232, 220, 222),
        planks((204, 184, 156), 4),
        seed,
        (window, Opening("south", 0.65, 0.85, 0.0, 2.05, "DOOR")),
    )
    style = BedStyle(
        1.4,
        2.0,
        (224, 218, 208),
        "channels",
        (176, 132, 138),
        LINEN,
        dots((170, 116, 126), (240, 226, 222), 0.20, 0.05),
        (238, 224, 222),
        (250, 248, 244),
        blanket_start=0.5,
    )
    room.against(bed(style, seed + 1), "north", 1.75)
    room.put(stool((206, 166, 112), (176, 132, 84), 2), 0.62, 3.1)
    stand = room.against(bedside_table((224, 218, 208), (236, 230, 222), 3), "north", 2.78)
    room.upon(table_lamp((246, 226, 214), (206, 150, 146), 4), stand)
    room.against(wardrobe((226, 220, 212), (240, 236, 230), 5, (1.0, 0.58, 2.0)), "east", 0.85)
    room.put(rug(1.6, 1.0, plain((214, 190, 188)), 6), 1.5, 0.8)
    room.against(picture(0.6, 0.45, 15), "north", 1.75, gap=0.0, z=1.6)
    curtains(room, window, (232, 214, 212), 7)
    light(room)
    return room


def kids_01(seed: int) -> FurnishedRoom:
    """A child's bed with dots, a low play table with two stools, a crate of toys, a low shelf."""
    window = Opening("east", 1.6, 1.3, 0.9, 1.25, "WINDOW")
    room = FurnishedRoom(
        "kids_01",
        "Children Room",
        3.8,
        3.6,
        2.6,
        (206, 224, 234),
        planks((222, 196, 154), 5),
        seed,
        (window, Opening("west", 0.7, 0.85, 0.0, 2.05, "DOOR")),
    )
    style = BedStyle(
        0.9,
        1.9,
        (244, 240, 230),
        "panel",
        (0, 0, 0),
        (250, 246, 236),
        dots((84, 150, 190), (250, 220, 110), 0.20, 0.05),
        (250, 226, 130),
        dots((250, 250, 246), (226, 110, 96), 0.10, 0.022),
        1,
        mattress=0.20,
    )
    room.against(bed(style, seed + 1), "north", 2.95)
    room.put(table((0.80, 0.58, 0.50), PINE, 2, "table", "square"), 1.35, 1.55)
    room.put(stool((232, 96, 80), PINE, 3, 0.30, 0.14), 1.35, 0.95)
    room.put(stool((96, 160, 190), PINE, 4, 0.30, 0.14), 0.62, 1.60)
    room.against(toy_crate(seed + 5), "south", 3.3)
    size = (1.1, 0.30, 1.0)
    unit = room.against(bookshelf((244, 240, 230), 6, size, boards=4), "north", 0.95)
    room.upon(book_row(0.5, 0.26, 0.27, 7), unit, right=-0.25, top=shelf_levels(size, 4)[0])
    room.upon(book_row(0.4, 0.26, 0.27, 8), unit, right=0.25, top=shelf_levels(size, 4)[2])
    room.put(round_rug(0.85, (250, 232, 160), (120, 180, 200), 9), 2.35, 1.25)
    room.against(picture(0.7, 0.5, 16), "north", 0.95, gap=0.0, z=1.5)
    room.stand(plant(seed + 2, 0.8, (232, 150, 90)), 2.1, 3.3)
    curtains(room, window, (250, 224, 140), 10)
    light(room)
    return room


def kids_02(seed: int) -> FurnishedRoom:
    """A teenager's room: bed along the wall, desk, an upholstered stool, a bookshelf."""
    window = Opening("south", 1.3, 1.2, 0.9, 1.3, "WINDOW")
    room = FurnishedRoom(
        "kids_02",
        "Children Room",
        3.6,
        3.4,
        2.6,
        (222, 216, 232),
        planks(OAK, 6),
        seed,
        (window, Opening("north", 2.9, 0.85, 0.0, 2.05, "DOOR")),
    )
    style = BedStyle(
        1.0,
        2.0,
        OAK,
        "channels",
        (120, 106, 150),
        (244, 242, 246),
        stripes((140, 124, 172), (228, 222, 238), "y", 0.26, 0.4),
        (236, 232, 244),
        (206, 198, 226),
        1,
    )
    room.against(bed(style, seed + 1), "west", 2.35, gap=0.03)
    worktop = room.against(desk(OAK, CREAM, 2, 1.25, 0.62), "south", 1.30)
    room.upon(table_lamp((232, 226, 242), (120, 106, 150), 3), worktop, right=-0.46, front=-0.12)
    room.put(chair(OAK, None, 4), 1.20, 0.95, 180.0)
    unit = room.against(bookshelf(OAK, 5), "east", 1.55)
    fill_shelf(room, unit, 6, free=(1,))
    room.put(ottoman((150, 132, 178), 7, (0.46, 0.46, 0.44)), 2.5, 2.2)
    room.put(rug(1.3, 0.9, checks((232, 228, 240), (160, 146, 190), 0.3), 8), 2.15, 1.35)
    room.against(picture(0.5, 0.7, 17), "west", 2.6, gap=0.0, z=1.55)
    curtains(room, window, (206, 198, 222), 9)
    light(room)
    return room


TILE = tiles((214, 222, 222), (168, 178, 178), 0.33)


def bathroom_01(seed: int) -> FurnishedRoom:
    """A bathtub under the window, a washstand with mirror, a toilet, a wooden stool."""
    window = Opening("north", 1.5, 1.0, 1.25, 0.95, "WINDOW")
    room = FurnishedRoom(
        "bathroom_01",
        "Bathroom",
        3.0,
        2.7,
        2.5,
        (226, 234, 232),
        TILE,
        seed,
        (window, Opening("south", 0.65, 0.8, 0.0, 2.05, "DOOR")),
    )
    room.against(bathtub(1), "north", 1.25, gap=0.12)
    room.against(basin_cabinet(OAK, 2), "east", 1.05)
    room.against(mirror(), "east", 1.05, gap=0.0, z=1.55)
    room.against(toilet(3), "south", 2.0, gap=0.02)
    room.put(stool(OAK, OAK, 4, 0.42, 0.16), 2.55, 2.1)
    room.put(rug(0.80, 0.50, stripes((240, 240, 236), (110, 158, 160), "x", 0.2), 5), 1.2, 1.25)
    light(room)
    return room


def bathroom_02(seed: int) -> FurnishedRoom:
    """A larger bathroom: tub along the wall, a low cabinet for towels, a stool, a plant."""
    window = Opening("east", 1.6, 1.1, 1.0, 1.2, "WINDOW")
    room = FurnishedRoom(
        "bathroom_02",
        "Bathroom",
        3.4,
        3.2,
        2.6,
        (236, 230, 220),
        tiles((206, 196, 184), (164, 152, 140), 0.40),
        seed,
        (window, Opening("west", 2.5, 0.8, 0.0, 2.05, "DOOR")),
    )
    room.against(bathtub(6), "south", 2.2, gap=0.16)
    room.against(basin_cabinet(WALNUT, 7), "north", 1.2)
    room.against(mirror(0.8, 0.7), "north", 1.2, gap=0.0, z=1.55)
    room.against(cabinet((0.9, 0.38, 0.70), WALNUT, WALNUT, 8, "storage cabinet", columns=2, rows=2), "west", 1.1)
    room.put(stool(WALNUT, WALNUT, 9, 0.45, 0.17), 2.6, 1.35)
    room.put(rug(0.9, 0.55, plain((190, 168, 142)), 10), 1.9, 1.25)
    room.stand(plant(seed + 3, 1.0, (150, 140, 128)), 3.05, 2.85)
    light(room)
    return room
