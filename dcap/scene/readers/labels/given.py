"""Files of labels, of things or of vertices: Apple RoomPlan, arrays, ScanNet, and our own labels.json.

A phone's plan of a room: Apple RoomPlan's CapturedRoom as Swift's JSONEncoder writes it, as labelled boxes.

`objects`, `doors`, `windows`, `openings` and `walls` are lists of `{identifier, category, dimensions, transform}`;
several rooms are listed under `rooms`. A category is an enum, `{"sofa": {}}` or `{"door": {"isOpen": false}}`, or text.
Dimensions are width, height and depth [m]; the transform is column by column, 16 numbers or 4 x 4, from the box's
middle to the session's frame, y up. Floors and sections are left out: the floor is found by its height.

The thing of each vertex: numbers as .npy or .txt, or JSON; ScanNet's segments with their groups.

`.npy`: whole numbers of shape (n,). `.txt`: one per line. `.json`: `{"vertex_instance": [...], "labels": {...}}`.
Numbers below 0 are nothing. Names are `{"3": "sofa"}`; those for `.npy` and `.txt` stand next to them, in
`NAME.labels.json`.
`*.segs.json` and `*.aggregation.json` of ScanNet go together; either may be named.
"""

import re
from collections.abc import Iterator, Mapping
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.scene.errors import FormatError, InputError, refusing, short
from dcap.scene.readers.files import read_bytes, read_json
from dcap.scene.readers.labels.things import read_things
from dcap.scene.readers.points.formats import ONLY, arrays_of
from dcap.scene.readers.scenes.interiorgs import label_entries
from dcap.scene.readers.scenes.scannet import GROUPS, SEGMENTS, instances_of, segments_of, vertex_instances
from dcap.scene.text import short_name
from dcap.scene.types.segmentation import CornerFrame, GivenLabels, GivenThing, VertexLabels

SURFACES = {"walls": "wall", "doors": "door", "windows": "window", "openings": "opening"}
"""Lists of parts of the building, and their labels."""
LISTS = (*SURFACES, "objects")
NAMES = {
    "storage": "storage", "washerDryer": "washing machine", "television": "tv", "sink": "sink", "stairs": "stairs",
    "refrigerator": "refrigerator", "stove": "stove", "bed": "bed", "toilet": "toilet", "bathtub": "bathtub",
    "oven": "oven", "dishwasher": "dishwasher", "table": "table", "sofa": "sofa", "chair": "chair",
    "fireplace": "fireplace",
}  # fmt: skip
"""Categories of objects and their usual names; shapes distinguish shelves from cupboards among storage."""
THINNEST = 0.05
"""Least thickness of the boxes of walls and openings, which are planes [m]."""

LARGEST = 2**31
"""Upper bound for numbers of things [-]."""
LONGEST_NUMBER = 30
"""Maximum length of a number's line [characters]."""
KNOWN = (
    "labels.json of `dcap dataset label`, vertex ids (.npy, .txt, .json), ScanNet's segs.json with aggregation.json, "
    "RoomPlan's JSON or InteriorGS' labels.json"
)


def is_roomplan(document: Mapping[str, object]) -> bool:
    """Return whether a JSON document looks like a plan: lists of placed boxes."""
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
    """The boxes of a plan; raises FormatError with the entry and its problem."""
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
    """The name of an enum's case."""
    if isinstance(value, str) and value:
        return short_name(value)
    if isinstance(value, dict) and len(value) == 1:
        return short_name(str(next(iter(value))))
    raise FormatError(f'{where}: category is {short(value)}, expected a case such as {{"sofa": {{}}}}')


def spaced(kind: str) -> str:
    """Words of a camel-case name."""
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


def read_numpy(path: Path) -> VertexLabels:
    """A file of numpy."""
    array = arrays_of(path)[ONLY]
    if array.ndim != 1:
        raise FormatError(f"{path}: an array of shape {array.shape}, expected one number per vertex")
    return named(path, whole(path, array), names_beside(path))


def read_text(path: Path) -> VertexLabels:
    """The numbers of a text file, one per line."""
    rows = read_bytes(path).decode("utf-8", "replace").split("\n")
    while rows and not rows[-1].strip():
        rows.pop()
    for number, row in enumerate(rows, start=1):
        if not row.strip().removeprefix("-").isdecimal() or len(row) > LONGEST_NUMBER:
            raise FormatError(f"{path}: line {number} is {short(row)}, expected the whole number of a vertex's thing")
    return named(path, whole(path, np.array([int(row) for row in rows], dtype=np.float64)), names_beside(path))


def read_vertex_list(path: Path, document: Mapping[str, object]) -> VertexLabels:
    """`vertex_instance` and `labels` of a JSON document."""
    values = document.get("vertex_instance")
    if not isinstance(values, list) or not all(type(one) is int for one in values):
        raise FormatError(f"{path}: vertex_instance is {short(values)}, expected a list of whole numbers")
    numbers = np.array([min(max(one, -LARGEST), LARGEST) for one in values], dtype=np.float64)
    return named(path, whole(path, numbers), names_of(path, document.get("labels", {})))


def read_segments(path: Path, document: Mapping[str, object]) -> VertexLabels:
    """ScanNet's pair of files, given one of them."""
    groups_given = GROUPS in document
    wanted = SEGMENTS if groups_given else GROUPS
    end = ".segs.json" if groups_given else ".aggregation.json"
    beside = sorted(one for one in path.parent.glob(f"*{end}"))
    scene = path.name.split(".")[0].removesuffix("_vh_clean_2").removesuffix("_vh_clean")
    mine = [one for one in beside if one.name.startswith(scene)] or beside
    named_there = Path(str(document.get("segmentsFile") or "")).name
    mine = [one for one in mine if one.name == named_there] or mine
    if len(mine) != 1:
        listed = ", ".join(one.name for one in mine) or "none"
        raise FormatError(f"{path}: needs one file with {wanted} next to it (*{end}), found {listed}")
    other = read_json(mine[0])
    groups, segments = (document, other) if groups_given else (other, document)
    group_path, segment_path = (path, mine[0]) if groups_given else (mine[0], path)
    instances, skipped = instances_of(groups, segment_path.name, refusing(group_path))
    segment = segments_of(segments, None, refusing(segment_path))
    owner = vertex_instances(segment, instances, refusing(group_path))
    notes = (f"{skipped} segGroups of {group_path.name} without a label or segments are skipped",) if skipped else ()
    ids, labels = tuple(one.name for one in instances), tuple(one.label for one in instances)
    return VertexLabels(path.name, owner.astype(np.int32), ids, labels, notes)


def whole(path: Path, values: NDArray[np.generic]) -> IntArray:
    """Whole numbers of things, shape (n,)."""
    if not len(values):
        raise FormatError(f"{path}: no vertices")
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise FormatError(f"{path}: values of type {array.dtype}, expected whole numbers")
    numbers = array.astype(np.float64)
    bad = np.flatnonzero(~((numbers == np.floor(numbers)) & (np.abs(numbers) < LARGEST)))
    if len(bad):
        raise FormatError(f"{path}: vertex {bad[0]} has {numbers[bad[0]]:g}, expected the whole number of its thing")
    return numbers.astype(np.int64)


def names_beside(path: Path) -> dict[int, str]:
    """The names in NAME.labels.json; empty if the file does not exist."""
    beside = path.with_suffix(".labels.json")
    return names_of(beside, read_json(beside)) if beside.is_file() else {}


def names_of(path: Path, document: object) -> dict[int, str]:
    """Names by number."""
    if not isinstance(document, dict):
        raise FormatError(
            f'{path}: labels are {short(document)}, expected names by number, for example {{"3": "sofa"}}'
        )
    names = {}
    for key, name in document.items():
        if not str(key).isdecimal() or len(key) > LONGEST_NUMBER or not isinstance(name, str):
            raise FormatError(f"{path}: label {short(key)}: {short(name)}; expected names by number")
        names[int(key)] = short_name(" ".join(name.lower().replace("/", " ").split()))
    return names


def named(path: Path, numbers: IntArray, names: Mapping[int, str]) -> VertexLabels:
    """Vertices with the names of their things."""
    known, place = np.unique(numbers, return_inverse=True)
    kept = known[known >= 0]
    if not len(kept):
        raise FormatError(f"{path}: no vertex belongs to a thing: all numbers are below 0")
    gone = sorted(set(names) - set(kept.tolist()))
    if gone:
        raise FormatError(f"{path}: labels name thing {gone[0]}, which no vertex belongs to; there are {listing(kept)}")
    labels = [names.get(int(one), "") for one in kept]
    ids = tuple(f"{label.replace(' ', '_') or 'thing'}_{one}" for one, label in zip(kept, labels, strict=True))
    instance = np.where(known >= 0, np.cumsum(known >= 0) - 1, -1)[place.reshape(-1)]
    unnamed = labels.count("")
    notes = (f"{path.name} gives no name to {unnamed} of its {len(labels)} things",) if unnamed else ()
    return VertexLabels(path.name, instance.astype(np.int32), ids, tuple(labels), notes)


def listing(numbers: IntArray) -> str:
    """A few numbers as text."""
    shown = ", ".join(str(one) for one in numbers[:8])
    return f"{shown} ..." if len(numbers) > 8 else shown


def read_given_labels(path: Path) -> GivenLabels | VertexLabels:
    """Read any of the formats; raises FormatError or InputError with one line for an unknown format or a broken
    file."""
    if path.is_dir():
        raise InputError(f"--labels {path}: a folder; give the file: {KNOWN}")
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return read_numpy(path)
    if suffix == ".txt":
        return read_text(path)
    if suffix != ".json":
        raise InputError(f"--labels {path}: not a file of labels that is read ({KNOWN})")
    return _of_json(path, read_json(path))


def _of_json(path: Path, document: object) -> GivenLabels | VertexLabels:
    if isinstance(document, list) or (isinstance(document, dict) and isinstance(document.get("labels"), list)):
        return _of_interiorgs(path, document)
    if not isinstance(document, dict):
        raise FormatError(f"{path}: {short(document)} is not a file of labels ({KNOWN})")
    if "dcap_labels" in document or "things" in document:
        return read_things(path, document)
    if "vertex_instance" in document:
        return read_vertex_list(path, document)
    if GROUPS in document or SEGMENTS in document:
        return read_segments(path, document)
    if is_roomplan(document):
        return read_roomplan(path, document)
    keys = ", ".join(list(map(str, document))[:6]) or "none"
    raise FormatError(f"{path}: no file of labels that is read: its keys are {keys}; expected {KNOWN}")


def _of_interiorgs(path: Path, document: object) -> GivenLabels:
    """Labelled boxes in metres and z up."""
    boxes = [one.box for one in label_entries(document, refusing(path)) if one.box is not None]
    if not boxes:
        raise FormatError(f"{path}: no labelled boxes in it")
    none = np.zeros((0, 2), np.int64)
    things = tuple(GivenThing(one.id, one.label, 1.0, none, one.box.corners) for one in boxes)
    return GivenLabels(path.name, things, CornerFrame.Z_UP, complete=False, mesh="")
