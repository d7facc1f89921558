"""Checks occupancy.json and occupancy.png: problems that the reader reports, and contradictions between the two."""

from pathlib import Path

from PIL import Image

from dcap.scene.checks.annotations import read_tree
from dcap.scene.checks.findings import Findings
from dcap.scene.problems import note, warning
from dcap.scene.readers.files.image import FORMATS
from dcap.scene.readers.scenes.occupancy import NAMES, map_cells, map_extent

SLACK = 2.0
"""Largest difference between the picture and the map [pixels]: conventions differ by half a pixel at each end."""


def check_occupancy(folder: Path, findings: Findings) -> None:
    """Check both files of a folder; a single one is not read."""
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
