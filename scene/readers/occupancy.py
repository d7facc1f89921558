"""InteriorGS' map of the floor: occupancy.json and occupancy.png.

The columns of the picture run against x: x = upper[0] - column * scale, y = lower[1] + row * scale. Programs that read
these maps differ in the mirror and in half a pixel, so both are checked against the rooms of structure.json: of the
mappings the one with most free cells inside rooms is taken, the one above where they tie or where there are no rooms.
"""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scene.errors import FormatError
from scene.occupancy import FREE, OCCUPIED, UNKNOWN, Occupancy
from scene.readers.image import read_gray
from scene.readers.json_text import read_json
from scene.readers.raw import read_bytes
from scene.scan import Room

MAX_CELLS = 8192 * 8192
"""Largest map [pixels]; they are nominally 1024 x 1024."""
LARGEST_SCALE = 10.0
"""A cell larger than this shows no place to stand [m]."""
NAMES = ("occupancy.json", "occupancy.png")


def read_occupancy(folder: Path, rooms: Sequence[Room]) -> tuple[Occupancy | None, tuple[str, ...]]:
    """The map of a scene folder, None where it has none, and notes on what was assumed."""
    missing = [name for name in NAMES if not (folder / name).is_file()]
    if missing:
        return None, (f"{' and '.join(missing)} missing: no map of free places",) if len(missing) < len(NAMES) else ()
    scale, lower, upper = _document(folder / NAMES[0])
    path = folder / NAMES[1]
    cells = _levels(read_gray(read_bytes(path), str(path), MAX_CELLS))
    candidates = _mappings(cells, scale, lower, upper)
    profiles = [room.profile for room in rooms]
    inside = {name: int((one.free & one.within(profiles)).sum()) if profiles else 0 for name, one in candidates.items()}
    documented = next(iter(candidates))
    best = max(inside, key=lambda name: inside[name])  # the first of equals
    notes = []
    if best != documented:
        notes.append(
            f"occupancy.png is read {best}: {inside[best]} free cells are inside rooms then, "
            f"{inside[documented]} as documented ({documented})"
        )
    if profiles and not inside[best]:
        notes.append("occupancy.png has no free cell inside a room of structure.json")
    return candidates[best], tuple(notes)


def _mappings(
    cells: NDArray[np.uint8], scale: float, lower: NDArray[np.float64], upper: NDArray[np.float64]
) -> dict[str, Occupancy]:
    """Ways to read the picture by name, the documented one first."""
    return {
        f"{mirror} with {place}": Occupancy(
            cells,
            np.array([x + sign * shift * scale, lower[1] + shift * scale]),
            np.array([sign * scale, scale]),
        )
        for mirror, x, sign in (("mirrored", upper[0], -1.0), ("unmirrored", lower[0], 1.0))
        for place, shift in (("cells around whole numbers", 0.0), ("cells from whole numbers on", 0.5))
    }


def _document(path: Path) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Side of a cell [m] and the corners of the map [m], shape (2,) each; what else is there must be numbers too."""
    document = read_json(path)
    if not isinstance(document, dict):
        raise FormatError(f"{path}: not an object")
    scale = document.get("scale")
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not 0.0 < scale <= LARGEST_SCALE:
        raise FormatError(f"{path}: scale is {scale!r}, expected metres per pixel up to {LARGEST_SCALE}")
    lower, upper = (_vector(path, document, key) for key in ("lower", "upper"))
    for key in ("center", "min", "max"):
        if key in document:
            _vector(path, document, key)
    if not (lower[:2] < upper[:2]).all():
        raise FormatError(f"{path}: lower is {lower.tolist()}, not below upper, {upper.tolist()}")
    return float(scale), lower[:2], upper[:2]


def _vector(path: Path, document: dict[str, object], key: str) -> NDArray[np.float64]:
    """Two or three finite coordinates."""
    value = document.get(key)
    if not isinstance(value, list) or len(value) not in (2, 3):
        raise FormatError(f"{path}: {key} is {value!r}, expected three coordinates")
    if not all(isinstance(v, int | float) and not isinstance(v, bool) and _finite(v) for v in value):
        raise FormatError(f"{path}: {key} is {value!r}, expected finite numbers")
    return np.array(value, dtype=np.float64)


def _finite(value: float) -> bool:
    try:
        return isfinite(value)
    except OverflowError:  # an integer beyond all floats
        return False


def _levels(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Each pixel as the nearest of the three values: a map that was scaled has others at its borders."""
    out = np.full(gray.shape, UNKNOWN, dtype=np.uint8)
    out[gray < (OCCUPIED + UNKNOWN) // 2] = OCCUPIED
    out[gray > (UNKNOWN + FREE) // 2] = FREE
    return out
