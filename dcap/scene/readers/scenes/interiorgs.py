"""InteriorGS annotations: labelled boxes (labels.json) and rooms, walls and openings (structure.json).

Written for the files found in practice: a list or {"labels": [...]}, missing ids and boxes, mixed case, the eight
corners in any order, boxes without thickness. Coordinates are metres, right-handed, z up.
"""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from shapely import Polygon, is_valid_reason

from dcap.scene.errors import Place, Report, error, note, refusing, short, warning
from dcap.scene.readers.files import read_json
from dcap.scene.text import did_you_mean, short_name
from dcap.scene.types.boxes import OrientedBox, min_area_box
from dcap.scene.types.scan import LabelBox, Room

LABELS, STRUCTURE = "labels.json", "structure.json"

UNBOXED = ("room", "wall")
"""Labels that are annotated without a box, as a rule."""

OPENINGS = ("window", "door", "opening")
"""Kinds of holes in walls."""

THINNEST = 0.01
"""Thickness to which a flat box is padded [m]; rugs and pictures are annotated without thickness."""

FLAT = 1e-4
"""Largest extent of a flat box [m]."""

SMALLEST_ROOM = 0.01
"""Area below which a profile counts as a line [m^2]."""

WALL_THICKNESS, WALL_HEIGHT = 0.1, 2.8
"""Thickness and height of walls that do not state them [m]."""


def is_interiorgs(folder: Path) -> bool:
    """Return whether a folder contains InteriorGS annotations."""
    return (folder / LABELS).is_file() or (folder / STRUCTURE).is_file()


def read_labels(folder: Path) -> tuple[tuple[LabelBox, ...], tuple[str, ...]]:
    """Labelled boxes in file order and notes; entries without a box (room, wall) are skipped."""
    path = folder / LABELS
    if not path.is_file():
        return (), ("labels.json is missing: instances are found by shape alone",)
    entries = label_entries(read_json(path), refusing(path))
    skipped = sum(entry.box is None for entry in entries)
    boxes = tuple(entry.box for entry in entries if entry.box is not None)
    return boxes, ((f"{skipped} entries of labels.json without a label or box are skipped",) if skipped else ())


@dataclass(frozen=True, eq=False, slots=True)
class LabelEntry:
    """An entry of labels.json."""

    place: Place
    box: LabelBox | None
    """None if the entry has no label, no box, or a broken box."""


def label_entries(document: object, report: Report) -> tuple[LabelEntry, ...]:
    """Entries of labels.json; missing or repeated ids are replaced."""
    root: Place = ("labels",) if isinstance(document, dict) else ()
    entries = document.get("labels") if isinstance(document, dict) else document
    if not isinstance(entries, list):
        report(error(f"neither a list nor an object with a list 'labels', but {short(document)}"))
        return ()
    used: set[str] = set()
    return tuple(_label_entry((*root, index), index, entry, used, report) for index, entry in enumerate(entries))


def _label_entry(place: Place, index: int, entry: object, used: set[str], report: Report) -> LabelEntry:
    if not isinstance(entry, dict):
        report(error(f"entry {index} is a {type(entry).__name__}, expected an object", place))
        return LabelEntry(place, None)
    label = short_name(" ".join(str(entry.get("label") or "").lower().split()))
    if not label:
        hint = _mistyped("label", entry)
        report(warning(f"entry {index} has no label and is skipped; give it one{hint}", (*place, "label")))
    corners = entry.get("bounding_box")
    if corners is None:
        if label and label not in UNBOXED:
            hint = _mistyped("bounding_box", entry)
            what = f"entry {index} ({label}) has no bounding_box and is skipped{hint}"
            report(warning(what, place) if hint else note(what, place))
        return LabelEntry(place, None)
    if not label:  # its box must not stop a reader
        return LabelEntry(place, None)
    box = _box(index, (*place, "bounding_box"), corners, report)
    if box is None:
        return LabelEntry(place, None)
    return LabelEntry(place, LabelBox(_unique_id(entry, index, place, label, used, report), label, box))


def _mistyped(key: str, entry: dict[str, object]) -> str:
    """The key that may be a misspelling of a missing one, as the end of a sentence."""
    return "" if key in entry else did_you_mean(key, entry)


def _unique_id(entry: dict[str, object], index: int, place: Place, label: str, used: set[str], report: Report) -> str:
    """The annotated id if it exists and is unique, else an id made of the label and a counter."""
    wanted = str(entry.get("ins_id") or "").strip()
    name, number = wanted or label.replace(" ", "_"), 1
    while name in used:
        name, number = f"{wanted or label.replace(' ', '_')}_{number}", number + 1
    used.add(name)
    if wanted and name != wanted:
        what = f"ins_id {wanted!r} of entry {index} ({label}) is used before; it is called {name}: make ids unique"
        report(warning(what, (*place, "ins_id")))
    return name


def _points(where: str, value: object, place: Place, keys: str, report: Report) -> NDArray[np.float64] | None:
    """Rows of coordinates, written as objects with keys or as lists; None if a row is broken."""
    expected = f"is not a list of points with {', '.join(keys)}"
    if not isinstance(value, list):
        report(error(f"{where} {expected}, but {short(value)}", place))
        return None
    rows = [_point(point, keys) for point in value]
    for index, row in enumerate(rows):
        if row is None:
            what = f"{where} {expected}: point {index} is {short(value[index])}"
            report(error(what, (*place, index)))
        elif not all(map(isfinite, row)):
            report(error(f"{where} has a coordinate that is not finite: point {index} is {row}", (*place, index)))
    if any(row is None or not all(map(isfinite, row)) for row in rows):
        return None
    return np.array(rows, dtype=np.float64).reshape(-1, len(keys))


def _point(value: object, keys: str) -> list[float] | None:
    """One row of coordinates; None for anything else."""
    try:
        if isinstance(value, dict):
            return [float(value[key]) for key in keys]
        row = [float(number) for number in value[: len(keys)]] if isinstance(value, list) else []
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    return row if len(row) == len(keys) else None


def _box(index: int, place: Place, corners: object, report: Report) -> OrientedBox | None:
    """The box of eight corners in any order; flat boxes are padded."""
    points = _points(f"bounding_box of entry {index}", corners, place, "xyz", report)
    if points is None:
        return None
    if len(points) != 8:
        report(error(f"bounding_box of entry {index} has {len(points)} corners, expected 8", place))
        return None
    box = min_area_box(points)
    flat = box.half_extents < FLAT
    if flat.any():
        size = ", ".join(f"{2 * half:.3g}" for half in box.half_extents)
        report(note(f"bounding_box of entry {index} is flat ({size} m): it is padded to {THINNEST} m", place))
    return OrientedBox(box.center, box.axes, np.where(flat, THINNEST / 2, box.half_extents))


def read_structure(folder: Path) -> tuple[tuple[Room, ...], tuple[LabelBox, ...]]:
    """Rooms, and walls, windows and doors as labelled boxes; empty if structure.json is missing."""
    path = folder / STRUCTURE
    if not path.is_file():
        return (), ()
    return structure_of(read_json(path), refusing(path))


def structure_of(document: object, report: Report) -> tuple[tuple[Room, ...], tuple[LabelBox, ...]]:
    """Rooms of structure.json, and the boxes of its walls and holes."""
    if not isinstance(document, dict):
        report(error(f"not an object, but {short(document)}"))
        return (), ()
    rooms = [_room(index, room, report) for index, room in _objects(document, "rooms", report)]
    walls = [_wall(index, wall, report) for index, wall in _objects(document, "walls", report)]
    holes = [_hole(index, hole, report) for index, hole in _objects(document, "holes", report)]
    return tuple(room for room in rooms if room), tuple(box for box in walls + holes if box)


def _objects(document: dict[str, object], key: str, report: Report) -> list[tuple[int, dict[str, object]]]:
    """The objects of a list and their indices."""
    entries = document.get(key) or []
    if not isinstance(entries, list):
        report(error(f"{key!r} is not a list of objects, but {short(entries)}", (key,)))
        return []
    for index, entry in enumerate(entries):
        if not isinstance(entry, dict):
            what = f"{key!r} is not a list of objects: entry {index} is {short(entry)}"
            report(error(what, (key, index)))
    return [(index, entry) for index, entry in enumerate(entries) if isinstance(entry, dict)]


def _number(where: str, entry: dict[str, object], place: Place, default: float, report: Report) -> float:
    """A positive length at the last key of its place; `default` if it is missing, `THINNEST` if it is smaller than
    that."""
    value = entry.get(str(place[-1]))
    if value is None:
        report(note(f"{where} is missing: {default} m is assumed", place))
        return default
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not isfinite(number):
        report(error(f"{where} is {short(value)}, expected a finite number", place))
        return default
    if number < THINNEST:
        report(warning(f"{where} is {number:g} m: {THINNEST} m is taken; give its true size", place))
    return max(number, THINNEST)


def _room(index: int, room: dict[str, object], report: Report) -> Room | None:
    """A floor polygon; None if it has fewer than three corners."""
    place: Place = ("rooms", index, "profile")
    profile = _points(f"profile of room {index}", room.get("profile"), place, "xy", report)
    if profile is None:
        return None
    if len(profile) < 3:
        what = f"profile of room {index} has {len(profile)} points, expected 3 or more: the room is left out"
        report(warning(what, place))
        return None
    outline = Polygon(profile)
    if not outline.is_valid:
        why = is_valid_reason(outline)
        report(warning(f"profile of room {index} crosses itself ({why}); give its corners in order", place))
    elif outline.area < SMALLEST_ROOM:
        report(warning(f"profile of room {index} has an area of {outline.area:.2g} m2; give its corners", place))
    return Room(str(room.get("room_type") or "").lower(), profile)


def _wall(index: int, wall: dict[str, object], report: Report) -> LabelBox | None:
    """A straight wall: a centre line, a total thickness, a height from the floor."""
    place: Place = ("walls", index)
    ends = _points(f"location of wall {index}", wall.get("location"), (*place, "location"), "xy", report)
    if ends is not None and len(ends) < 2:
        report(error(f"location of wall {index} has {len(ends)} points, expected 2", (*place, "location")))
    thickness = _number(f"thickness of wall {index}", wall, (*place, "thickness"), WALL_THICKNESS, report)
    height = _number(f"height of wall {index}", wall, (*place, "height"), WALL_HEIGHT, report)
    if ends is None or len(ends) < 2:
        return None
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length <= FLAT:
        report(warning(f"wall {index} has no length: both ends are {ends[0].tolist()}", (*place, "location")))
    x = along / length if length > FLAT else np.array([1.0, 0.0])
    axes = np.array([[x[0], -x[1], 0.0], [x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
    center = np.array([*ends[:2].mean(axis=0), height / 2])
    half = np.array([max(length, THINNEST) / 2, thickness / 2, height / 2])
    return LabelBox(f"wall_{index}", "wall", OrientedBox(center, axes, half))


def _hole(index: int, hole: dict[str, object], report: Report) -> LabelBox | None:
    """A window or door: a profile in space and the thickness of its wall."""
    place: Place = ("holes", index)
    profile = _points(f"profile of hole {index}", hole.get("profile"), (*place, "profile"), "xyz", report)
    if profile is not None and len(profile) < 3:
        what = f"profile of hole {index} has {len(profile)} points, expected 3 or more"
        report(error(what, (*place, "profile")))
    kind = str(hole.get("type") or "opening").lower()
    if kind not in OPENINGS:
        what = (
            f"type of hole {index} is {short(hole.get('type'))}, expected WINDOW or DOOR{did_you_mean(kind, OPENINGS)}"
        )
        report(warning(what, (*place, "type")))
    thickness = _number(f"thickness of hole {index}", hole, (*place, "thickness"), WALL_THICKNESS, report)
    if profile is None or len(profile) < 3:
        return None
    box = min_area_box(profile)
    half = np.where(box.half_extents < FLAT, thickness / 2, box.half_extents)
    return LabelBox(f"{kind}_opening_{index}", kind, OrientedBox(box.center, box.axes, half))
