"""Gaussian splats from PLY files, plain and compressed by PlayCanvas; and functions shared by all readers of splats.

Plain: x y z, f_dc_0..2, opacity, scale_0..2, rot_0..3 and 0, 9, 24 or 45 f_rest, in any order; normals are ignored.
Compressed (InteriorGS): a chunk holds the ranges (min and max, floats) of 256 splats: x y z, scale_x scale_y scale_z
and usually r g b. A splat has four words of 32 bits, highest bits first: packed_position and packed_scale (11, 10, 11:
x, y, z as a share of the range, of the logarithm for scales), packed_rotation (2, 10, 10, 10: which of (w, x, y, z) is
left out, the largest, positive; the others in order, from -1/sqrt 2 to 1/sqrt 2), packed_color (8 each: r, g, b, as a
share of the range if there is one, and alpha). A harmonic is a byte: 0 is -4, 255 is 4, any other b is
8 ((b + 1/2) / 256 - 1/2).

Guaranteed: the counts in the header are checked against the file's length before memory is allocated.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array
from dcap.scene.errors import FormatError, InputError, Problem, Report, error, refusing, warning
from dcap.scene.readers.mesh.ply import Table, describes_splats, read_header, read_tables, scalar
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.types.gaussians import COEFFICIENTS, DC, Gaussians

U32 = NDArray[np.uint32]

CHUNK = 256
"""Splats per chunk."""

MOST_SPLATS = 8_000_000
"""Maximum number of splats of a file [-]: at 59 numbers each they take 1.9 GB."""

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
PLAIN = (
    "opacity",
    *(f"f_dc_{i}" for i in range(3)),
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
)

LARGEST_LOGIT = 16.0
"""Largest logit of an opacity [-]: 0 and 1 have no finite logit, and 1e-7 from them is just as good."""

LARGEST_LOG_SCALE = 20.0
"""Largest logarithm of a size [-]: writers clip them, and e^20 m is not a sensible size."""

MOST_DISCS = 100_000
"""Number of squares that represent the Gaussians of a file in finding its units and axes [-]."""

HARMONIC_RANGE = 8.0
"""Harmonics span -4 to 4 in a compressed file [-]."""


def read_splats(path: Path) -> Gaussians:
    """Read either schema, in the file's own units and axes."""
    tables, report = splat_tables(path), refusing(path)
    fields = _packed(path, tables, report) if WORDS[0] in tables["vertex"] else _plain(path, tables["vertex"])
    return gaussians_of(fields, report)


def gaussians_of(fields: "Fields", report: Report) -> Gaussians:
    """Checked Gaussians from the fields of a file; infinite opacities are clipped."""
    check_fields(fields, report)
    position, log_scale, rotation, logit, dc, rest = fields
    return Gaussians(position, log_scale, rotation, _bounded(logit), dc, rest)


def check_splats(path: Path, report: Report) -> int:
    """Check everything that `read_splats` relies on, without decoding data that is always valid; returns the number of
    splats.

    Raises FormatError or InputError if the file is truncated or has an unknown layout.
    """
    tables = splat_tables(path)
    vertex = tables["vertex"]
    if WORDS[0] not in vertex:
        check_fields(_plain(path, vertex), report)
        return len(scalar(path, vertex, "x"))
    count = {len(_words(path, vertex, name)) for name in WORDS}.pop()
    _chunk_ranges(path, tables.get("chunk", {}), count, report)
    _harmonic_bytes(path, tables.get("sh"), count)
    return count


def splat_tables(path: Path) -> dict[str, Table]:
    """The elements of a file of splats."""
    header = read_header(path)
    if not describes_splats(header):
        raise FormatError(f"{path}: no Gaussians: its vertices have neither packed_position nor f_dc_0 and opacity")
    count = header.counts["vertex"]
    check_count(path, min(count, path.stat().st_size))
    tables = read_tables(path, header)
    if count == 0:
        raise InputError(f"{path}: no Gaussians in it")
    return tables


def check_count(path: Path, count: int) -> None:
    """Refuse more Gaussians than we can handle, before memory is allocated."""
    if count > MOST_SPLATS:
        raise InputError(f"{path}: {count} splats > {MOST_SPLATS}; decimate them first")


Fields = tuple[Float32Array, Float32Array, Float32Array, Float32Array, Float32Array, Float32Array]
"""Positions, log scales, rotations, logits, constant harmonics and higher harmonics, as in `Gaussians`."""


def _plain(path: Path, table: Table) -> Fields:
    """Fields of the schema of 3D Gaussian splatting: single numbers by name."""
    count = sum(name.startswith("f_rest_") for name in table)
    if count % 3 or count // 3 not in COEFFICIENTS.values():
        raise FormatError(f"{path}: {count} properties f_rest_*, expected 0, 9, 24 or 45")
    columns = {name: scalar(path, table, name) for name in ("x", "y", "z", *PLAIN)}
    rest = [scalar(path, table, f"f_rest_{i}") for i in range(count)]

    def stacked(*names: str) -> Float32Array:
        return np.stack([columns[n] for n in names], axis=1).astype(np.float32)

    n = len(columns["x"])
    return (
        stacked("x", "y", "z"), stacked("scale_0", "scale_1", "scale_2"), stacked("rot_0", "rot_1", "rot_2", "rot_3"),
        columns["opacity"].astype(np.float32), stacked("f_dc_0", "f_dc_1", "f_dc_2"),
        np.stack(rest, axis=1).astype(np.float32).reshape(n, 3, -1) if rest else np.zeros((n, 3, 0), np.float32),
    )  # fmt: skip


def _packed(path: Path, tables: dict[str, Table], report: Report) -> Fields:
    """Fields of PlayCanvas' compressed schema."""
    words = {name: _words(path, tables["vertex"], name) for name in WORDS}
    n = len(words[WORDS[0]])
    owner = np.arange(n) // CHUNK
    ranges = _chunk_ranges(path, tables.get("chunk", {}), n, report)
    chunk = {name: column[owner] for name, column in ranges.items()}
    position = _between(chunk, "{}_x {}_y {}_z", _vector(words["packed_position"]))
    log_scale = _between(chunk, "{}_scale_x {}_scale_y {}_scale_z", _vector(words["packed_scale"]))
    color = np.stack([_unit(words["packed_color"] >> shift, 8) for shift in (24, 16, 8)], axis=1)
    if "min_r" in chunk:
        color = _between(chunk, "{}_r {}_g {}_b", color)
    logit = logit_of(_unit(words["packed_color"], 8))
    return tuple(
        np.asarray(field, dtype=np.float32)
        for field in (
            position, log_scale, _rotation(words["packed_rotation"]), logit, (color - 0.5) / DC,
            _harmonics(path, tables.get("sh"), n),
        )
    )  # type: ignore[return-value]  # fmt: skip


def logit_of(alpha: NDArray[np.floating]) -> NDArray[np.floating]:
    """Logits of opacities 0..1, with those of 0 and 1 clipped, shape as given."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.clip(-np.log(1.0 / alpha - 1.0), -LARGEST_LOGIT, LARGEST_LOGIT))


def _words(path: Path, table: Table, name: str) -> U32:
    column = scalar(path, table, name)
    if column.dtype.kind != "u" or column.dtype.itemsize != 4:
        raise FormatError(f"{path}: {name} is of type {column.dtype}, expected uint")
    return column.astype(np.uint32)


def _chunk_ranges(path: Path, table: Table, count: int, report: Report) -> dict[str, NDArray[np.float64]]:
    """The ranges of the chunks by name, shape (ceil(n / CHUNK),) each; finite and in order."""
    groups = [("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")][: 3 if "min_r" in table else 2]
    of = [name for group in groups for name in group]
    columns = {f"{end}_{name}": scalar(path, table, f"{end}_{name}") for end in ("min", "max") for name in of}
    have, want = len(columns["min_x"]), -(-count // CHUNK)
    if have != want:
        raise FormatError(f"{path}: {have} chunks for {count} splats, expected {want}")
    ranges = {name: column.astype(np.float64) for name, column in columns.items()}
    for name, column in ranges.items():
        with np.errstate(over="ignore"):
            finite = np.isfinite(column.astype(np.float32))  # the values are read in single precision
        _tell(~finite, "{} of chunk {} is not finite", name, report)
    for name in of:
        low, high = ranges[f"min_{name}"], ranges[f"max_{name}"]
        _tell(low > high, "{} of chunk {} is above its max", f"min_{name}", report)
    for name in of[3:6]:
        largest = ranges[f"max_{name}"]
        odd = np.isfinite(largest) & (largest > LARGEST_LOG_SCALE)
        _tell(odd, "{} of chunk {} is above any size: splats of e^20 m", f"max_{name}", report, warning)
    return ranges


def _tell(
    bad: NDArray[np.bool_], what: str, name: str, report: Report, problem: Callable[[str], Problem] = error
) -> None:
    """Report the first of the bad rows, and the number of others."""
    if bad.any():
        more = int(bad.sum()) - 1
        report(problem(what.format(name, int(np.argmax(bad))) + (f" ({more} more like it)" if more else "")))


def _unit(word: NDArray[np.integer], bits: int) -> NDArray[np.float64]:
    """The lowest bits of a word as a number from 0 to 1."""
    most = (1 << bits) - 1
    return (word & np.uint32(most)).astype(np.float64) / most


def _vector(word: U32) -> NDArray[np.float64]:
    """Three numbers from 0 to 1 in 11, 10 and 11 bits, shape (n, 3)."""
    return np.stack([_unit(word >> 21, 11), _unit(word >> 11, 10), _unit(word, 11)], axis=1)


def _between(chunk: dict[str, NDArray[np.float64]], names: str, share: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at a share of the way through the chunk's range, shape (n, 3)."""
    low, high = (np.stack([chunk[n.format(end)] for n in names.split()], axis=1) for end in ("min", "max"))
    return low * (1.0 - share) + high * share


def _rotation(word: U32) -> NDArray[np.float64]:
    """Quaternions (w, x, y, z) whose largest component, positive, is omitted, shape (n, 4)."""
    three = np.stack([(_unit(word >> shift, 10) - 0.5) * np.sqrt(2.0) for shift in (20, 10, 0)], axis=1)
    largest = np.sqrt(np.maximum(0.0, 1.0 - (three**2).sum(axis=1)))
    which = (word >> 30).astype(np.int64)
    out = np.empty((len(word), 4))
    rows = np.arange(len(word))
    out[rows, which] = largest
    for i in range(3):  # the others keep their order around it
        out[rows, i + (which <= i)] = three[:, i]
    return out


def _harmonic_bytes(path: Path, table: Table | None, count: int) -> list[NDArray[np.generic]]:
    """The columns of element sh: 0, 9, 24 or 45 of `count` bytes."""
    if table is None:
        return []
    total = len(table)
    if total % 3 or total // 3 not in COEFFICIENTS.values():
        raise FormatError(f"{path}: {total} properties in element sh, expected 9, 24 or 45")
    columns = [scalar(path, table, f"f_rest_{i}") for i in range(total)]
    if total and len(columns[0]) != count:
        raise FormatError(f"{path}: element sh has {len(columns[0])} rows, expected one for each of {count} splats")
    if any(column.dtype != np.uint8 for column in columns):
        raise FormatError(f"{path}: a property of element sh is not of type uchar")
    return columns


def _harmonics(path: Path, table: Table | None, count: int) -> Float32Array:
    """Higher harmonics from bytes, channel by channel, shape (n, 3, k)."""
    columns = _harmonic_bytes(path, table, count)
    byte = np.stack(columns, axis=1) if columns else np.zeros((count, 0), np.uint8)
    share = np.where(byte == 0, 0.0, np.where(byte == 255, 1.0, (byte + 0.5) / 256.0))
    return ((share - 0.5) * HARMONIC_RANGE).astype(np.float32).reshape(count, 3, -1)


def _bounded(logit: Float32Array) -> Float32Array:
    """Opacities clipped to LARGEST_LOGIT, including infinite ones."""
    return np.clip(logit, -LARGEST_LOGIT, LARGEST_LOGIT)


def check_fields(fields: Fields, report: Report) -> None:
    """Report numbers that are not finite, sizes out of bounds and rotations of zero length."""
    position, log_scale, rotation, logit, dc, rest = fields
    for name, field in (
        ("position", position), ("scale", log_scale), ("rotation", rotation), ("opacity", _bounded(logit)),
        ("colour", dc), ("harmonic", rest),
    ):  # fmt: skip
        finite = np.isfinite(field).reshape(len(field), -1).all(axis=1)
        _tell(~np.asarray(finite), "the {} of splat {} is not finite", name, report)
    large = (np.isfinite(log_scale) & (log_scale > LARGEST_LOG_SCALE)).any(axis=1)
    _tell(np.asarray(large), "the {} of splat {} is above any size: e^20 m", "scale", report, warning)
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(rotation, axis=1)
    _tell(length < 1e-6, "the {} of splat {} has no length", "rotation", report)


def discs(path: Path, splats: Gaussians) -> RawMesh:
    """A square across each opaque Gaussian, in the file's units: used to find units and axes, as for a mesh."""
    opaque = np.flatnonzero(splats.opacity > 0.5)
    if not len(opaque):
        raise InputError(f"{path}: no Gaussian has more than half of the opacity: there is no surface")
    some = splats.subset(opaque[:: -(-len(opaque) // MOST_DISCS)])
    wide = np.argsort(some.log_scale, axis=1)[:, :0:-1]  # the two larger axes
    rows = np.arange(len(some))
    u, v = (some.axes[rows, :, wide[:, k]] * some.scale[rows, wide[:, k]][:, None] for k in range(2))
    corners = np.stack([some.position - u - v, some.position + u - v, some.position + u + v, some.position - u + v], 1)
    halves = np.array([[0, 1, 2], [0, 2, 3]])
    faces = (4 * rows[:, None, None] + halves).reshape(-1, 3)
    return RawMesh(
        path=path, vertices=corners.reshape(-1, 3).astype(np.float64), faces=faces, colors=None, paint=None,
        face_node=np.full(len(faces), -1, dtype=np.int32), node_names=(), up="", unit_metres=0.0, notes=(),
        of_splats=True,
    )  # fmt: skip
