"""Gaussian splats as SOG (PlayCanvas): meta.json and pictures, in a folder or zipped, versions 1 and 2.

Gaussian i is pixel i of every picture, row by row. Centres: 16 bits per axis in two pictures, between the minima and
maxima of sign(x) ln(1 + |x|). Rotations: the smaller three of (w, x, y, z) and, as alpha, 252 plus the index of the
omitted one. Sizes (logarithms), colours (constant harmonics) and harmonics: version 2 looks bytes up in codebooks of
256 numbers, version 1 goes from minima to maxima; the opacity is the colours' alpha, in version 1 its logit. Higher
harmonics come from a palette of 64 entries per row that a picture of 16-bit labels points into. Axes are right, up,
back according to its documents; the up axis of a scan is found from the content, as in other splats.
"""

import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, ByteArray
from dcap.scene.errors import FormatError, short
from dcap.scene.readers.files import find_file, parse_json, read_bytes, read_rgba
from dcap.scene.readers.splats.splats import MOST_SPLATS, Fields, check_count, gaussians_of, logit_of, quaternions_of
from dcap.scene.types.gaussians import COEFFICIENTS, Gaussians

META = "meta.json"
LARGEST_MEMBER = 512 << 20
"""Largest member of a zip [bytes]: a picture of 8 million splats in 4 channels is 32 MB unpacked."""
TAG = 252
"""Alpha of a rotation whose first component is omitted."""
PALETTE_ROW = 64
"""Entries of the palette per row."""
BROKEN_ZIP = (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError)
"""Errors raised when a file that is not a zip is read as one."""


@dataclass(frozen=True, slots=True)
class SogFiles:
    """Access to the parts of a file."""

    path: Path
    """Path for messages."""
    read: Callable[[str], bytes]


def is_sog_meta(path: Path) -> bool:
    """Return whether a JSON file describes Gaussians."""
    if path.name != META or not path.is_file() or path.stat().st_size > LARGEST_MEMBER:
        return False
    head = path.read_bytes()
    return b'"means"' in head and b'"quats"' in head and b'"scales"' in head


def picture_names(path: Path, text: bytes) -> list[str]:
    """The pictures named by a meta.json."""
    meta = parse_json(path, text, META)
    sections = meta.values() if isinstance(meta, dict) else ()
    lists = (one.get("files") for one in sections if isinstance(one, dict))
    return [name for names in lists if isinstance(names, list) for name in names if isinstance(name, str)]


def read_sog(path: Path) -> Gaussians:
    """Read a zipped file, or the meta.json of a folder, in the file's own units and axes."""
    if path.name == META:
        return _gaussians(SogFiles(path, lambda name: _beside(path, name)))
    read_bytes(path, 1)  # missing and empty files are reported as everywhere
    try:
        with zipfile.ZipFile(path) as archive:
            return _gaussians(SogFiles(path, lambda name: _member(path, archive, name)))
    except BROKEN_ZIP as broken:
        raise FormatError(f"{path}: cannot be read as a zip file: {broken}") from None


def _beside(path: Path, name: str) -> bytes:
    found = find_file(path.parent, name)
    if found is None:
        raise FormatError(f"{path}: {name} is missing next to it")
    return read_bytes(path.parent / found)


def _member(path: Path, archive: zipfile.ZipFile, name: str) -> bytes:
    names = [one for one in archive.namelist() if one == name or one.endswith(f"/{name}")]
    if not names:
        raise FormatError(f"{path}: {name} is missing in it")
    info = archive.getinfo(min(names, key=len))
    if info.file_size > LARGEST_MEMBER:
        raise FormatError(f"{path}: {name} takes {info.file_size} bytes > {LARGEST_MEMBER}")
    return archive.read(info)


def _gaussians(files: SogFiles) -> Gaussians:
    meta = parse_json(files.path, files.read(META), META)
    if not isinstance(meta, dict):
        raise FormatError(f"{files.path}: {META} is not an object, but {short(meta)}")
    version, count = meta.get("version", 1), _count(files.path, meta)
    if version not in (1, 2):
        raise FormatError(f"{files.path}: SOG of version {short(version)}, expected 1 or 2")
    check_count(files.path, count)
    low, high = (_pixels(files, meta, "means", k, count)[:, :3].astype(np.int64) for k in (0, 1))
    ends = _numbers(files.path, meta, "means", "mins", 3), _numbers(files.path, meta, "means", "maxs", 3)
    squeezed = ends[0] + np.where(ends[1] > ends[0], ends[1] - ends[0], 1.0) * (low | high << 8) / 65535.0
    with np.errstate(over="ignore"):
        position = np.sign(squeezed) * np.expm1(np.abs(squeezed))
        position = position.astype(np.float32)
    sh0 = _pixels(files, meta, "sh0", 0, count)
    looked_up = _values(files.path, meta, "sh0", sh0, version)
    logit = logit_of(sh0[:, 3] / 255.0) if version == 2 else looked_up[:, 3]
    scale = _values(files.path, meta, "scales", _pixels(files, meta, "scales", 0, count)[:, :3], version)
    fields: Fields = (
        position,
        scale.astype(np.float32),
        _rotation(_pixels(files, meta, "quats", 0, count)).astype(np.float32),
        logit.astype(np.float32),
        looked_up[:, :3].astype(np.float32),
        _harmonics(files, meta, count, version),
    )
    return gaussians_of(files.path, fields)


def _count(path: Path, meta: Mapping[str, object]) -> int:
    """Number of Gaussians; version 1 states it as the shape of the centres."""
    shape = _section(path, meta, "means").get("shape")
    value = meta.get("count", shape[0] if isinstance(shape, list) and shape else None)
    if isinstance(value, bool) or not isinstance(value, int) or value < 1:
        raise FormatError(f"{path}: count is {short(value)}, expected a whole number of Gaussians")
    return value


def _section(path: Path, meta: Mapping[str, object], name: str) -> Mapping[str, object]:
    section = meta.get(name)
    if not isinstance(section, dict):
        raise FormatError(f"{path}: {name} of {META} is {short(section)}, expected an object")
    return section


def _numbers(path: Path, meta: Mapping[str, object], name: str, key: str, count: int) -> Array:
    """`count` finite numbers of a section, shape (count,)."""
    values = _section(path, meta, name).get(key)
    row = values if isinstance(values, list) else [values] * (count if count == 1 else 0)
    sound = all(isinstance(one, int | float) and not isinstance(one, bool) for one in row)
    array = np.array(row if sound else [], dtype=np.float64)
    if len(array) != count or not np.isfinite(array).all():
        raise FormatError(f"{path}: {key} of {name} is {short(values)}, expected {count} finite numbers")
    return array


def _file(path: Path, meta: Mapping[str, object], name: str, index: int) -> str:
    names = _section(path, meta, name).get("files")
    if not isinstance(names, list) or len(names) <= index or not isinstance(names[index], str):
        raise FormatError(f"{path}: files of {name} are {short(names)}, expected names of pictures")
    return str(names[index])


def _pixels(files: SogFiles, meta: Mapping[str, object], name: str, index: int, count: int) -> ByteArray:
    """The first `count` pixels of a picture, red, green, blue and alpha, shape (count, 4)."""
    file = _file(files.path, meta, name, index)
    pixels = read_rgba(files.read(file), f"{files.path}: {file}", 4 * MOST_SPLATS).reshape(-1, 4)
    if len(pixels) < count:
        raise FormatError(f"{files.path}: {file} has {len(pixels)} pixels for {count} Gaussians")
    return pixels[:count]


def _values(path: Path, meta: Mapping[str, object], name: str, pixels: ByteArray, version: int) -> Array:
    """Values encoded by the bytes (n, k) of a picture, shape (n, k)."""
    if version == 2:
        return np.asarray(_numbers(path, meta, name, "codebook", 256)[pixels])
    low, high = (_numbers(path, meta, name, key, pixels.shape[1]) for key in ("mins", "maxs"))
    return np.asarray(low + (high - low) * (pixels / 255.0))


def _rotation(pixels: ByteArray) -> Array:
    """Quaternions (w, x, y, z), shape (n, 4); the identity for an invalid tag."""
    three = (pixels[:, :3] / 255.0 * 2.0 - 1.0) / np.sqrt(2.0)
    which = pixels[:, 3].astype(np.int64) - TAG
    known = which >= 0
    out = np.tile([1.0, 0.0, 0.0, 0.0], (len(pixels), 1))
    out[known] = quaternions_of(three[known], which[known])
    return out


def _harmonics(files: SogFiles, meta: Mapping[str, object], count: int, version: int) -> NDArray[np.float32]:
    """Higher harmonics, channel by channel, shape (n, 3, k)."""
    if meta.get("shN") is None:
        return np.zeros((count, 3, 0), np.float32)
    path, file = files.path, _file(files.path, meta, "shN", 0)
    palette = read_rgba(files.read(file), f"{path}: {file}", 4 * MOST_SPLATS)
    height, width = palette.shape[:2]
    coefficients = width // PALETTE_ROW
    if width % PALETTE_ROW or coefficients not in COEFFICIENTS.values():
        raise FormatError(f"{path}: {file} is {width} pixels wide, expected 64 times 3, 8 or 15")
    entries = palette[:, :, :3].reshape(height * PALETTE_ROW, coefficients, 3)
    label = _pixels(files, meta, "shN", 1, count).astype(np.int64)
    number = label[:, 0] | label[:, 1] << 8
    if int(number.max()) >= len(entries):
        raise FormatError(f"{path}: a label of shN is {number.max()}, its palette has {len(entries)} entries")
    if version == 2:
        book = _numbers(path, meta, "shN", "codebook", 256)
    else:
        book = np.linspace(_numbers(path, meta, "shN", "mins", 1)[0], _numbers(path, meta, "shN", "maxs", 1)[0], 256)
    return np.ascontiguousarray(book.astype(np.float32)[entries[number]].transpose(0, 2, 1))
