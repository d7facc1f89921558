"""All formats of Gaussian splats and their recognition; the readers of `.splat` and SPZ.

Gaussian splats as bare records of 32 bytes (`.splat`): no header, no harmonics beyond the colour.

A record is three floats of the centre, three of the standard deviations, four bytes of colour and opacity (sRGB, alpha)
and four of the quaternion (w, x, y, z), each as 128 + 128 q. Units and axes are not stated.

Gaussian splats as SPZ (Niantic), versions 2 and 3: one gzip stream of a header of 16 bytes and six arrays.

Header: magic NGSP, version, number of points (32 bits each), degree of the harmonics, fractional bits, flags, reserved
(8 bits each). Arrays, one after the other: centres (3 x 24 bits, fixed point), opacities (8 bits), colours (3 x 8), log
sizes (3 x 8), rotations (version 2: x, y, z in 3 x 8; version 3: the smaller three of x, y, z, w in 10 bits each, with
2 bits for the index of the omitted one), harmonics (8 bits, coefficient by coefficient with the channels side by side).
Axes are right, up, back according to its documents; the up axis of a scan is found from the content, as in other
splats.

Guaranteed: no more is decompressed than the header's counts state, and those are bounded.
"""

import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import ByteArray
from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import read_bytes
from dcap.scene.readers.mesh.ply import describes_splats, read_header
from dcap.scene.readers.splats.sog import META, is_sog_meta, read_sog
from dcap.scene.readers.splats.splats import Fields, check_count, gaussians_of, logit_of, read_splats
from dcap.scene.types.gaussians import COEFFICIENTS, DC, Gaussians

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)])
"""One Gaussian, 32 bytes."""

THINNEST = np.float32(1e-9)
"""Size of a Gaussian that is flat by rounding, since zero has no logarithm [file units]."""

MAGIC = b"NGSP"
GZIP = b"\x1f\x8b"
HEADER = 16
"""Length of the header [bytes]."""
COLOR_RANGE = 0.15
"""Colours are bytes of 0.5 + 0.15 times the constant harmonic [-]."""
ROTATION_BYTES = {2: 3, 3: 4}
"""Length of one rotation [bytes], by version."""


def read_splat_records(path: Path) -> Gaussians:
    """Read a file of records, in its own units and axes."""
    size = path.stat().st_size if path.is_file() else 0
    if size % RECORD.itemsize:
        raise FormatError(f"{path}: {size} bytes are not a whole number of records of {RECORD.itemsize} bytes")
    check_count(path, size // RECORD.itemsize)
    rows = np.frombuffer(read_bytes(path), RECORD)
    with np.errstate(invalid="ignore"):  # a size below zero is detected by its logarithm
        log_scale = np.log(np.where(rows["scale"] == 0.0, THINNEST, rows["scale"]))
    color = rows["color"].astype(np.float32) / 255.0
    fields: Fields = (
        rows["position"].copy(),
        log_scale,
        (rows["rotation"].astype(np.float32) - 128.0) / 128.0,
        logit_of(color[:, 3]).astype(np.float32),
        (color[:, :3] - 0.5) / np.float32(DC),
        np.zeros((len(rows), 3, 0), np.float32),
    )
    return gaussians_of(path, fields)


def read_spz(path: Path) -> Gaussians:
    """Read a file of version 2 or 3, in its own units and axes."""
    data = read_bytes(path)
    if data[:4] == MAGIC:
        raise FormatError(f"{path}: SPZ of version 4 or later, packed by Zstandard; save it as version 3 or as PLY")
    if data[:2] != GZIP:
        raise FormatError(f"{path}: not an SPZ file: it begins with neither a gzip stream nor {MAGIC.decode()}")
    stream = zlib.decompressobj(wbits=31)
    head = _unpacked(path, stream, data, HEADER)
    version, count = (int.from_bytes(head[at : at + 4], "little") for at in (4, 8))
    degree, fraction = head[12], head[13]
    if head[:4] != MAGIC or version not in ROTATION_BYTES:
        raise FormatError(f"{path}: magic {head[:4]!r}, version {version}; expected {MAGIC!r}, version 2 or 3")
    if degree not in COEFFICIENTS or fraction > 24:
        raise FormatError(
            f"{path}: harmonics of degree {degree} and {fraction} fractional bits, expected 0 to 3 and 24"
        )
    check_count(path, count)
    if count == 0:
        raise FormatError(f"{path}: no Gaussians in it")
    widths = (9, 1, 3, 3, ROTATION_BYTES[version], 3 * COEFFICIENTS[degree])
    body = np.frombuffer(_unpacked(path, stream, stream.unconsumed_tail, count * sum(widths)), np.uint8)
    ends = np.cumsum([count * width for width in widths])
    columns = [part.reshape(count, -1) for part in np.split(body, ends[:-1])]
    return gaussians_of(path, _fields(columns, fraction, version))


def _unpacked(path: Path, stream: "zlib._Decompress", data: bytes, size: int) -> bytes:
    """The next `size` bytes of the stream; raises if they are incomplete."""
    try:
        found = stream.decompress(data, size)
    except zlib.error as broken:
        raise FormatError(f"{path}: broken gzip stream: {broken}") from None
    if len(found) < size:
        raise FormatError(f"{path}: the stream ends after {len(found)} bytes where its header promises {size}")
    return found


def _fields(columns: list[ByteArray], fraction: int, version: int) -> Fields:
    position, alpha, color, size, rotation, rest = columns
    count = len(position)
    words = position.reshape(count, 3, 3).astype(np.int32)
    fixed = words[:, :, 0] | words[:, :, 1] << 8 | words[:, :, 2] << 16
    fixed -= (fixed & 0x800000) << 1  # the sign of 24 bits
    return (
        (fixed / float(1 << fraction)).astype(np.float32),
        (size / 16.0 - 10.0).astype(np.float32),
        (_first_three(rotation) if version == 2 else _smallest_three(rotation)).astype(np.float32),
        logit_of(alpha[:, 0] / 255.0).astype(np.float32),
        ((color / 255.0 - 0.5) / COLOR_RANGE).astype(np.float32),
        ((rest.astype(np.float32) - 128.0) / 128.0).reshape(count, -1, 3).transpose(0, 2, 1).copy(),
    )


def _first_three(packed: ByteArray) -> NDArray[np.float64]:
    """Quaternions (w, x, y, z) whose w, not negative, is omitted, shape (n, 4)."""
    xyz = packed / 127.5 - 1.0
    w = np.sqrt(np.maximum(0.0, 1.0 - (xyz**2).sum(axis=1)))
    return np.concatenate([w[:, None], xyz], axis=1)


def _smallest_three(packed: ByteArray) -> NDArray[np.float64]:
    """Quaternions (w, x, y, z) whose largest component, positive, is omitted, shape (n, 4).

    From the lowest bits upwards the others follow in the order w, z, y, x: nine bits of size, up to sqrt(1/2), and a
    sign.
    """
    word = packed.copy().view("<u4")[:, 0].astype(np.uint32)
    largest = (word >> 30).astype(np.int64)  # of x, y, z, w
    xyzw = np.zeros((len(word), 4))
    for axis in (3, 2, 1, 0):
        kept = largest != axis
        size = np.sqrt(0.5) * (word & 0x1FF) / 0x1FF
        xyzw[kept, axis] = np.where((word >> 9) & 1, -size, size)[kept]
        word = np.where(kept, word >> 10, word).astype(np.uint32)
    xyzw[np.arange(len(word)), largest] = np.sqrt(np.maximum(0.0, 1.0 - (xyzw**2).sum(axis=1)))
    return xyzw[:, [3, 0, 1, 2]]


SPLAT_READERS: dict[str, Callable[[Path], Gaussians]] = {
    ".splat": read_splat_records,
    ".spz": read_spz,
    ".sog": read_sog,
}
"""Reader by the suffix of files that only hold splats."""
SPLAT_SUFFIXES = tuple(SPLAT_READERS)


def is_splats(path: Path) -> bool:
    """Return whether a file holds Gaussian splats: by its suffix, for a PLY by its header, for meta.json by its
    content."""
    if not path.is_file():
        return False
    if path.suffix.lower() in SPLAT_READERS or path.name == META:
        return path.name != META or is_sog_meta(path)
    if path.suffix.lower() != ".ply":
        return False
    try:
        return describes_splats(read_header(path))
    except InputError:
        return False  # the problem is reported when the file is read


def read_gaussians(path: Path) -> Gaussians:
    """Read any of these formats, in the file's own units and axes."""
    return (read_sog if path.name == META else SPLAT_READERS.get(path.suffix.lower(), read_splats))(path)
