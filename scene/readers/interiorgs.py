"""InteriorGS annotations: labelled boxes (labels.json) and rooms, walls and openings (structure.json).

Written for what the files hold in practice: a list or {"labels": [...]}, missing ids and boxes, mixed case, the eight
corners in any order, boxes without thickness. Coordinates are metres, right-handed, z up.
"""

import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scene.box import OrientedBox
from scene.errors import FormatError
from scene.readers.rectangle import min_area_box
from scene.scan import LabelBox, Room

THINNEST = 0.01
"""Thickness that a flat box is padded to [m]; rugs and pictures are annotated without one."""

FLAT = 1e-4
"""An extent below this is flat [m]."""


def is_interiorgs(folder: Path) -> bool:
    """Whether a folder carries InteriorGS annotations."""
    return (folder / "labels.json").is_file() or (folder / "structure.json").is_file()


def read_labels(folder: Path) -> tuple[tuple[LabelBox, ...], tuple[str, ...]]:
    """Labelled boxes in file order and notes; entries without a box (room, wall) are skipped."""
    path = folder / "labels.json"
    if not path.is_file():
        return (), ("labels.json is missing: instances are found by shape alone",)
    document = load_json(path)
    entries = document.get("labels") if isinstance(document, dict) else document
    if not isinstance(entries, list):
        raise FormatError(f"{path}: neither a list nor an object with a list 'labels'")
    boxes: list[LabelBox] = []
    used: set[str] = set()
    skipped = 0
    for index, entry in enumerate(entries):
        if not isinstance(entry, dict):
            raise FormatError(f"{path}: entry {index} is a {type(entry).__name__}, expected an object")
        label = " ".join(str(entry.get("label") or "").lower().split())
        corners = entry.get("bounding_box")
        if not label or corners is None:
            skipped += 1
            continue
        box = _box(path, index, corners)
        boxes.append(LabelBox(_unique_id(entry, label, used), label, box))
    return tuple(boxes), ((f"{skipped} entries of labels.json without a label or box are skipped",) if skipped else ())


def load_json(path: Path) -> object:
    """The tree of a JSON file."""
    try:
        return json.loads(path.read_text("utf-8"))
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: broken JSON: {error}") from None


def _unique_id(entry: dict[str, object], label: str, used: set[str]) -> str:
    """The annotated id if it is there and new, else one made of the label and a counter."""
    wanted = str(entry.get("ins_id") or "").strip()
    name, number = wanted or label.replace(" ", "_"), 1
    while name in used:
        name, number = f"{wanted or label.replace(' ', '_')}_{number}", number + 1
    used.add(name)
    return name


def _points(path: Path, where: str, value: Any, keys: str) -> NDArray[np.float64]:
    """Rows of coordinates, written as objects with keys or as lists."""
    try:
        rows = [
            [float(p[k]) for k in keys] if isinstance(p, dict) else [float(c) for c in p[: len(keys)]] for p in value
        ]
        points = np.array(rows, dtype=np.float64).reshape(-1, len(keys))
    except (KeyError, TypeError, ValueError, IndexError, OverflowError):
        raise FormatError(f"{path}: {where} is not a list of points with {', '.join(keys)}") from None
    if not np.isfinite(points).all():
        raise FormatError(f"{path}: {where} has a coordinate that is not finite")
    return points


def _box(path: Path, index: int, corners: Any) -> OrientedBox:
    """The box of eight corners in any order; flat boxes are padded."""
    points = _points(path, f"bounding_box of entry {index}", corners, "xyz")
    if len(points) != 8:
        raise FormatError(f"{path}: bounding_box of entry {index} has {len(points)} corners, expected 8")
    box = min_area_box(points)
    half = np.where(box.half_extents < FLAT, THINNEST / 2, box.half_extents)
    return OrientedBox(box.center, box.axes, half)


def read_structure(folder: Path) -> tuple[tuple[Room, ...], tuple[LabelBox, ...]]:
    """Rooms, and walls, windows and doors as labelled boxes; nothing where structure.json is missing."""
    path = folder / "structure.json"
    if not path.is_file():
        return (), ()
    document = load_json(path)
    if not isinstance(document, dict):
        raise FormatError(f"{path}: not an object")
    rooms = tuple(
        Room(str(r.get("room_type") or "").lower(), _points(path, f"profile of room {i}", r.get("profile"), "xy"))
        for i, r in enumerate(_objects(path, document, "rooms"))
    )
    walls = [_wall(path, i, wall) for i, wall in enumerate(_objects(path, document, "walls"))]
    holes = [_hole(path, i, hole) for i, hole in enumerate(_objects(path, document, "holes"))]
    return tuple(r for r in rooms if len(r.profile) >= 3), tuple(walls + holes)


def _objects(path: Path, document: dict[str, object], key: str) -> list[dict[str, object]]:
    entries = document.get(key) or []
    if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
        raise FormatError(f"{path}: {key!r} is not a list of objects")
    return entries


def _number(path: Path, where: str, value: object, default: float) -> float:
    try:
        number = default if value is None else float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not isfinite(number):
        raise FormatError(f"{path}: {where} is {value!r}, expected a finite number")
    return number


def _wall(path: Path, index: int, wall: dict[str, object]) -> LabelBox:
    """A straight wall: a centre line, a total thickness, a height from the floor."""
    ends = _points(path, f"location of wall {index}", wall.get("location"), "xy")
    if len(ends) < 2:
        raise FormatError(f"{path}: location of wall {index} has {len(ends)} points, expected 2")
    thickness = max(_number(path, f"thickness of wall {index}", wall.get("thickness"), 0.1), THINNEST)
    height = max(_number(path, f"height of wall {index}", wall.get("height"), 2.8), THINNEST)
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    x = along / length if length > FLAT else np.array([1.0, 0.0])
    axes = np.array([[x[0], -x[1], 0.0], [x[1], x[0], 0.0], [0.0, 0.0, 1.0]])
    center = np.array([*ends.mean(axis=0), height / 2])
    half = np.array([max(length, THINNEST) / 2, thickness / 2, height / 2])
    return LabelBox(f"wall_{index}", "wall", OrientedBox(center, axes, half))


def _hole(path: Path, index: int, hole: dict[str, object]) -> LabelBox:
    """A window or door: a profile in space and the thickness of its wall."""
    profile = _points(path, f"profile of hole {index}", hole.get("profile"), "xyz")
    if len(profile) < 3:
        raise FormatError(f"{path}: profile of hole {index} has {len(profile)} points, expected 3 or more")
    kind = str(hole.get("type") or "opening").lower()
    box = min_area_box(profile)
    thickness = max(_number(path, f"thickness of hole {index}", hole.get("thickness"), 0.1), THINNEST)
    half = np.where(box.half_extents < FLAT, thickness / 2, box.half_extents)
    return LabelBox(f"{kind}_opening_{index}", kind, OrientedBox(box.center, box.axes, half))
