"""labels.json as written by `dcap dataset label`: things with names, faces and boxes, with or without corrections by
hand.

Entries with the same id are one thing. An entry without `faces` has a box: six numbers (lowest and highest corner) or
`{center, size, turn_deg}`, in the scene file's own axes and unit. A label that differs from the entry's `guess` comes
from a person: it is certain, and its parts are determined again.
"""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path

import numpy as np

from dcap.arrays import Array, IntArray
from dcap.scene.errors import FormatError, short
from dcap.scene.text import did_you_mean, short_name
from dcap.scene.types.segmentation import CornerFrame, GivenLabels, GivenPart, GivenThing

VERSION = 1
KEYS = ("number", "id", "label", "guess", "confidence", "structure", "size_m", "surface_m", "box", "parts", "faces",
        "guesses")  # fmt: skip
"""Keys that an entry may have."""


def read_things(path: Path, document: Mapping[str, object]) -> GivenLabels:
    """The things of a document; raises FormatError with the entry and its problem."""
    if document.get("dcap_labels") != VERSION:
        raise FormatError(f"{path}: dcap_labels is {short(document.get('dcap_labels'))}, expected {VERSION}")
    entries = document.get("things")
    if not isinstance(entries, list) or not entries:
        raise FormatError(f"{path}: things is {short(entries)}, expected a list of things")
    up, mesh = document.get("up", "z"), document.get("mesh")
    if up not in ("x", "y", "z", "-y", "-z"):
        raise FormatError(f"{path}: up is {short(up)}, expected y, z, -y or -z")
    read = [EntryReader(path, index, entry, str(up)).thing() for index, entry in enumerate(entries)]
    digest = str(mesh.get("digest", "")) if isinstance(mesh, dict) else ""
    if not digest and any(len(one.faces) for one in read):
        raise FormatError(f"{path}: mesh.digest is missing; it identifies the mesh of the faces")
    return GivenLabels(path.name, merged(path, read), CornerFrame.FILE, complete=True, mesh=digest)


def merged(path: Path, read: list[GivenThing]) -> tuple[GivenThing, ...]:
    """Entries with the same id merged into one thing; they must not contradict each other."""
    groups: dict[str, list[GivenThing]] = {}
    for number, one in enumerate(read):
        groups.setdefault(one.id or f" {number}", []).append(one)
    return tuple(together(path, group) for group in groups.values())


def together(path: Path, group: list[GivenThing]) -> GivenThing:
    """One thing from several entries."""
    if len(group) == 1:
        return group[0]
    named = {one.label for one in group if one.confidence == 1.0} or {one.label for one in group}
    if len(named) > 1:
        listed = " and ".join(sorted(repr(name) for name in named))
        raise FormatError(f"{path}: id {group[0].id!r} is {listed}; things that are merged have one label")
    if not all(len(one.faces) for one in group):
        raise FormatError(
            f"{path}: id {group[0].id!r} is given twice and once without faces; give the box an id of its own"
        )
    label = named.pop()
    sure = max(one.confidence for one in group if one.label == label)
    faces = np.concatenate([one.faces for one in group])
    return GivenThing(group[0].id, label, sure, faces, np.zeros((0, 3)))


class EntryReader:
    """One entry of the list."""

    def __init__(self, path: Path, index: int, entry: object, up: str) -> None:
        self.path, self.up, self.where = path, up, f"thing {index}"
        if not isinstance(entry, dict):
            raise FormatError(f"{path}: {self.where} is {short(entry)}, expected an object")
        self.entry: Mapping[str, object] = entry
        named = entry.get("id") or entry.get("label")
        self.where += f" ({named})" if isinstance(named, str) else ""

    def wrong(self, what: str) -> FormatError:
        """The error for a mistake in the entry."""
        return FormatError(f"{self.path}: {self.where}: {what}")

    def thing(self) -> GivenThing:
        """The entry as a thing."""
        for key in self.entry:
            if key not in KEYS:
                raise self.wrong(f"unknown key {key!r}{did_you_mean(key, KEYS)}")
        label, guess = self.text("label"), self.text("guess")
        if not label:
            raise self.wrong("label is missing; say what it is, or delete the whole entry")
        faces = self.runs("faces", self.entry.get("faces"))
        box = self.entry.get("box")
        corners = np.zeros((0, 3)) if box is None else self.corners(box)
        if not len(faces) and not len(corners):
            raise self.wrong("neither faces nor a box; give one of them")
        own = label == guess
        return GivenThing(
            id=self.text("id"),
            label=label,
            confidence=self.confidence() if own else 1.0,
            faces=faces,
            corners=corners,
            parts=self.parts() if own and len(faces) else (),
            guesses=self.guesses() if own else (),
        )

    def text(self, key: str) -> str:
        """A text of one or more words, in lower case; empty if it is missing."""
        value = self.entry.get(key, "")
        if isinstance(value, bool) or not isinstance(value, str | int):
            raise self.wrong(f"{key} is {short(value)}, expected text")
        return short_name(" ".join(str(value).lower().split() if key != "id" else str(value).split()))

    def confidence(self) -> float:
        """Confidence of the label, 0..1."""
        value = self.entry.get("confidence", 1.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
            raise self.wrong(f"confidence is {short(value)}, expected a number from 0 to 1")
        return float(value)

    def guesses(self) -> tuple[tuple[str, float], ...]:
        """Labels with their probabilities."""
        rows = self.entry.get("guesses") or []
        sound = isinstance(rows, list) and all(isinstance(row, list) and len(row) == 2 for row in rows)
        if not isinstance(rows, list) or not sound or not all(isinstance(name, str) for name, _ in rows):
            raise self.wrong(f"guesses is {short(rows)}, expected a list of [label, probability]")
        return tuple((name, float(self.numbers("guesses", [share], 1)[0])) for name, share in rows)

    def runs(self, key: str, value: object) -> IntArray:
        """Runs of faces, shape (k, 2)."""
        rows = [] if value is None else value
        if not isinstance(rows, list):
            raise self.wrong(f"{key} is {short(value)}, expected a list of [first, end]")
        for row in rows:
            pair = isinstance(row, list) and len(row) == 2 and all(type(one) is int for one in row)
            if not pair or not 0 <= row[0] < row[1] < 2**31:
                raise self.wrong(f"{key} has {short(row)}, expected [first, end] of whole numbers")
        return np.array(rows, dtype=np.int64).reshape(-1, 2)

    def parts(self) -> tuple[GivenPart, ...]:
        """The parts of a thing whose label was not changed."""
        rows = self.entry.get("parts") or []
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise self.wrong(f"parts is {short(rows)}, expected a list of objects with name and faces")
        found = []
        for number, row in enumerate(rows):
            name = " ".join(str(row.get("name") or "").lower().split())
            faces = self.runs(f"faces of part {number}", row.get("faces"))
            if not name or not len(faces):
                raise self.wrong(f"part {number} has no {'faces' if name else 'name'}")
            found.append(GivenPart(name, faces))
        return tuple(found)

    def corners(self, box: object) -> Array:
        """The corners of a box in the file's frame, shape (8, 3)."""
        if isinstance(box, dict):
            center, size = (self.numbers(f"{key} of box", box.get(key), 3) for key in ("center", "size"))
            turn = self.numbers("turn_deg of box", [box.get("turn_deg", 0.0)], 1)[0]
            if (size <= 0).any():
                raise self.wrong(f"size of box is {short(box.get('size'))}, expected three positive lengths")
            return turned_corners(center, size, float(turn), self.up)
        ends = self.numbers("box", box, 6).reshape(2, 3)
        if (ends[0] >= ends[1]).any():
            raise self.wrong(f"box is {short(box)}, expected the lowest corner and then the highest")
        return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]] for k in (0, 1) for j in (0, 1) for i in (0, 1)])

    def numbers(self, what: str, value: object, count: int) -> Array:
        """`count` finite numbers, shape (count,)."""
        row = value if isinstance(value, list) else []
        sound = all(isinstance(one, int | float) and not isinstance(one, bool) and isfinite(one) for one in row)
        if len(row) != count or not sound:
            raise self.wrong(f"{what} is {short(value)}, expected {count} finite numbers")
        return np.array(row, dtype=np.float64)


def turned_corners(center: Array, size: Array, turn_deg: float, up: str) -> Array:
    """Corners of a box with the given length, breadth and height, turned about the file's upward axis, shape (8, 3)."""
    along, across, upward = up_frame(up)
    turn = np.radians(turn_deg)
    x = np.cos(turn) * along + np.sin(turn) * across
    y = np.cos(turn) * across - np.sin(turn) * along
    signs = np.array([[i, j, k] for k in (-0.5, 0.5) for j in (-0.5, 0.5) for i in (-0.5, 0.5)])
    return np.asarray(center + (signs * size) @ np.stack([x, y, upward]))


def up_frame(up: str) -> tuple[Array, Array, Array]:
    """The file's axes that are world x, y and z: x, -z and y for a file with y up; each of shape (3,)."""
    x = np.array([1.0, 0.0, 0.0])
    upward = {"z": [0, 0, 1.0], "-z": [0, 0, -1.0], "y": [0, 1.0, 0], "-y": [0, -1.0, 0]}.get(up, [0, 0, 1.0])
    return x, np.cross(upward, x), np.array(upward)
