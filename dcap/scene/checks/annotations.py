"""Checks labels.json, structure.json and the map of the floor: problems reported by the readers, and contradictions.

Boxes far from every room, below the floor or annotated twice are usual in InteriorGS, so these are warnings.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.scene.checks.findings import Findings, Lines, json_lines, repeated_keys
from dcap.scene.errors import FormatError, GeometryError, Problem, Report, error, note, warning
from dcap.scene.readers.files import FORMATS, read_json
from dcap.scene.readers.scenes.interiorgs import LABELS, STRUCTURE, LabelEntry, label_entries, structure_of
from dcap.scene.readers.scenes.occupancy import NAMES, map_cells, map_extent
from dcap.scene.types.scan import LabelBox, Room

BURIED = 0.1
"""Depth of a box's top below the floor from which the box belongs to nothing visible [m]."""
OUTSIDE = 1.0
"""Distance of a box from every room beyond which it stands on no floor [m]."""
SAME = 1e-3
"""Difference below which boxes are equal [m]."""
T = TypeVar("T")
SLACK = 2.0
"""Largest difference between the sizes of the picture and the map [pixels]: conventions differ by half a pixel per
end."""


def check_annotations(folder: Path, findings: Findings) -> tuple[LabelBox, ...]:
    """Check both files of a folder; returns the usable labelled boxes."""
    rooms: tuple[Room, ...] = ()
    if (folder / STRUCTURE).is_file():
        document, report = read_tree(folder / STRUCTURE, findings)
        if document is not None:
            unread: tuple[tuple[Room, ...], tuple[LabelBox, ...]] = ((), ())
            rooms, _ = boxes_of(structure_of, document, report, unread)
            if not rooms and isinstance(document, dict):
                report(warning("no room with a floor polygon: the floor is unknown", ("rooms",)))
    else:
        findings.report(folder / STRUCTURE)(warning("is missing: rooms, walls and openings are not known"))
    if not (folder / LABELS).is_file():
        findings.report(folder / LABELS)(warning("is missing: instances are found by shape alone"))
        return ()
    document, report = read_tree(folder / LABELS, findings)
    if document is None:
        return ()
    none: tuple[LabelEntry, ...] = ()
    entries = boxes_of(label_entries, document, report, none)
    for problem in label_problems(entries, rooms):
        report(problem)
    return tuple(entry.box for entry in entries if entry.box is not None)


def boxes_of(read: Callable[[object, Report], T], document: object, report: Report, otherwise: T) -> T:
    """The content of a tree by a reader, else `otherwise`: numbers too large for a box are reported as an error."""
    try:
        return read(document, report)
    except GeometryError as broken:
        report(error(str(broken)))
        return otherwise


def read_tree(path: Path, findings: Findings) -> tuple[object | None, Report]:
    """The tree of a JSON file, None if it is missing, and a report with its line numbers."""
    try:
        document, text = read_json(path), path.read_text("utf-8-sig")
    except FormatError as broken:
        line = getattr(broken.__context__, "lineno", 0)
        findings.report(path)(error(str(broken).removeprefix(f"{path}: "), line=line))
        return None, findings.report(path)
    except OSError as broken:
        findings.report(path)(error(f"cannot be read: {broken.strerror}"))
        return None, findings.report(path)
    lines: Lines = json_lines(text)
    for place, line in repeated_keys(text):
        findings.report(path)(warning(f"key {place[-1]!r} is given twice; only the last one counts", line=line))
    if document is None:
        findings.report(path)(error("the file holds null", line=1))
    return document, findings.report(path, lines)


def label_problems(entries: Sequence[LabelEntry], rooms: Sequence[Room]) -> Iterator[Problem]:
    """Problems of boxes that are valid individually."""
    known = [(entry.place, entry.box) for entry in entries if entry.box is not None]
    floor = min((box.box.top for _, box in known if box.label == "floor"), default=0.0)
    seen: dict[bytes, LabelBox] = {}
    for place, box in known:
        at = (*place, "bounding_box")
        corners = box.box.corners
        if box.box.top < floor - BURIED:
            yield warning(f"{_named(box)} ends {floor - box.box.top:.2f} m below the floor; remove it", at)
        if rooms and (away := min(_distance(corners[:, :2], room) for room in rooms)) > OUTSIDE:
            yield warning(f"{_named(box)} is {away:.2f} m away from every room; check its corners", at)
        key = np.round(np.sort(corners, axis=0) / SAME).astype(np.int64).tobytes()
        if key in seen:
            yield warning(f"{_named(box)} has the same box as {_named(seen[key])}; keep one of them", at)
        seen.setdefault(key, box)


def _named(box: LabelBox) -> str:
    return f"{box.label} ({box.id})"


def _distance(footprint: NDArray[np.float64], room: Room) -> float:
    """Distance between the rectangles around a footprint (n, 2) and a room [m]."""
    apart = np.maximum(
        room.profile.min(axis=0) - footprint.max(axis=0), footprint.min(axis=0) - room.profile.max(axis=0)
    )
    return float(np.linalg.norm(np.maximum(apart, 0.0)))


def check_occupancy(folder: Path, findings: Findings) -> None:
    """Check both files of a folder; a file without its counterpart is not read."""
    document, picture = (folder / name for name in NAMES)
    missing = [path for path in (document, picture) if not path.is_file()]
    if len(missing) == len(NAMES):
        findings.report(document)(note("is missing: free floor is not known"))
    elif missing:
        other = picture if missing == [document] else document
        findings.report(missing[0])(warning(f"is missing next to {other.name}, which is not read without it"))
    else:
        _check_both(document, picture, findings)


def _check_both(document: Path, picture: Path, findings: Findings) -> None:
    tree, report = read_tree(document, findings)
    extent = map_extent(tree, report) if tree is not None else None
    report = findings.report(picture)
    cells = map_cells(picture, report)
    if cells is None:
        return
    with Image.open(picture, formats=FORMATS) as image:
        if image.mode not in ("L", "1"):
            report(warning(f"a picture of mode {image.mode}, expected 8 bits of grey"))
    if extent is None:
        return
    for axis, side in enumerate(("wide", "high")):
        pixels = cells.shape[1 - axis]
        expected = (extent.upper[axis] - extent.lower[axis]) / extent.scale
        if abs(pixels - expected) > SLACK:
            what = f"{pixels} pixels {side}, but lower, upper and scale of {document.name} make {expected:.1f}"
            report(warning(what + "; write both again"))
