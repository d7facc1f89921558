"""Living rooms, studies, dining rooms and a hall."""

from dcap.synthetic.furniture.bath import mirror
from dcap.synthetic.furniture.decor import (
    book_stack,
    cushion_on_slope,
    floor_lamp,
    picture,
    plant,
    round_rug,
    rug,
    small_vase,
    table_lamp,
    television,
)
from dcap.synthetic.furniture.seats import chair, office_chair, ottoman, sofa, stool
from dcap.synthetic.furniture.tables import bookshelf, cabinet, desk, round_table, table
from dcap.synthetic.paint import checks, dots, planks, stripes
from dcap.synthetic.room import FurnishedRoom, Opening
from dcap.synthetic.rooms_night import CREAM, OAK, PINE, WALNUT, curtains, fill_shelf, light


def living_01(seed: int) -> FurnishedRoom:
    """A sofa for three before a low table and a television, an armchair, a shelf, a floor lamp."""
    window = Opening("east", 2.2, 1.8, 0.6, 1.6, "WINDOW")
    room = FurnishedRoom(
        "living_01",
        "Living Room",
        5.2,
        4.4,
        2.8,
        (234, 228, 216),
        planks(OAK, 11),
        seed,
        (window, Opening("west", 3.7, 0.95, 0.0, 2.1, "DOOR")),
    )
    room.against(sofa(3, (118, 132, 124), (130, 145, 136), 1, "Multi person sofa"), "south", 2.4, gap=0.05)
    room.put(rug(2.6, 1.7, checks((222, 212, 190), (186, 150, 116), 0.5), 2), 2.4, 1.95)
    room.put(table((1.15, 0.62, 0.42), WALNUT, 3, "teatable", "square"), 2.4, 1.85)
    low = room.against(cabinet((1.7, 0.42, 0.48), WALNUT, CREAM, 4, "tv cabinet", columns=3), "north", 2.4)
    room.upon(television(1.15), low, front=-0.06)
    room.put(sofa(1, (190, 122, 78), (204, 136, 90), 5, "armchair", seat=0.60, depth=0.84, arm=0.16), 4.30, 3.1, 125.0)
    room.put(floor_lamp((246, 230, 194), (62, 60, 58), 6), 4.1, 0.55)
    unit = room.against(bookshelf(WALNUT, 7), "west", 2.3)
    fill_shelf(room, unit, 8)
    room.stand(plant(seed + 9, 1.25), 0.5, 0.6)
    room.against(picture(1.1, 0.7, 20), "south", 2.4, gap=0.0, z=1.6)
    curtains(room, window, (216, 204, 180), 10)
    light(room)
    return room


def living_02(seed: int) -> FurnishedRoom:
    """A sofa for two with a cushion leaning in its corner, a round table, a sideboard, an upholstered stool."""
    window = Opening("south", 2.1, 1.6, 0.8, 1.4, "WINDOW")
    room = FurnishedRoom(
        "living_02",
        "Living Room",
        4.4,
        4.0,
        2.7,
        (216, 224, 226),
        planks((196, 166, 128), 12),
        seed,
        (window, Opening("north", 3.6, 0.9, 0.0, 2.1, "DOOR")),
    )
    couch = room.against(sofa(2, (92, 112, 142), (104, 126, 156), 1, "sofa", seat=0.72), "west", 2.0, gap=0.05)
    room.upon(
        cushion_on_slope(stripes((236, 206, 122), (220, 168, 70), "x", 0.12), 62.0, 2),
        couch,
        right=0.52,
        front=0.02,
        top=0.447,
    )
    room.put(round_rug(1.05, (226, 226, 218), (140, 160, 178), 3), 1.95, 2.0)
    room.put(round_table(0.42, 0.44, OAK, 4, "teatable"), 1.85, 2.0)
    side = room.against(cabinet((1.5, 0.42, 0.78), OAK, OAK, 5, "cabinet", columns=3), "east", 2.1)
    room.upon(table_lamp((244, 232, 206), (90, 112, 140), 6), side, right=-0.52)
    room.upon(book_stack(3, 7), side, right=0.52)
    room.put(ottoman((222, 178, 92), 8, (0.60, 0.45, 0.44)), 2.1, 3.30, 180.0)
    room.stand(plant(seed + 4, 1.4, (228, 226, 220)), 0.55, 0.55)
    room.against(picture(0.9, 0.6, 21), "west", 2.0, gap=0.0, z=1.55)
    room.against(picture(0.6, 0.8, 22), "east", 2.1, gap=0.0, z=1.55)
    curtains(room, window, (206, 212, 216), 10)
    light(room)
    return room


def living_03(seed: int) -> FurnishedRoom:
    """A reading corner: two armchairs at an angle, a side table between them, a wall of books."""
    window = Opening("west", 1.6, 1.3, 0.85, 1.35, "WINDOW")
    room = FurnishedRoom(
        "living_03",
        "Living Room",
        4.2,
        3.8,
        2.7,
        (226, 214, 198),
        planks(WALNUT, 13),
        seed,
        (window, Opening("south", 3.5, 0.9, 0.0, 2.1, "DOOR")),
    )
    room.put(sofa(1, (126, 62, 56), (140, 74, 66), 1, "armchair", seat=0.62, depth=0.86, arm=0.17), 0.95, 2.85, -125.0)
    room.put(round_table(0.28, 0.55, WALNUT, 2, "side table"), 1.75, 3.15)
    room.put(rug(2.2, 1.5, checks((192, 110, 84), (226, 200, 160), 0.44), 3), 1.9, 2.0)
    for at, number in ((2.75, 4), (3.67, 5)):
        unit = room.against(bookshelf(WALNUT, number), "north", at)
        fill_shelf(room, unit, number + 3, free=(2,) if number == 4 else (1,))
    room.against(
        sofa(3, (176, 160, 132), (188, 172, 144), 6, "Multi person sofa", seat=0.60, arm=0.16), "south", 1.45, gap=0.05
    )
    room.put(table((1.0, 0.55, 0.42), WALNUT, 7, "teatable", "turned"), 1.6, 1.75)
    room.put(floor_lamp((240, 218, 170), (110, 86, 50), 8), 0.38, 3.48)
    room.stand(plant(seed + 6, 1.1, (90, 80, 76)), 3.75, 1.75)
    room.against(picture(0.8, 0.6, 23), "east", 2.3, gap=0.0, z=1.55)
    curtains(room, window, (206, 180, 150), 9)
    light(room)
    return room


def study_01(seed: int) -> FurnishedRoom:
    """A desk with lamp and office chair, a shelf, a cabinet, an armchair."""
    window = Opening("north", 2.0, 1.5, 0.9, 1.3, "WINDOW")
    room = FurnishedRoom(
        "study_01",
        "Study Room",
        4.0,
        3.4,
        2.7,
        (218, 222, 212),
        planks(OAK, 14),
        seed,
        (window, Opening("south", 0.7, 0.9, 0.0, 2.1, "DOOR")),
    )
    worktop = room.against(desk(OAK, CREAM, 1, 1.6, 0.75), "north", 2.0, gap=0.12)
    room.upon(table_lamp((240, 230, 200), (60, 92, 80), 2), worktop, right=-0.62, front=-0.14)
    room.upon(book_stack(3, 3), worktop, right=0.60, front=-0.14)
    room.put(office_chair((64, 84, 92), 4), 2.05, 2.02, 180.0)
    unit = room.against(bookshelf(OAK, 5), "west", 2.2)
    fill_shelf(room, unit, 6)
    low = room.against(cabinet((1.0, 0.40, 0.76), OAK, CREAM, 7, "storage cabinet", columns=2, rows=3), "east", 1.0)
    room.upon(small_vase((80, 110, 96), 8), low, right=0.30)
    room.put(sofa(1, (104, 120, 98), (116, 132, 110), 9, "armchair", seat=0.58, depth=0.82, arm=0.15), 1.75, 0.62, 12.0)
    room.put(rug(1.7, 1.2, stripes((206, 200, 178), (136, 150, 126), "x", 0.34, 0.3), 10), 2.1, 1.7)
    room.stand(plant(seed + 7, 1.2), 3.5, 2.95)
    room.against(picture(0.7, 0.5, 24), "east", 1.0, gap=0.0, z=1.45)
    curtains(room, window, (208, 206, 190), 11)
    light(room)
    return room


def study_02(seed: int) -> FurnishedRoom:
    """A small home office: a slim metal-legged desk-table, a wooden chair, a stool and a low cabinet."""
    window = Opening("west", 1.5, 1.2, 0.9, 1.3, "WINDOW")
    room = FurnishedRoom(
        "study_02",
        "Study Room",
        3.2,
        3.0,
        2.6,
        (236, 232, 228),
        planks((176, 150, 122), 15),
        seed,
        (window, Opening("east", 2.4, 0.85, 0.0, 2.05, "DOOR")),
    )
    worktop = room.against(table((1.40, 0.70, 0.74), WALNUT, 1, "desk", "slim"), "south", 1.5)
    room.upon(table_lamp((238, 236, 230), (52, 54, 60), 2), worktop, right=0.54, front=-0.16)
    room.put(chair(WALNUT, (70, 74, 82), 3), 1.45, 1.10, 180.0)
    room.against(cabinet((1.2, 0.40, 0.60), (228, 226, 222), (240, 238, 234), 4, "cabinet", columns=3), "north", 1.4)
    room.put(stool((214, 186, 140), (60, 62, 66), 5, 0.46, 0.18), 2.75, 0.55)
    unit = room.against(bookshelf((228, 226, 222), 6, (0.70, 0.28, 1.80)), "north", 2.55)
    fill_shelf(room, unit, 7, size=(0.70, 0.28, 1.80), free=(2,))
    room.put(rug(1.5, 1.0, dots((206, 208, 210), (120, 128, 138), 0.24, 0.06), 8), 1.5, 1.7)
    room.against(picture(0.8, 0.55, 25), "south", 1.5, gap=0.0, z=1.55)
    curtains(room, window, (222, 220, 214), 9)
    light(room)
    return room


def dining_01(seed: int) -> FurnishedRoom:
    """A long dining table with six chairs and a sideboard."""
    window = Opening("north", 2.2, 1.8, 0.8, 1.4, "WINDOW")
    room = FurnishedRoom(
        "dining_01",
        "Dining Room",
        4.4,
        3.8,
        2.7,
        (230, 220, 196),
        planks(PINE, 16),
        seed,
        (window, Opening("west", 0.8, 0.9, 0.0, 2.1, "DOOR")),
    )
    room.put(rug(2.7, 2.1, checks((214, 196, 160), (156, 124, 92), 0.5), 1), 2.2, 2.05)
    room.put(table((1.8, 0.92, 0.75), OAK, 2, "dining table"), 2.2, 2.05)
    for index, x in enumerate((1.62, 2.2, 2.78)):
        room.put(chair(OAK, (128, 140, 106), 3 + index), x, 1.38, 0.0)
        room.put(chair(OAK, (128, 140, 106), 7 + index), x, 2.72, 180.0)
    side = room.against(cabinet((1.6, 0.44, 0.86), OAK, OAK, 11, "cabinet", columns=4), "south", 2.6)
    room.upon(small_vase((196, 120, 80), 12), side, right=-0.6)
    room.stand(plant(seed + 8, 1.3), 3.95, 3.35)
    room.against(picture(1.2, 0.7, 26), "south", 2.6, gap=0.0, z=1.65)
    room.against(picture(0.5, 0.7, 27), "east", 1.8, gap=0.0, z=1.55)
    curtains(room, window, (222, 206, 170), 13)
    light(room)
    return room


def dining_02(seed: int) -> FurnishedRoom:
    """A round dining table with four chairs, a bench by the wall, a cabinet."""
    window = Opening("east", 1.7, 1.4, 0.9, 1.3, "WINDOW")
    room = FurnishedRoom(
        "dining_02",
        "Dining Room",
        3.8,
        3.6,
        2.6,
        (214, 226, 220),
        planks(WALNUT, 17),
        seed,
        (window, Opening("north", 0.75, 0.9, 0.0, 2.05, "DOOR")),
    )
    room.put(round_rug(1.25, (232, 226, 208), (130, 160, 148), 1), 1.9, 1.75)
    room.put(round_table(0.60, 0.74, WALNUT, 2, "dining table"), 1.9, 1.75)
    for index, (dx, dy, yaw) in enumerate(((0, -0.86, 0.0), (0, 0.86, 180.0), (-0.86, 0, -90.0), (0.86, 0, 90.0))):
        room.put(chair(WALNUT, None, 3 + index), 1.9 + dx, 1.75 + dy, yaw)
    room.against(ottoman((120, 150, 138), 8, (1.10, 0.40, 0.46), "bench"), "south", 1.9, gap=0.03)
    side = room.against(cabinet((1.1, 0.40, 0.82), WALNUT, CREAM, 9, "cabinet", columns=2), "north", 2.6)
    room.upon(small_vase((100, 140, 130), 10), side, right=0.38)
    room.stand(plant(seed + 10, 1.0, (214, 210, 200)), 0.5, 0.55)
    room.against(picture(0.9, 0.6, 28), "west", 1.8, gap=0.0, z=1.55)
    curtains(room, window, (206, 218, 210), 11)
    light(room)
    return room


def hall_01(seed: int) -> FurnishedRoom:
    """An entrance hall: a bench, a shoe cabinet with a mirror above, a stool."""
    room = FurnishedRoom(
        "hall_01",
        "Hall",
        3.6,
        2.4,
        2.6,
        (228, 222, 214),
        planks((150, 120, 92), 18),
        seed,
        (Opening("west", 1.2, 0.95, 0.0, 2.1, "DOOR"), Opening("east", 1.2, 0.9, 0.0, 2.1, "DOOR")),
    )
    room.against(ottoman((96, 104, 120), 1, (1.2, 0.42, 0.46), "bench"), "south", 1.5, gap=0.03)
    room.against(cabinet((1.3, 0.36, 0.84), PINE, CREAM, 2, "shoe cabinet", columns=3), "north", 1.9)
    room.against(mirror(0.9, 0.8), "north", 1.9, gap=0.0, z=1.55)
    room.put(stool(PINE, WALNUT, 3), 2.75, 0.45)
    room.put(rug(1.9, 0.7, stripes((176, 84, 72), (226, 206, 176), "x", 0.3, 0.3), 4), 1.8, 1.2)
    room.stand(plant(seed + 12, 1.2), 0.45, 2.0)
    room.against(picture(0.6, 0.6, 29), "south", 1.5, gap=0.0, z=1.5)
    light(room)
    return room
