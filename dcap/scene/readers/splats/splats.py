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

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array
from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.mesh.ply import Table, describes_splats, read_header, read_tables, scalar
from dcap.scene.readers.mesh.raw import RawMesh, squares
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


MOST_DISCS = 100_000
"""Number of squares that represent the Gaussians of a file in finding its units and axes [-]."""

HARMONIC_RANGE = 8.0
"""Harmonics span -4 to 4 in a compressed file [-]."""


def read_splats(path: Path) -> Gaussians:
    """Read either schema, in the file's own units and axes."""
    header = read_header(path)
    if not describes_splats(header):
        raise FormatError(f"{path}: no Gaussians: its vertices have neither packed_position nor f_dc_0 and opacity")
    count = header.counts["vertex"]
    check_count(path, min(count, path.stat().st_size))
    tables = read_tables(path, header)
    if count == 0:
        raise InputError(f"{path}: no Gaussians in it")
    return gaussians_of(path, (_packed if WORDS[0] in tables["vertex"] else _plain)(path, tables))


def gaussians_of(path: Path, fields: "Fields") -> Gaussians:
    """Checked Gaussians from the fields of a file; infinite opacities are clipped."""
    position, log_scale, rotation, logit, dc, rest = fields
    logit = np.clip(logit, -LARGEST_LOGIT, LARGEST_LOGIT)
    for name, field in (
        ("position", position), ("scale", log_scale), ("rotation", rotation), ("opacity", logit), ("colour", dc),
        ("harmonic", rest),
    ):  # fmt: skip
        finite = np.isfinite(field).reshape(len(field), -1).all(axis=1)
        _refuse(path, ~np.asarray(finite), f"the {name} of splat {{}} is not finite")
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(rotation, axis=1)
    _refuse(path, length < 1e-6, "the rotation of splat {} has no length")
    return Gaussians(position, log_scale, rotation, logit, dc, rest)


def check_count(path: Path, count: int) -> None:
    """Refuse more Gaussians than we can handle, before memory is allocated."""
    if count > MOST_SPLATS:
        raise InputError(f"{path}: {count} splats > {MOST_SPLATS}; decimate them first")


Fields = tuple[Float32Array, Float32Array, Float32Array, Float32Array, Float32Array, Float32Array]
"""Positions, log scales, rotations, logits, constant harmonics and higher harmonics, as in `Gaussians`."""


def _plain(path: Path, tables: dict[str, Table]) -> Fields:
    """Fields of the schema of 3D Gaussian splatting: single numbers by name."""
    table = tables["vertex"]
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


def _packed(path: Path, tables: dict[str, Table]) -> Fields:
    """Fields of PlayCanvas' compressed schema."""
    words = {name: _words(path, tables["vertex"], name) for name in WORDS}
    n = len(words[WORDS[0]])
    owner = np.arange(n) // CHUNK
    ranges = _chunk_ranges(path, tables.get("chunk", {}), n)
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


def _chunk_ranges(path: Path, table: Table, count: int) -> dict[str, NDArray[np.float64]]:
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
        _refuse(path, ~finite, f"{name} of chunk {{}} is not finite")
    for name in of:
        _refuse(path, ranges[f"min_{name}"] > ranges[f"max_{name}"], f"min_{name} of chunk {{}} is above its max")
    return ranges


def _refuse(path: Path, bad: NDArray[np.bool_], what: str) -> None:
    """Refuse a file with bad rows, naming the first of them and the number of others."""
    if bad.any():
        more = int(bad.sum()) - 1
        raise FormatError(f"{path}: {what.format(int(np.argmax(bad)))}{f' ({more} more like it)' if more else ''}")


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
    return quaternions_of(three, (word >> 30).astype(np.int64))


def quaternions_of(three: NDArray[np.float64], which: NDArray[np.int64]) -> NDArray[np.float64]:
    """Unit quaternions (n, 4) from three components (n, 3), in order around the omitted one, which is positive."""
    out = np.empty((len(three), 4))
    rows = np.arange(len(three))
    out[rows, which] = np.sqrt(np.maximum(0.0, 1.0 - (three**2).sum(axis=1)))
    for i in range(3):
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


def discs(path: Path, splats: Gaussians) -> RawMesh:
    """A square across each opaque Gaussian, in the file's units: used to find units and axes, as for a mesh."""
    opaque = np.flatnonzero(splats.opacity > 0.5)
    if not len(opaque):
        raise InputError(f"{path}: no Gaussian has more than half of the opacity: there is no surface")
    some = splats.subset(opaque[:: -(-len(opaque) // MOST_DISCS)])
    wide = np.argsort(some.log_scale, axis=1)[:, :0:-1]  # the two larger axes
    rows = np.arange(len(some))
    u, v = (some.axes[rows, :, wide[:, k]] * some.scale[rows, wide[:, k]][:, None] for k in range(2))
    return squares(path, some.position, u, v, of_splats=True)
