"""occupancy.json and occupancy.png: keys, finite numbers, and a picture that fits them."""

from math import isfinite
from pathlib import Path

from PIL import Image

from scene.checks.annotations import read_tree
from scene.checks.findings import Findings
from scene.problems import Report, error, note, short, warning
from scene.readers.image import UNREADABLE
from scene.spelling import did_you_mean

NEEDED = {"scale": 0, "lower": 3, "upper": 3}
"""Keys that map pixels to metres, and how many numbers each has (0: one by itself)."""
USUAL = {"center": 3, "min": 3, "max": 3}
LEVELS = (0, 127, 255)
"""Occupied, unknown, free."""
MOST_PIXELS = 8192 * 8192
"""Largest map that is looked at [pixels]; InteriorGS has a megapixel."""
SLACK = 2.0
"""Pixels by which the picture may be larger or smaller than the map [-]: conventions differ by a half at each end."""


def check_occupancy(folder: Path, findings: Findings) -> None:
    """Check both files of a folder."""
    document, picture = folder / "occupancy.json", folder / "occupancy.png"
    for path, other in ((document, picture), (picture, document)):
        if not path.is_file() and other.is_file():
            findings.report(path)(warning(f"is missing beside {other.name}, which says nothing without it"))
    if not document.is_file() and not picture.is_file():
        findings.report(document)(note("is missing: free floor is not known"))
    extent = _map_extent(document, findings) if document.is_file() else None
    size = _picture_size(picture, findings.report(picture)) if picture.is_file() else None
    if extent is None or size is None:
        return
    for side, pixels, expected in zip(("wide", "high"), size, extent, strict=True):
        if abs(pixels - expected) > SLACK:
            what = f"{pixels} pixels {side}, but lower, upper and scale of {document.name} make {expected:.1f}"
            findings.report(picture)(warning(what + "; write both anew"))


def _map_extent(path: Path, findings: Findings) -> tuple[float, float] | None:
    """Size of the map in pixels by its keys; None where they do not tell."""
    tree, report = read_tree(path, findings)
    if tree is None:
        return None
    if not isinstance(tree, dict):
        report(error(f"not an object, but {short(tree)}"))
        return None
    values = {key: _numbers(tree, key, count, report) for key, count in (NEEDED | USUAL).items()}
    for low, high in (("lower", "upper"), ("min", "max")):
        if any(a > b for a, b in zip(values[low] or (), values[high] or (), strict=False)):
            report(error(f"{low} {values[low]} is not below {high} {values[high]}", (low,)))
            values[low] = None
    scale, lower, upper = (values[key] for key in NEEDED)
    if scale is not None and scale[0] <= 0.0:
        report(error(f"scale is {scale[0]:g}, expected metres per pixel above 0", ("scale",)))
    elif scale is not None and lower is not None and upper is not None:
        return (upper[0] - lower[0]) / scale[0], (upper[1] - lower[1]) / scale[0]
    return None


def _numbers(tree: dict[str, object], key: str, count: int, report: Report) -> list[float] | None:
    """The numbers of a key; None where they are missing or none."""
    if key not in tree:
        hint = did_you_mean(key, tree)
        report(error(f"key {key!r} is missing{hint}") if key in NEEDED else note(f"key {key!r} is missing{hint}"))
        return None
    value = tree[key]
    row = value if count else [value]
    numeric = isinstance(row, list) and all(isinstance(n, int | float) and not isinstance(n, bool) for n in row)
    expected = f"a list of {count} finite numbers" if count else "a finite number"
    if not numeric or not isinstance(row, list) or len(row) != max(count, 1) or not all(map(_finite, row)):
        report(error(f"{key} is {short(value)}, expected {expected}", (key,)))
        return None
    return [float(number) for number in row]


def _finite(number: float) -> bool:
    try:
        return isfinite(number)
    except OverflowError:  # a whole number beyond all floats
        return False


def _picture_size(path: Path, report: Report) -> tuple[int, int] | None:
    """Width and height [pixels] of a picture that can be read."""
    try:
        with Image.open(path) as image:
            if image.width * image.height > MOST_PIXELS:
                report(error(f"{image.width} x {image.height} pixels; reduce it first"))
                return None
            grey = image.convert("L")
            if image.mode not in ("L", "1"):
                report(warning(f"a picture of mode {image.mode}, expected 8 bits of grey"))
            odd = {value: n for value, n in enumerate(grey.histogram()) if n and value not in LEVELS}
            if odd:
                levels = f"{sum(odd.values())} pixels have other levels than 0, 127 and 255, such as {min(odd)}"
                report(note(f"{levels}: the nearest of them counts"))
            return image.size
    except UNREADABLE as broken:
        report(error(f"the picture cannot be read ({broken})"))
        return None
