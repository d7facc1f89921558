"""Gaussian splats from PLY files: the plain schema of 3D Gaussian splatting and PlayCanvas' compressed one.

Plain: x y z, f_dc_0..2, opacity, scale_0..2, rot_0..3 and 0, 9, 24 or 45 f_rest, in any order; normals are ignored.
Compressed (InteriorGS): chunks of 256 splats with the ranges of their positions, scales and colours, four 32-bit words
per splat, one byte per harmonic; the layout is in docs/formats.md.

Guaranteed: the counts that the header promises are checked against the file's length before anything is allocated.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scene.errors import FormatError, InputError
from scene.gaussians import COEFFICIENTS, DC, Gaussians
from scene.readers.ply_table import Header, Table, read_header, read_tables, scalar
from scene.readers.raw import RawMesh, read_bytes

F32 = NDArray[np.float32]
U32 = NDArray[np.uint32]

CHUNK = 256
"""Splats per chunk."""

MOST_SPLATS = 8_000_000
"""Splats that a file may hold [-]: at 59 numbers each they take 1.9 GB."""

WORDS = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
PLAIN = (
    "opacity",
    *(f"f_dc_{i}" for i in range(3)),
    *(f"scale_{i}" for i in range(3)),
    *(f"rot_{i}" for i in range(4)),
)

LARGEST_LOGIT = 16.0
"""Opacities of exactly 0 and 1 have no finite logit [-]; 1e-7 from them is as good."""

MOST_DISCS = 100_000
"""Squares that stand for the Gaussians of a file where its units and axes are found [-]."""

HARMONIC_RANGE = 8.0
"""Harmonics span -4 to 4 in a compressed file [-]."""


def describes_splats(header: Header) -> bool:
    """Whether a PLY header describes Gaussians rather than a mesh."""
    vertex = header.element("vertex")
    names = {p.name for p in vertex.properties} if vertex is not None else set()
    return WORDS[0] in names or {"f_dc_0", "opacity"} <= names


def read_splats(path: Path) -> Gaussians:
    """Read either schema, in the file's own units and axes."""
    data = read_bytes(path)
    header = read_header(path, data)
    vertex = header.element("vertex")
    if vertex is None or not describes_splats(header):
        raise FormatError(f"{path}: no Gaussians: its vertices have neither packed_position nor f_dc_0 and opacity")
    if min(vertex.count, len(data)) > MOST_SPLATS:
        raise InputError(f"{path}: {vertex.count} splats > {MOST_SPLATS}; decimate them first")
    tables = read_tables(path, header, data)
    if vertex.count == 0:
        raise InputError(f"{path}: no Gaussians in it")
    splats = _packed(path, tables) if WORDS[0] in tables["vertex"] else _plain(path, tables["vertex"])
    return _checked(path, *splats)


Fields = tuple[F32, F32, F32, F32, F32, F32]
"""Positions, log scales, rotations, logits, constant harmonics and the others, as of `Gaussians`."""


def _plain(path: Path, table: Table) -> Fields:
    """The schema of 3D Gaussian splatting: single numbers by name."""
    count = sum(name.startswith("f_rest_") for name in table)
    if count % 3 or count // 3 not in COEFFICIENTS.values():
        raise FormatError(f"{path}: {count} properties f_rest_*, expected 0, 9, 24 or 45")
    columns = {name: scalar(path, table, name) for name in ("x", "y", "z", *PLAIN)}
    rest = [scalar(path, table, f"f_rest_{i}") for i in range(count)]

    def stacked(*names: str) -> F32:
        return np.stack([columns[n] for n in names], axis=1).astype(np.float32)

    n = len(columns["x"])
    return (
        stacked("x", "y", "z"), stacked("scale_0", "scale_1", "scale_2"), stacked("rot_0", "rot_1", "rot_2", "rot_3"),
        columns["opacity"].astype(np.float32), stacked("f_dc_0", "f_dc_1", "f_dc_2"),
        np.stack(rest, axis=1).astype(np.float32).reshape(n, 3, -1) if rest else np.zeros((n, 3, 0), np.float32),
    )  # fmt: skip


def _packed(path: Path, tables: dict[str, Table]) -> Fields:
    """PlayCanvas' compressed schema."""
    words = {name: _words(path, tables["vertex"], name) for name in WORDS}
    n = len(words[WORDS[0]])
    chunk = _chunks(path, tables.get("chunk", {}), n)
    position = _between(chunk, "{}_x {}_y {}_z", _vector(words["packed_position"]))
    log_scale = _between(chunk, "{}_scale_x {}_scale_y {}_scale_z", _vector(words["packed_scale"]))
    color = np.stack([_unit(words["packed_color"] >> shift, 8) for shift in (24, 16, 8)], axis=1)
    if "min_r" in chunk:
        color = _between(chunk, "{}_r {}_g {}_b", color)
    alpha = _unit(words["packed_color"], 8)
    with np.errstate(divide="ignore"):
        logit = np.clip(-np.log(1.0 / alpha - 1.0), -LARGEST_LOGIT, LARGEST_LOGIT)
    return tuple(
        np.asarray(field, dtype=np.float32)
        for field in (
            position, log_scale, _rotation(words["packed_rotation"]), logit, (color - 0.5) / DC,
            _harmonics(path, tables.get("sh"), n),
        )
    )  # type: ignore[return-value]  # fmt: skip


def _words(path: Path, table: Table, name: str) -> U32:
    column = scalar(path, table, name)
    if column.dtype.kind != "u" or column.dtype.itemsize != 4:
        raise FormatError(f"{path}: {name} is of type {column.dtype}, expected uint")
    return column.astype(np.uint32)


def _chunks(path: Path, table: Table, count: int) -> dict[str, NDArray[np.float64]]:
    """The ranges of each splat's chunk by name, shape (n,) each."""
    names = [f"{end}_{of}" for end in ("min", "max") for of in ("x", "y", "z", "scale_x", "scale_y", "scale_z")]
    if "min_r" in table:
        names += [f"{end}_{of}" for end in ("min", "max") for of in "rgb"]
    columns = {name: scalar(path, table, name).astype(np.float64) for name in names}
    have, want = len(columns["min_x"]), -(-count // CHUNK)
    if have != want:
        raise FormatError(f"{path}: {have} chunks for {count} splats, expected {want}")
    owner = np.arange(count) // CHUNK
    return {name: column[owner] for name, column in columns.items()}


def _unit(word: NDArray[np.integer], bits: int) -> NDArray[np.float64]:
    """The lowest bits as a number from 0 to 1."""
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
    """Quaternions (w, x, y, z) of which the largest component, positive, is left out, shape (n, 4)."""
    three = np.stack([(_unit(word >> shift, 10) - 0.5) * np.sqrt(2.0) for shift in (20, 10, 0)], axis=1)
    largest = np.sqrt(np.maximum(0.0, 1.0 - (three**2).sum(axis=1)))
    which = (word >> 30).astype(np.int64)
    out = np.empty((len(word), 4))
    rows = np.arange(len(word))
    out[rows, which] = largest
    for i in range(3):  # the others keep their order around it
        out[rows, i + (which <= i)] = three[:, i]
    return out


def _harmonics(path: Path, table: Table | None, count: int) -> F32:
    """Higher harmonics from bytes, channel by channel, shape (n, 3, k)."""
    if table is None:
        return np.zeros((count, 3, 0), dtype=np.float32)
    total = len(table)
    if total % 3 or total // 3 not in COEFFICIENTS.values():
        raise FormatError(f"{path}: {total} properties in element sh, expected 9, 24 or 45")
    columns = [scalar(path, table, f"f_rest_{i}") for i in range(total)]
    if total and len(columns[0]) != count:
        raise FormatError(f"{path}: {len(columns[0])} of element sh for {count} splats")
    byte = np.stack(columns, axis=1) if columns else np.zeros((count, 0), np.uint8)
    share = np.where(byte == 0, 0.0, np.where(byte == 255, 1.0, (byte + 0.5) / 256.0))
    return ((share - 0.5) * HARMONIC_RANGE).astype(np.float32).reshape(count, 3, -1)


def _checked(path: Path, position: F32, log_scale: F32, rotation: F32, logit: F32, dc: F32, rest: F32) -> Gaussians:
    """Refuse numbers that are not finite and rotations of no length; opacities beyond all bounds are cut."""
    logit = np.clip(logit, -LARGEST_LOGIT, LARGEST_LOGIT)
    for name, field in (
        ("position", position), ("scale", log_scale), ("rotation", rotation), ("opacity", logit), ("colour", dc),
        ("harmonic", rest),
    ):  # fmt: skip
        bad = ~np.isfinite(field).reshape(len(field), -1).all(axis=1)
        if bad.any():
            raise FormatError(f"{path}: the {name} of splat {int(np.argmax(bad))} is not finite")
    length = np.linalg.norm(rotation, axis=1)
    if (length < 1e-6).any():
        raise FormatError(f"{path}: the rotation of splat {int(np.argmax(length < 1e-6))} has no length")
    return Gaussians(position, log_scale, rotation, logit, dc, rest)


def discs(path: Path, splats: Gaussians) -> RawMesh:
    """A square across each opaque Gaussian, in the file's units: what finds units and axes, as of a mesh."""
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
    )  # fmt: skip
