"""Tables, desks, cabinets, shelves and wardrobes; front towards +y, origin on the floor."""

from typing import Literal

import numpy as np

from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import Rgb, painted, wood
from dcap.synthetic.shapes import Assembly, Size, assembly, bar, lathe, moved, resampled, rounded_box, sphere, tube

Legs = Literal["turned", "square", "slim"]


def table(
    size: Size, timber: Rgb, seed: int, label: str = "table", legs: Literal["turned", "square", "slim"] = "turned"
) -> Assembly:
    """A table; slim legs are of metal."""
    width, depth, height = size
    top = moved(rounded_box((width, depth, 0.035), 0.010, 0.026), z=height - 0.0175)
    apron = [
        moved(rounded_box((width - 0.16, 0.02, 0.07), 0.004, 0.04), y=s * (depth / 2 - 0.07), z=height - 0.065)
        for s in (-1, 1)
    ]
    apron += [
        moved(rounded_box((0.02, depth - 0.16, 0.07), 0.004, 0.04), x=s * (width / 2 - 0.07), z=height - 0.065)
        for s in (-1, 1)
    ]
    stands = [
        _leg(legs, x * (width / 2 - 0.065), y * (depth / 2 - 0.065), height - 0.03) for x in (-1, 1) for y in (-1, 1)
    ]
    under = stands if legs == "slim" else [*stands, *apron]
    tint: Rgb = (60, 60, 64) if legs == "slim" else timber
    return assembly(
        label,
        top=painted(top, wood(timber, "x", seed), seed=seed),
        leg=[painted(m, wood(tint, "z", seed + 1), seed=seed) for m in under],
    )


def _leg(kind: str, x: float, y: float, height: float) -> Mesh:
    if kind == "square":
        return moved(rounded_box((0.055, 0.055, height), 0.006, 0.03), x, y, height / 2)
    if kind == "slim":
        return bar((x, y, 0.0), (x, y, height), 0.014)
    path = resampled(np.array([(x, y, 0.0), (x, y, height)]), 0.02)
    t = path[:, 2] / height
    radius = (
        0.019
        + 0.011 * np.sin(np.pi * t) ** 2
        + 0.008 * np.exp(-(((t - 0.82) / 0.03) ** 2))
        + 0.008 * np.exp(-(((t - 0.10) / 0.03) ** 2))
    )
    return tube(path, radius, 0.02, round_ends=False)


def round_table(radius: float, height: float, timber: Rgb, seed: int, label: str = "teatable") -> Assembly:
    """A round top on a turned column with a wide foot."""
    top = lathe(
        [
            (0, height - 0.034),
            (radius - 0.02, height - 0.034),
            (radius - 0.004, height - 0.022),
            (radius, height - 0.010),
            (radius - 0.008, height),
            (0, height),
        ],
        0.025,
    )
    foot = 0.62 * radius
    column = lathe(
        [
            (0, 0),
            (foot, 0),
            (foot, 0.018),
            (0.05, 0.05),
            (0.032, 0.12),
            (0.045, 0.5 * height),
            (0.03, 0.72 * height),
            (0.07, height - 0.03),
            (0, height - 0.03),
        ],
        0.024,
        smooth=1,
    )
    return assembly(
        label,
        top=painted(top, wood(timber, "x", seed), seed=seed),
        leg=painted(column, wood(timber, "z", seed), seed=seed),
    )


def desk(timber: Rgb, drawers: Rgb, seed: int, width: float = 1.40, depth: float = 0.68) -> Assembly:
    """A writing desk: top, a block of drawers on the right, two square legs on the left."""
    top = painted(moved(rounded_box((width, depth, 0.03), 0.008, 0.026), z=0.735), wood(timber, "x", seed), seed=seed)
    block = moved(rounded_box((0.40, depth - 0.06, 0.722), 0.006, 0.04), x=width / 2 - 0.22, z=0.361)
    legs: list[Mesh] = [painted(block, wood(drawers, "z", seed), seed=seed)]
    for index in range(3):
        z = 0.135 + 0.215 * index
        front = moved(rounded_box((0.37, 0.02, 0.20), 0.006, 0.03), width / 2 - 0.22, depth / 2 - 0.025, z)
        legs.append(painted(front, wood(timber, "x", seed + index), seed=seed))
        legs.append(painted(moved(sphere(0.013, 0.008), width / 2 - 0.22, depth / 2 - 0.008, z), (196, 190, 176)))
    legs += [
        painted(_leg("square", -width / 2 + 0.05, y * (depth / 2 - 0.05), 0.724), wood(timber, "z", seed))
        for y in (-1, 1)
    ]
    rail = moved(rounded_box((width - 0.45, 0.018, 0.30), 0.004, 0.04), x=-0.19, y=-depth / 2 + 0.05, z=0.575)
    legs.append(painted(rail, wood(timber, "x", seed + 5), seed=seed))
    return assembly("desk", top=top, leg=legs)


def cabinet(
    size: Size,
    timber: Rgb,
    front: Rgb,
    seed: int,
    label: str = "cabinet",
    *,
    columns: int = 2,
    rows: int = 1,
    plinth: float = 0.06,
) -> Assembly:
    """A box with a top board and a grid of doors or drawers."""
    width, depth, height = size
    body = [
        painted(
            moved(
                rounded_box((width - 0.02, depth - 0.03, height - plinth - 0.01), 0.006, 0.045),
                z=plinth + (height - plinth - 0.01) / 2,
            ),
            wood(timber, "z", seed),
            seed=seed,
        )
    ]
    feet = [
        moved(
            rounded_box((0.05, 0.05, plinth + 0.01), 0.008, 0.03),
            x * (width / 2 - 0.07),
            y * (depth / 2 - 0.07),
            (plinth + 0.01) / 2,
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    body += [painted(m, (72, 54, 42)) for m in feet]
    cell_x, cell_z = (width - 0.04) / columns, (height - plinth - 0.05) / rows
    for column in range(columns):
        for row in range(rows):
            x = -width / 2 + 0.02 + (column + 0.5) * cell_x
            z = plinth + 0.012 + (row + 0.5) * cell_z
            panel = moved(rounded_box((cell_x - 0.012, 0.022, cell_z - 0.012), 0.007, 0.035), x, depth / 2 - 0.012, z)
            body.append(
                painted(panel, wood(front, "z" if rows == 1 else "x", seed + 7 * column + row), seed=seed + column)
            )
            knob_x = x + (0.35 * cell_x * (1 if column % 2 == 0 else -1) if rows == 1 else 0.0)
            body.append(painted(moved(sphere(0.013, 0.008), knob_x, depth / 2 + 0.008, z), (206, 196, 170)))
    top = painted(
        moved(rounded_box((width, depth, 0.028), 0.008, 0.026), z=height - 0.014),
        wood(timber, "x", seed + 1),
        seed=seed,
    )
    return assembly(label, top=top, body=body)


def bedside_table(timber: Rgb, front: Rgb, seed: int) -> Assembly:
    """A small cabinet of two drawers on legs."""
    return cabinet((0.45, 0.40, 0.52), timber, front, seed, "bedside table", columns=1, rows=2, plinth=0.10)


def wardrobe(timber: Rgb, front: Rgb, seed: int, size: Size = (1.5, 0.60, 2.1)) -> Assembly:
    """A wardrobe with tall doors."""
    return cabinet(size, timber, front, seed, "wardrobe", columns=max(2, round(size[0] / 0.5)), rows=1)


def bookshelf(timber: Rgb, seed: int, size: Size = (0.90, 0.30, 1.80), boards: int = 5) -> Assembly:
    """An open shelf: two sides, a back panel, boards at equal distances, the topmost closing it."""
    width, depth, height = size
    sides = [
        moved(rounded_box((0.022, depth, height), 0.005, 0.035), x=s * (width / 2 - 0.011), z=height / 2)
        for s in (-1, 1)
    ]
    sides.append(
        moved(rounded_box((width - 0.03, 0.010, height - 0.06), 0.003, 0.06), y=-depth / 2 + 0.008, z=height / 2 + 0.02)
    )
    levels = shelf_levels(size, boards)
    planks = [
        moved(rounded_box((width - 0.036, depth - 0.01, 0.022), 0.005, 0.028), y=0.003, z=z - 0.011) for z in levels
    ]
    return assembly(
        "bookshelf",
        board=[painted(m, wood(timber, "x", seed + i), seed=seed) for i, m in enumerate(planks)],
        side=[painted(m, wood(timber, "z", seed), seed=seed) for m in sides],
    )


def shelf_levels(size: Size, boards: int = 5) -> list[float]:
    """Heights of the upper faces of the boards [m]."""
    return [float(z) for z in np.linspace(0.09, size[2] - 0.002, boards)]
