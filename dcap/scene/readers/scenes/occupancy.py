"""InteriorGS' map of the floor: occupancy.json and occupancy.png.

The columns of the picture run against x: x = upper[0] - column * scale, y = lower[1] + row * scale. Programs that read
these maps differ in the mirroring and by half a pixel, so both are checked against the rooms of structure.json: the
mapping with most free cells inside rooms is used, or the one above in case of a tie or without rooms.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError, Report, error, note, refusing, short
from dcap.scene.readers.files import MAX_PIXELS, read_bytes, read_gray, read_json
from dcap.scene.text import did_you_mean
from dcap.scene.types.floor_plan import FREE, OCCUPIED, UNKNOWN, Occupancy
from dcap.scene.types.scan import Room

MAX_CELLS = MAX_PIXELS
"""Largest map [pixels]; they are nominally 1024 x 1024."""
LARGEST_SCALE = 10.0
"""Largest cell [m]; a larger one cannot show a place to stand."""
NAMES = ("occupancy.json", "occupancy.png")
CORNERS = ("lower", "upper")
"""Points that a map requires besides its scale."""


@dataclass(frozen=True, slots=True)
class MapExtent:
    """Extent of a map."""

    scale: float
    """Side of a cell [m]."""
    lower: tuple[float, float]
    """Minimum of x and y [m]."""
    upper: tuple[float, float]
    """Maximum of x and y [m]."""


def read_occupancy(folder: Path, rooms: Sequence[Room]) -> tuple[Occupancy | None, tuple[str, ...]]:
    """The map of a scene folder, or None, and notes on assumptions."""
    missing = [name for name in NAMES if not (folder / name).is_file()]
    if missing:
        return None, (f"{' and '.join(missing)} missing: no map of free places",) if len(missing) < len(NAMES) else ()
    document, picture = (folder / name for name in NAMES)
    extent = map_extent(read_json(document), refusing(document))
    cells = map_cells(picture, refusing(picture))
    if extent is None or cells is None:
        return None, ()  # not reached: files without them are refused
    candidates = _mappings(cells, extent)
    profiles = [room.profile for room in rooms]
    inside = {name: int((one.free & one.within(profiles)).sum()) if profiles else 0 for name, one in candidates.items()}
    documented = next(iter(candidates))
    best = max(inside, key=lambda name: inside[name])  # the first of several
    notes = []
    if best != documented:
        notes.append(
            f"occupancy.png is read {best}: {inside[best]} free cells are inside rooms then, "
            f"{inside[documented]} as documented ({documented})"
        )
    if profiles and not inside[best]:
        notes.append("occupancy.png has no free cell inside a room of structure.json")
    return candidates[best], tuple(notes)


def _mappings(cells: NDArray[np.uint8], extent: MapExtent) -> dict[str, Occupancy]:
    """Ways to read the picture, by name, the documented one first."""
    scale, lower, upper = extent.scale, extent.lower, extent.upper
    return {
        f"{mirror} with {place}": Occupancy(
            cells,
            np.array([x + sign * shift * scale, lower[1] + shift * scale]),
            np.array([sign * scale, scale]),
        )
        for mirror, x, sign in (("mirrored", upper[0], -1.0), ("unmirrored", lower[0], 1.0))
        for place, shift in (("cells around whole numbers", 0.0), ("cells from whole numbers on", 0.5))
    }


def map_extent(document: object, report: Report) -> MapExtent | None:
    """Extent of the map from occupancy.json; None if it is not stated."""
    if not isinstance(document, dict):
        report(error(f"not an object, but {short(document)}"))
        return None
    scale = _scale(document, report)
    lower, upper = (_point(document, key, report) for key in CORNERS)
    if lower is None or upper is None:
        return None
    if lower[0] >= upper[0] or lower[1] >= upper[1]:
        report(error(f"lower {lower} is not below upper {upper} in x and y", ("lower",)))
        return None
    return MapExtent(scale, (lower[0], lower[1]), (upper[0], upper[1])) if scale is not None else None


def _scale(document: dict[str, object], report: Report) -> float | None:
    """Side of a cell [m]; None if it is missing or invalid."""
    if "scale" not in document:
        report(error(f"key 'scale' is missing{did_you_mean('scale', document)}"))
        return None
    value = document["scale"]
    number = _number(value)
    if number is None or not 0.0 < number <= LARGEST_SCALE:
        expected = f"metres per pixel above 0 and up to {LARGEST_SCALE:g}"
        report(error(f"scale is {short(value)}, expected {expected}", ("scale",)))
        return None
    return number


def _point(document: dict[str, object], key: str, report: Report) -> list[float] | None:
    """x, y and usually z [m] at a key; None if they are missing or invalid."""
    if key not in document:
        report(error(f"key {key!r} is missing{did_you_mean(key, document)}"))
        return None
    value = document[key]
    numbers = [_number(one) for one in value] if isinstance(value, list) else []
    point = [number for number in numbers if number is not None]
    if len(numbers) not in (2, 3) or len(point) < len(numbers):
        report(error(f"{key} is {short(value)}, expected three finite numbers x, y, z", (key,)))
        return None
    return point


def _number(value: object) -> float | None:
    """A finite number; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:  # an integer beyond all floats
        return None


def map_cells(path: Path, report: Report) -> NDArray[np.uint8] | None:
    """FREE, OCCUPIED or UNKNOWN from the pixels of occupancy.png, shape (rows, columns); None if it cannot be read."""
    try:
        gray = read_gray(read_bytes(path), str(path), MAX_CELLS)
    except InputError as broken:
        report(error(str(broken).removeprefix(f"{path}: ")))
        return None
    except OSError as broken:
        report(error(f"cannot be read: {broken.strerror}"))
        return None
    cells = _levels(gray)
    odd = gray[gray != cells]
    if len(odd):
        levels = f"{OCCUPIED}, {UNKNOWN} and {FREE}, such as {odd.min()}"
        report(note(f"{len(odd)} pixels have other levels than {levels}: the nearest of them counts"))
    return cells


def _levels(gray: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Each pixel as the nearest of the three values: a rescaled map has other values at its borders."""
    out = np.full(gray.shape, UNKNOWN, dtype=np.uint8)
    out[gray < (OCCUPIED + UNKNOWN) // 2] = OCCUPIED
    out[gray > (UNKNOWN + FREE) // 2] = FREE
    return out
