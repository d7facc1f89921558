"""Single entry point for all files of points: PLY without faces, PCD, text of x y z, arrays of numpy.

Out: points in the file's own units and axes, and the assumptions made. Guaranteed: sizes stated in a header are
compared with the file before memory is allocated.
"""

import zipfile
from collections.abc import Callable
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError, short
from dcap.scene.readers.files import MAX_FILE_BYTES, read_bytes
from dcap.scene.readers.mesh.ply import colors_of, describes_splats, is_scalar, read_header, read_tables, scalar
from dcap.scene.readers.mesh.raw import RawMesh, squares
from dcap.scene.readers.points.pcd import Notes, check_point_count, cloud_of, cloud_of_rows, read_pcd
from dcap.scene.types.point_cloud import PointCloud, local_planes

FACES = ("face", "tristrips")
"""Elements that mark a PLY as a mesh."""
COMMENTS = ("#", "//")
HEAD_BYTES = 1 << 16
"""Length of the beginning of a text in which its first row of numbers must lie [bytes]."""
POINT_KEYS = ("points", "xyz", "positions", "position", "vertices", "pos", "arr_0")
COLOR_KEYS = ("colors", "color", "colours", "colour", "rgb")
NORMAL_KEYS = ("normals", "normal")
"""Names of arrays in an .npz; the first that exists is used."""
ONLY = "the array"
"""Name of the array of an .npy."""
BROKEN_ARRAYS = (
    ValueError, EOFError, SyntaxError, OverflowError, MemoryError, RecursionError, OSError, zipfile.BadZipFile
)  # fmt: skip
"""Errors that numpy raises for bytes that are not arrays."""
MOST_SQUARES = 100_000
"""Number of squares that represent the points of a file in finding its units and axes [-]."""
STRAY = 10.0
"""Points whose distance to others exceeds the usual distance by this factor do not count there [-]."""


def is_points(path: Path) -> bool:
    """Return whether a file holds a point cloud: by its suffix, or for a PLY by its header."""
    if not path.is_file():
        return False
    if path.suffix.lower() != ".ply":
        return path.suffix.lower() in POINT_SUFFIXES
    try:
        header = read_header(path)
    except InputError:
        return False  # the problem is reported when the file is read
    has_points = bool({"x", "y", "z"} <= header.properties("vertex")) and not describes_splats(header)
    return has_points and not any(header.counts.get(name, 0) for name in FACES)


def read_points(path: Path) -> tuple[PointCloud, Notes]:
    """Read any of these formats, in the file's own units and axes."""
    return POINT_READERS.get(path.suffix.lower(), read_ply_points)(path)


def read_ply_points(path: Path) -> tuple[PointCloud, Notes]:
    """The vertices of a PLY as points."""
    header = read_header(path)
    check_point_count(path, min(header.counts["vertex"], path.stat().st_size))
    vertex = read_tables(path, header)["vertex"]
    position = np.stack([scalar(path, vertex, axis) for axis in "xyz"], axis=1).astype(np.float64)
    names = ("nx", "ny", "nz")
    given = all(name in vertex and is_scalar(vertex[name]) for name in names)
    normal = np.stack([vertex[name] for name in names], axis=1).astype(np.float64) if given else None
    return cloud_of(path, position, colors_of(vertex), normal)


def read_text_points(path: Path) -> tuple[PointCloud, Notes]:
    """Rows of numbers separated by blanks, commas or semicolons, possibly after a count, a line of names or
    comments."""
    head = read_bytes(path, HEAD_BYTES).decode("utf-8", "replace").splitlines()
    rows = [(k, line) for k, line in enumerate(head) if line.strip() and not line.lstrip().startswith(COMMENTS)]
    if not rows:
        raise FormatError(f"{path}: no row of numbers in its first {HEAD_BYTES} bytes")
    skipped = 0
    if not is_row(rows[0][1]):  # a count, or the names of the columns
        skipped = rows[0][0] + 1
        rows = rows[1:]
    if not rows or not is_row(rows[0][1]):
        where = rows[0] if rows else (skipped - 1, head[skipped - 1])
        raise FormatError(f"{path}: line {where[0] + 1} is {short(where[1])}, expected numbers: x y z ...")
    with path.open("rb") as stream:
        check_point_count(path, sum(block.count(b"\n") for block in iter(lambda: stream.read(1 << 20), b"")))
    mark = next((one for one in ",;" if one in rows[0][1]), None)
    try:
        table = np.loadtxt(path, comments=COMMENTS, delimiter=mark, skiprows=skipped, ndmin=2, encoding="utf-8")
    except ValueError as broken:
        what = " ".join(str(broken).split())
        raise FormatError(f"{path}: not the same numbers in each row: {what[:200]}; export it again") from None
    first = 4 if path.suffix.lower() == ".pts" and table.shape[1] in (4, 7, 10) else 3  # an intensity comes first
    return cloud_of_rows(path, table, first)


def is_row(line: str) -> bool:
    """Return whether a line has at least three numbers."""
    words = line.replace(",", " ").replace(";", " ").split()
    try:
        return len([float(word) for word in words]) >= 3
    except ValueError:
        return False


def read_array_points(path: Path) -> tuple[PointCloud, Notes]:
    """An array of numpy with (n, 3) or more columns; several arrays in an .npz are found by name."""
    arrays = arrays_of(path)
    name = next((one for one in POINT_KEYS if one in arrays), next(iter(arrays)) if len(arrays) == 1 else None)
    if name is None:
        listed = ", ".join(islice(arrays, 8)) or "none"
        raise FormatError(f"{path}: none of its arrays ({listed}) is called {', '.join(POINT_KEYS[:-1])}; rename one")
    rows = arrays[name]
    if rows.dtype.kind not in "iuf" or rows.ndim != 2 or not 3 <= rows.shape[1] <= 32:
        raise FormatError(
            f"{path}: {name} has shape {rows.shape} and type {rows.dtype}, expected numbers of shape (n, 3), or "
            "x y z and colours or normals in more columns"
        )
    check_point_count(path, len(rows))
    beside = [next((arrays[one] for one in keys if one in arrays), None) for keys in (COLOR_KEYS, NORMAL_KEYS)]
    for what, array in zip(("colours", "normals"), beside, strict=True):
        if array is not None and (
            array.dtype.kind not in "iuf" or array.shape[:1] != rows.shape[:1] or array.ndim != 2 or array.shape[1] < 3
        ):
            raise FormatError(f"{path}: {what} have shape {array.shape}, expected ({len(rows)}, 3)")
    if beside[0] is None and beside[1] is None:
        return cloud_of_rows(path, rows.astype(np.float64))
    color, normal = (None if one is None else np.asarray(one[:, :3]) for one in beside)
    return cloud_of(path, rows[:, :3].astype(np.float64), color, None if normal is None else normal.astype(np.float64))


def arrays_of(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of an .npz by name, or that of an .npy by ONLY; pickles are never read."""
    read_bytes(path, 1)
    try:
        if path.suffix.lower() == ".npy":
            # mapped: the size in the header is compared with the file before memory is allocated
            array = np.load(path, mmap_mode="r", allow_pickle=False)
            if not isinstance(array, np.ndarray):
                raise ValueError("an archive of arrays, not an array")
            return {ONLY: array}
        with zipfile.ZipFile(path) as archive:
            size = sum(one.file_size for one in archive.infolist())
        if size > MAX_FILE_BYTES:
            raise InputError(f"{path}: {size / 2**30:.1f} GiB > {MAX_FILE_BYTES / 2**30:.0f} GiB; thin the cloud out")
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files if name in KNOWN_KEYS or len(archive.files) == 1}
    except BROKEN_ARRAYS as broken:
        raise FormatError(f"{path}: cannot be read as arrays of numpy: {' '.join(str(broken).split())[:200]}") from None


KNOWN_KEYS = (*POINT_KEYS, *COLOR_KEYS, *NORMAL_KEYS)

POINT_READERS: dict[str, Callable[[Path], tuple[PointCloud, Notes]]] = {
    ".pcd": read_pcd,
    **dict.fromkeys((".xyz", ".xyzrgb", ".xyzn", ".pts"), read_text_points),
    **dict.fromkeys((".npy", ".npz"), read_array_points),
}
"""Reader by the suffix of files that only hold points."""
POINT_SUFFIXES = tuple(POINT_READERS)


def point_squares(path: Path, cloud: PointCloud, notes: Notes) -> RawMesh:
    """A square in the surface at each of some points, in the file's units: used to find units and axes, as for a
    mesh."""
    some = cloud.subset(np.arange(0, len(cloud), -(-len(cloud) // MOST_SQUARES)))
    planes = local_planes(some.position)
    kept = planes.gap <= STRAY * max(float(np.median(planes.gap)), 1e-12)
    center, normal, half = some.position[kept], planes.normal[kept], 0.5 * planes.gap[kept, None]
    u = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    u *= half / np.linalg.norm(u, axis=1, keepdims=True)
    return squares(path, center, u, np.cross(normal, u), notes=notes)
