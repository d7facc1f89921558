"""A phone's plan of a room: Apple RoomPlan's CapturedRoom as Swift's JSONEncoder writes it, as labelled boxes.

`objects`, `doors`, `windows`, `openings` and `walls` are lists of `{identifier, category, dimensions, transform}`;
several rooms stand under `rooms`. A category is an enum, `{"sofa": {}}` or `{"door": {"isOpen": false}}`, or text.
Dimensions are width, height and depth [m]; the transform is column by column, 16 numbers or 4 x 4, from the box's
middle to the session's frame, y up. Floors and sections are left out: the floor is found by its height.
"""

import re
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError
from dcap.scene.given_text import short_name
from dcap.scene.problems import short
from dcap.scene.types.given_labels import CornerFrame, GivenLabels, GivenThing

Array = NDArray[np.float64]

SURFACES = {"walls": "wall", "doors": "door", "windows": "window", "openings": "opening"}
"""Lists of the building and what is in them."""
LISTS = (*SURFACES, "objects")
NAMES = {
    "storage": "storage", "washerDryer": "washing machine", "television": "tv", "sink": "sink", "stairs": "stairs",
    "refrigerator": "refrigerator", "stove": "stove", "bed": "bed", "toilet": "toilet", "bathtub": "bathtub",
    "oven": "oven", "dishwasher": "dishwasher", "table": "table", "sofa": "sofa", "chair": "chair",
    "fireplace": "fireplace",
}  # fmt: skip
"""Categories of objects and what people call them; which storage is a shelf and which a cupboard, their shapes tell."""
THINNEST = 0.05
"""Walls and openings are planes: their boxes are this thick at least [m]."""


def is_roomplan(document: Mapping[str, object]) -> bool:
    """Whether a JSON document looks like a plan: lists of placed boxes."""
    rooms = document.get("rooms")
    inner = rooms if isinstance(rooms, list) else [document]
    rows = [row for room in inner if isinstance(room, dict) for row in items(room)]
    return any("transform" in row and "dimensions" in row for _, row in rows)


def items(room: Mapping[str, object]) -> Iterator[tuple[str, Mapping[str, object]]]:
    """Rows of a room's lists, each with the name of its list."""
    for name in LISTS:
        rows = room.get(name)
        yield from ((name, row) for row in (rows if isinstance(rows, list) else []) if isinstance(row, dict))


def read_roomplan(path: Path, document: Mapping[str, object]) -> GivenLabels:
    """The boxes of a plan; FormatError with the entry and what is wrong with it."""
    rooms = document.get("rooms")
    inner = [room for room in (rooms if isinstance(rooms, list) else [document]) if isinstance(room, dict)]
    found: list[GivenThing] = []
    unknown: list[str] = []
    for room in inner:
        for number, (name, row) in enumerate(items(room)):
            where = f"{path}: {name} ({number})"
            kind = SURFACES.get(name) or category(where, row.get("category"))
            if name == "objects" and kind not in NAMES:
                unknown.append(kind)
            label = kind if name in SURFACES else NAMES.get(kind, spaced(kind))
            found.append(placed(where, f"{label.replace(' ', '_')}_{len(found)}", label, row))
    if not found:
        raise FormatError(f"{path}: a plan of a room without objects, walls, doors or windows")
    notes = tuple(
        f"{path.name}: category {kind!r} is not known; it is called {spaced(kind)!r}" for kind in dict.fromkeys(unknown)
    )
    return GivenLabels(path.name, tuple(found), CornerFrame.Y_UP, complete=False, mesh="", notes=notes)


def category(where: str, value: object) -> str:
    """The case of an enum."""
    if isinstance(value, str) and value:
        return short_name(value)
    if isinstance(value, dict) and len(value) == 1:
        return short_name(str(next(iter(value))))
    raise FormatError(f'{where}: category is {short(value)}, expected a case such as {{"sofa": {{}}}}')


def spaced(kind: str) -> str:
    """Words of a name in camel case."""
    return " ".join(re.sub(r"(?<=[a-z])(?=[A-Z])", " ", kind).lower().replace("_", " ").split()) or "thing"


def placed(where: str, name: str, label: str, row: Mapping[str, object]) -> GivenThing:
    """A box with its name."""
    size = numbers(f"{where}: dimensions", row.get("dimensions"), 3)
    if (size < 0).any():
        raise FormatError(f"{where}: dimensions are {short(row.get('dimensions'))}, expected none below 0")
    flat = row.get("transform")
    if isinstance(flat, list) and len(flat) == 4 and all(isinstance(one, list) for one in flat):
        flat = [value for column in flat for value in column]
    matrix = numbers(f"{where}: transform", flat, 16).reshape(4, 4).T
    turn = matrix[:3, :3]
    if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-2 or np.abs(matrix[3] - [0, 0, 0, 1]).max() > 1e-3:
        raise FormatError(f"{where}: transform is not a rotation and a shift, column by column")
    half = 0.5 * np.maximum(size, THINNEST)
    signs = np.array([[i, j, k] for j in (-1, 1) for k in (-1, 1) for i in (-1, 1)])
    return GivenThing(name, label, 1.0, np.zeros((0, 2), np.int64), matrix[:3, 3] + (signs * half) @ turn.T)


def numbers(what: str, value: object, count: int) -> Array:
    """`count` finite numbers, shape (count,)."""
    row = value if isinstance(value, list) else []
    sound = all(isinstance(one, int | float) and not isinstance(one, bool) and isfinite(one) for one in row)
    if len(row) != count or not sound:
        raise FormatError(f"{what} is {short(value)}, expected {count} finite numbers")
    return np.array(row, dtype=np.float64)
