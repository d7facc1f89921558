"""One door for all files of Gaussian splats: which there are, how each is recognised and read."""

from collections.abc import Callable
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.problems import Report
from dcap.scene.readers.mesh.ply_table import describes_splats, read_header
from dcap.scene.readers.splats.records import read_splat_records
from dcap.scene.readers.splats.sog import META, is_sog_meta, read_sog
from dcap.scene.readers.splats.splats import check_splats, read_splats
from dcap.scene.readers.splats.spz import read_spz
from dcap.scene.types.gaussians import Gaussians

SPLAT_READERS: dict[str, Callable[[Path, Report | None], Gaussians]] = {
    ".splat": read_splat_records,
    ".spz": read_spz,
    ".sog": read_sog,
}
"""Reader by the suffix of files that hold nothing but splats."""
SPLAT_SUFFIXES = tuple(SPLAT_READERS)


def is_splats(path: Path) -> bool:
    """Whether a file holds Gaussian splats: by its suffix, a PLY by its header, meta.json by what it describes."""
    if not path.is_file():
        return False
    if path.suffix.lower() in SPLAT_READERS or path.name == META:
        return path.name != META or is_sog_meta(path)
    if path.suffix.lower() != ".ply":
        return False
    try:
        return describes_splats(read_header(path))
    except InputError:
        return False  # what is wrong is said where the file is read


def read_gaussians(path: Path) -> Gaussians:
    """Read any of them, in the file's own units and axes."""
    reader = read_sog if path.name == META else SPLAT_READERS.get(path.suffix.lower())
    return read_splats(path) if reader is None else reader(path, None)


def check_gaussians(path: Path, report: Report) -> int:
    """Report what is wrong with any of them; returns the number of splats."""
    reader = read_sog if path.name == META else SPLAT_READERS.get(path.suffix.lower())
    return check_splats(path, report) if reader is None else len(reader(path, report))
