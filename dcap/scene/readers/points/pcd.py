"""Point clouds of the Point Cloud Library, and points from rows of numbers.

The fields x y z, normal_x normal_y normal_z and rgb or rgba are used; others and the viewpoint are ignored. Only
compressed data is left to Open3D, because its other readers are unreliable: one returns zeros for doubles, the other
mixes up fields of different sizes, and both return the rest of a broken file with a warning. Source: "The PCD (Point
Cloud Data) file format", pointclouds.org.

Points from rows of numbers: columns of colours and normals are recognised by their values.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import read_bytes
from dcap.scene.types.point_cloud import PointCloud

Notes = tuple[str, ...]

MOST_POINTS = 12_000_000
"""Maximum number of points of a file [-]: with nine numbers per row they take 0.9 GB."""
FEWEST_POINTS = 100
"""Minimum number of points for a surface [-]."""
FLAT = 0.002
"""Largest ratio of the root mean square distances across and along the best plane at which a cloud is a plane [-]."""
GREY = 200
"""sRGB grey level of points without colours."""
UNIT_LENGTH = 0.02
"""Largest deviation of the length of a normal from 1 [-]."""
HEADER_LIMIT = 1 << 14
"""Maximum length of a header [bytes]."""
ENCODINGS = ("ascii", "binary", "binary_compressed")


def check_point_count(path: Path, count: int) -> None:
    """Refuse more points than we can handle, before memory is allocated."""
    if count > MOST_POINTS:
        raise InputError(f"{path}: {count} points > {MOST_POINTS}; thin the cloud out first (voxel downsampling)")


def cloud_of(
    path: Path, position: Array, color: NDArray[np.generic] | None, normal: Array | None
) -> tuple[PointCloud, Notes]:
    """Checked points and their missing properties: coordinates must be finite, numerous enough, and not in a plane."""
    count = len(position)
    if not count:
        raise InputError(f"{path}: no points in it; export the cloud again")
    finite = np.isfinite(position).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise FormatError(
            f"{path}: point {bad} is not finite: {position[bad].tolist()} ({count - int(finite.sum())} of {count} such "
            "points); remove them and save it again"
        )
    check_spread(path, position)
    notes: Notes = ()
    if color is None:
        notes += ("no colours in the file: its points are grey",)
    if normal is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(normal, axis=1)
        bad = ~(np.isfinite(length) & (length > 1e-6))
        if bad.any():
            notes += (f"{int(bad.sum())} of {count} normals in the file have no direction: none of them is used",)
            normal = None
        else:
            normal = normal / length[:, None]
    shade = np.full((count, 3), GREY, dtype=np.uint8) if color is None else bytes_of(color)
    return PointCloud(np.ascontiguousarray(position, dtype=np.float64), shade, normal), notes


def check_spread(path: Path, position: Array) -> None:
    """Refuse too few points, and points at a single place or in a plane or line."""
    count = len(position)
    if count < FEWEST_POINTS:
        raise InputError(f"{path}: {count} points, expected at least {FEWEST_POINTS}; export a denser cloud")
    offset = position - position.mean(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        moment = offset.T @ offset / count
    if not np.isfinite(moment).all():
        raise FormatError(
            f"{path}: coordinates up to {np.abs(position).max():.3g}, which are not lengths; export it again"
        )
    spread = np.sqrt(np.linalg.eigvalsh(moment).clip(0.0))
    if not spread[2] > 0.0:
        raise InputError(f"{path}: all {count} points lie at {position[0].tolist()}; export the cloud again")
    if spread[0] <= FLAT * spread[2]:
        raise InputError(
            f"{path}: all {count} points lie in a plane (off it by {spread[0]:.2g} units, along it by "
            f"{spread[2]:.2g}), which is neither a scene nor an object; scan it from several sides, or give a mesh"
        )


def bytes_of(color: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Colours (n, 3) as bytes; floats up to 1 are shares, whole numbers up to 65535 have 16 bits."""
    levels = np.nan_to_num(color.astype(np.float64))
    most = float(levels.max(initial=0.0))
    if color.dtype.kind == "f" and most <= 1.0:
        levels *= 255.0
    elif most > 255.0:
        levels *= 255.0 / 65535.0
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def cloud_of_rows(path: Path, rows: Array, first: int = 3) -> tuple[PointCloud, Notes]:
    """Points of rows x y z ... (n, k); columns from `first` on are recognised by their values."""
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise FormatError(f"{path}: an array of shape {rows.shape}, expected (n, 3) or more columns: x y z ...")
    count = rows.shape[1]
    color: Array | None = None
    normal: Array | None = None
    notes: Notes = ()
    ignored = list(range(4, first + 1))
    at = first
    while at < count:
        three = rows[:, at : at + 3]
        kind = kind_of(three) if at + 3 <= count else ""
        if kind == "normals" and normal is None:
            normal = three
        elif kind == "colours" and color is None:
            color = three
        else:
            ignored.append(at + 1)
            at += 1
            continue
        notes += (f"columns {at + 1} to {at + 3} taken as {kind}",)
        at += 3
    if ignored:
        notes += (f"columns that are neither colours nor normals are ignored: {', '.join(map(str, ignored))}",)
    cloud, more = cloud_of(path, rows[:, :3], color, normal)
    return cloud, notes + more


def kind_of(three: Array) -> str:
    """Content of three columns (n, 3): `normals`, `colours` or neither."""
    low, high = float(three.min(initial=0.0)), float(three.max(initial=0.0))
    if not (np.isfinite(low) and np.isfinite(high)):
        return ""
    if low >= -1.01 and high <= 1.01:
        length = np.linalg.norm(three, axis=1)
        if (np.abs(length - 1.0) < UNIT_LENGTH).mean() > 0.9 and (low < 0.0 or len(np.unique(three[:1000])) > 2):
            return "normals"
        return "colours" if low >= 0.0 else ""
    return "colours" if low >= 0.0 and high <= 255.0 and (three == np.rint(three)).all() else ""


def read_pcd(path: Path) -> tuple[PointCloud, Notes]:
    """The points of a PCD file; missing measurements of an organised cloud (HEIGHT above 1) are left out, and
    counted."""
    header, start = read_header(path)
    count = checked_count(path, header, start)
    columns = columns_of(path, header, start, count)
    position = np.stack([columns[name] for name in "xyz"], axis=1).astype(np.float64)
    color = next((channels(columns[name]) for name in ("rgb", "rgba") if name in columns), None)
    given = all(name in columns for name in NORMAL)
    normal = np.stack([columns[name] for name in NORMAL], axis=1).astype(np.float64) if given else None
    notes: Notes = ()
    measured = ~np.isnan(position).any(axis=1)
    if int(header["HEIGHT"][0]) > 1 and not measured.all():
        if not measured.any():
            raise InputError(f"{path}: none of its {count} points has a measurement (all are nan); export it again")
        notes += (f"{count - int(measured.sum())} of {count} pixels have no measurement (nan) and are skipped",)
        position = position[measured]
        color = None if color is None else color[measured]
        normal = None if normal is None else normal[measured]
    viewpoint = header.get("VIEWPOINT", UNMOVED)
    if [float(one) for one in viewpoint] != [float(one) for one in UNMOVED]:
        notes += (f"the viewpoint {' '.join(viewpoint)} is not applied: points are used unchanged",)
    cloud, more = cloud_of(path, position, color, normal)
    return cloud, notes + more


def columns_of(path: Path, header: dict[str, list[str]], start: int, count: int) -> dict[str, NDArray[np.generic]]:
    """The single-number fields by name, shape (n,) each."""
    fields, sizes, counts = header["FIELDS"], header["SIZE"], [int(one) for one in header["COUNT"]]
    kinds = [f"<{TYPES[kind]}{size}" for kind, size in zip(header["TYPE"], sizes, strict=True)]
    encoding = header["DATA"][0].lower()
    if encoding == "binary_compressed":
        return unpacked(path, dict(zip(fields, kinds, strict=True)), count)
    if encoding == "binary":
        rows = np.dtype(
            [(f"{k} {name}", kind, (n,)) for k, (name, kind, n) in enumerate(zip(fields, kinds, counts, strict=True))]
        )
        table = np.memmap(path, dtype=rows, mode="r", offset=start, shape=(count,))
        return {
            name: np.asarray(table[f"{k} {name}"][:, 0])
            for k, (name, n) in enumerate(zip(fields, counts, strict=True)) if n == 1
        }  # fmt: skip
    try:
        with path.open("rb") as stream:
            stream.seek(start)
            text = np.loadtxt(stream, ndmin=2, encoding="ascii")
    except ValueError as broken:
        what = " ".join(str(broken).split())[:200]
        raise FormatError(f"{path}: not the same numbers in each row: {what}; export it again") from None
    if text.shape != (count, sum(counts)):
        raise FormatError(
            f"{path}: {text.shape[0]} rows of {text.shape[1]} numbers, expected {count} of {sum(counts)}; save it again"
        )
    first = np.cumsum([0, *counts[:-1]])
    return {
        name: text[:, at].astype(kind)
        for name, kind, at, n in zip(fields, kinds, first, counts, strict=True) if n == 1
    }  # fmt: skip


def unpacked(path: Path, kinds: dict[str, str], count: int) -> dict[str, NDArray[np.generic]]:
    """Fields of a compressed file; its floating-point fields must have the same size."""
    import open3d

    wanted = {kinds[name] for name in ("x", "y", "z", *NORMAL) if name in kinds}
    if len(wanted) > 1:
        raise InputError(
            f"{path}: compressed fields of different types ({', '.join(sorted(wanted))}); save it as binary"
        )
    with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
        found = open3d.t.io.read_point_cloud(path, format="pcd").point
    have = len(found["positions"]) if "positions" in found else 0
    if have != count:
        raise FormatError(f"{path}: {have} of {count} points can be unpacked: the file is broken; save it again")
    columns = dict(zip("xyz", found["positions"].numpy().T, strict=True))
    if "normals" in found:
        columns |= dict(zip(NORMAL, found["normals"].numpy().T, strict=True))
    if "colors" in found:
        byte = found["colors"].numpy().astype(np.uint32)
        columns["rgb"] = byte[:, 0] << 16 | byte[:, 1] << 8 | byte[:, 2]
    return columns


def channels(packed: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Red, green and blue (n, 3) from the bytes of a whole number, or of a float that contains one."""
    word = packed.astype("<f4").view("<u4") if packed.dtype.kind == "f" else packed.astype("<u4")
    return np.stack([word >> shift & 255 for shift in (16, 8, 0)], axis=1).astype(np.uint8)


NORMAL = ("normal_x", "normal_y", "normal_z")
TYPES = {"I": "i", "U": "u", "F": "f"}
UNMOVED = ["0", "0", "0", "1", "0", "0", "0"]
"""The viewpoint of points in their own frame."""


def read_header(path: Path) -> tuple[dict[str, list[str]], int]:
    """The words of each line by its key, and the offset of the data [bytes]."""
    head = read_bytes(path, HEADER_LIMIT)
    header: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in header:
        end = head.find(b"\n", at)
        if end < 0:
            raise FormatError(f"{path}: the PCD header has no DATA line in its first {HEADER_LIMIT} bytes")
        words = head[at:end].decode("ascii", "replace").split()
        at = end + 1
        if words and not words[0].startswith("#"):
            header[words[0].upper()] = words[1:]
    return header, at


def checked_count(path: Path, header: dict[str, list[str]], start: int) -> int:
    """The number of points, after checking that the header is complete and the file long enough."""
    fields = header.get("FIELDS", [])
    if not {"x", "y", "z"} <= set(fields):
        raise FormatError(f"{path}: the PCD header has fields {' '.join(fields) or 'none'}, expected x y z among them")
    header.setdefault("COUNT", ["1"] * len(fields))
    try:
        sizes, counts = ([int(one) for one in header[key]] for key in ("SIZE", "COUNT"))
        width, height = int(header["WIDTH"][0]), int(header["HEIGHT"][0])
        points = int(header.get("POINTS", [str(width * height)])[0])
        encoding = header["DATA"][0].lower()
        viewpoint = [float(one) for one in header.get("VIEWPOINT", [])]
    except (KeyError, IndexError, ValueError) as broken:
        raise FormatError(f"{path}: the PCD header is not understood ({type(broken).__name__}: {broken})") from None
    for kind, size in zip(header.get("TYPE", []), sizes, strict=False):
        if size not in {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}.get(kind, ()):
            raise FormatError(f"{path}: a field of TYPE {kind} and SIZE {size}, which PCD does not have")
    lengths = {len(fields), len(sizes), len(counts), len(header.get("TYPE", []))}
    if (
        len(lengths) > 1
        or min(sizes + counts) < 1
        or points != width * height
        or points < 0
        or len(viewpoint) not in (0, 7)
    ):
        raise FormatError(
            f"{path}: the PCD header contradicts itself: {len(fields)} FIELDS, {len(sizes)} SIZE, "
            f"{len(header.get('TYPE', []))} TYPE, {len(counts)} COUNT, {width} x {height} for {points} POINTS"
        )
    if encoding not in ENCODINGS:
        raise FormatError(f"{path}: DATA {encoding}, expected one of {', '.join(ENCODINGS)}")
    if not points:
        raise InputError(f"{path}: no points in it; export the cloud again")
    check_point_count(path, points)
    row, left = sum(s * c for s, c in zip(sizes, counts, strict=True)), path.stat().st_size - start
    needed = {"ascii": 2 * sum(counts) * points - 1, "binary": row * points, "binary_compressed": 8}[encoding]
    if left >= 8 and encoding == "binary_compressed":
        with path.open("rb") as stream:
            stream.seek(start)
            packed, plain = (int(one) for one in np.frombuffer(stream.read(8), dtype="<u4"))
        if plain != row * points:
            raise FormatError(
                f"{path}: {plain} bytes unpacked, expected {row * points} for {points} points; save it again"
            )
        needed = 8 + packed
    if needed > left:
        raise FormatError(
            f"{path}: {points} points need {needed} bytes, {left} follow the header: the file is truncated"
        )
    return points
