"""COLMAP models: cameras, images and points3D as .bin or .txt, the model of a `sparse/0` folder.

Cameras are PINHOLE or SIMPLE_PINHOLE, others are refused: their pictures must be undistorted first. Observations and
tracks are stepped over.

Guaranteed: counts are checked against the file's length before anything is allocated.
"""

import struct
from array import array
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.readers.files import read_bytes
from dcap.scene.types.pictures import ColmapModel, Pinhole, PosedImage

MODELS = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE", "FULL_OPENCV", "FOV",
          "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "THIN_PRISM_FISHEYE")  # fmt: skip
"""Camera models by COLMAP's number."""
PARAMETERS = {"SIMPLE_PINHOLE": 3, "PINHOLE": 4}
"""Numbers that describe those that we read."""
LONGEST_NAME = 4096
"""Name of a picture [bytes]."""
LEAST = {"cameras": 48, "images": 73, "points3D": 51}
"""Bytes that each row takes at least in a binary file."""

Row = TypeVar("Row")
Points = tuple[NDArray[np.float64], NDArray[np.uint8]]
Parts = tuple[tuple[Pinhole, ...], tuple[PosedImage, ...], Points]


def read_colmap(folder: Path) -> ColmapModel:
    """The model of a folder, binary files before text, in the files' own units and axes."""
    names = ("cameras", "images", "points3D")
    for suffix in (".bin", ".txt"):
        paths = [folder / f"{name}{suffix}" for name in names]
        if all(path.is_file() for path in paths):
            return _read(folder, paths)
    raise InputError(f"{folder}: no COLMAP model (looked for cameras, images and points3D, .bin or .txt)")


def _read(folder: Path, paths: list[Path]) -> ColmapModel:
    cameras, images, points = (_binary if paths[0].suffix == ".bin" else _text)(*paths)
    try:
        return ColmapModel(cameras, images, *points)
    except GeometryError as error:
        raise FormatError(f"{folder}: {error}") from None


class BinaryReader:
    """A place in a binary file."""

    def __init__(self, path: Path) -> None:
        self.path, self.data, self.at = path, read_bytes(path), 0

    def take(self, layout: str) -> tuple[float, ...]:
        """The next numbers."""
        start, self.at = self.at, self.at + struct.calcsize(layout)
        if self.at > len(self.data):
            raise FormatError(f"{self.path}: ends at byte {len(self.data)}, a row needs up to {self.at}")
        return struct.unpack_from(layout, self.data, start)

    def count(self) -> int:
        """How many rows follow; no more than fit."""
        count = int(self.take("<Q")[0])
        room = (len(self.data) - self.at) // LEAST[self.path.stem]
        if count > room:
            raise FormatError(f"{self.path}: promises {count} rows, its {len(self.data)} bytes hold {room} at most")
        return count

    def skip(self, count: int, size: int) -> None:
        """Step over rows of `size` bytes."""
        if count * size > len(self.data) - self.at:
            raise FormatError(f"{self.path}: {count} entries of {size} bytes at byte {self.at} reach beyond its end")
        self.at += count * size

    def name(self) -> str:
        """Text up to a zero."""
        end = self.data.find(b"\0", self.at, self.at + LONGEST_NAME)
        if end < 0:
            raise FormatError(f"{self.path}: the name at byte {self.at} does not end")
        start, self.at = self.at, end + 1
        return _decoded(self.path, self.data[start:end])

    def end(self) -> None:
        """Refuse what is left over."""
        if self.at < len(self.data):
            raise FormatError(f"{self.path}: {len(self.data) - self.at} bytes are left after the last row")


def _decoded(path: Path, name: bytes) -> str:
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        raise FormatError(f"{path}: the name {name[:40]!r} is not UTF-8") from None


def _checked(path: Path, make: Callable[[], Row]) -> Row:
    """Object made from a row; FormatError with the file's name where it breaks a promise."""
    try:
        return make()
    except GeometryError as error:
        raise FormatError(f"{path}: {error}") from None


def _camera(path: Path, number: int, width: int, height: int, parameters: tuple[float, ...]) -> Pinhole:
    focal = (parameters[0], parameters[-3])  # f or fx, fy; the principal point is last
    return _checked(path, lambda: Pinhole(number, width, height, focal, (parameters[-2], parameters[-1])))


def _known(path: Path, camera: int, model: str) -> int:
    """How many parameters a camera model has."""
    if model not in PARAMETERS:
        raise FormatError(
            f"{path}: camera {camera} is {model}, expected {' or '.join(PARAMETERS)}; undistort the pictures first"
        )
    return PARAMETERS[model]


def _image(path: Path, number: int, pose: tuple[float, ...], camera: int, name: str) -> PosedImage:
    values = np.array(pose, dtype=np.float64)
    return _checked(path, lambda: PosedImage(number, name, camera, values[:4], values[4:]))


def _binary(cameras: Path, images: Path, points: Path) -> Parts:
    return _rows(cameras, _binary_camera), _rows(images, _binary_image), _binary_points(points)


def _rows(path: Path, read: Callable[[BinaryReader], Row]) -> tuple[Row, ...]:
    cursor = BinaryReader(path)
    rows = tuple(read(cursor) for _ in range(cursor.count()))
    cursor.end()
    return rows


def _binary_camera(cursor: BinaryReader) -> Pinhole:
    number, model, width, height = (int(v) for v in cursor.take("<iiQQ"))
    name = MODELS[model] if 0 <= model < len(MODELS) else f"of the unknown model {model}"
    parameters = cursor.take(f"<{_known(cursor.path, number, name)}d")
    return _camera(cursor.path, number, width, height, parameters)


def _binary_image(cursor: BinaryReader) -> PosedImage:
    number, *pose, camera = cursor.take("<i7di")
    name = cursor.name()
    cursor.skip(int(cursor.take("<Q")[0]), struct.calcsize("<ddq"))
    return _image(cursor.path, int(number), tuple(pose), int(camera), name)


def _binary_points(path: Path) -> Points:
    cursor = BinaryReader(path)
    count = cursor.count()
    place, color = np.empty((count, 3)), np.empty((count, 3), dtype=np.uint8)
    for k in range(count):
        row = cursor.take("<Q3d3BdQ")
        place[k], color[k] = row[1:4], row[4:7]
        cursor.skip(int(row[8]), struct.calcsize("<ii"))
    cursor.end()
    return place, color


def _text(cameras: Path, images: Path, points: Path) -> Parts:
    return (
        tuple(_text_camera(cameras, number, words) for number, words in _lines(cameras)),
        tuple(_text_images(images)),
        _text_points(points),
    )


def _lines(path: Path, *, blank: bool = False) -> Iterator[tuple[int, list[str]]]:
    """Words of each line that is no comment, with its number from 1; empty ones too if `blank`."""
    for number, line in enumerate(BytesIO(read_bytes(path)), 1):
        words = _decoded(path, line).split()
        if (words or blank) and not (words and words[0].startswith("#")):
            yield number, words


def _numbers(path: Path, line: int, words: list[str], kind: Callable[[str], Row]) -> list[Row]:
    try:
        return [kind(word) for word in words]
    except ValueError as error:
        raise FormatError(f"{path}: line {line}: {error}") from None


def _enough(path: Path, line: int, words: list[str], count: int, what: str) -> None:
    if len(words) < count:
        raise FormatError(f"{path}: line {line} has {len(words)} words, {what} needs {count}")


def _text_camera(path: Path, line: int, words: list[str]) -> Pinhole:
    _enough(path, line, words, 2, "a camera")
    (number,) = _numbers(path, line, words[:1], int)
    count = _known(path, number, words[1])
    _enough(path, line, words, 4 + count, "the camera")
    width, height = _numbers(path, line, words[2:4], int)
    return _camera(path, number, width, height, tuple(_numbers(path, line, words[4 : 4 + count], float)))


def _text_images(path: Path) -> Iterator[PosedImage]:
    """Two lines each; the second, of observations, may be empty or, at the end, missing."""
    lines = _lines(path, blank=True)
    for line, words in lines:
        if not words:
            continue
        _enough(path, line, words, 10, "an image")
        number, camera = _numbers(path, line, [words[0], words[8]], int)
        yield _image(path, number, tuple(_numbers(path, line, words[1:8], float)), camera, " ".join(words[9:]))
        next(lines, None)


def _text_points(path: Path) -> Points:
    place, color = array("d"), array("B")
    for line, words in _lines(path):
        _enough(path, line, words, 7, "a point")
        place.extend(_numbers(path, line, words[1:4], float))
        levels = _numbers(path, line, words[4:7], int)
        if not all(0 <= level <= 255 for level in levels):
            raise FormatError(f"{path}: line {line}: colour {levels}, expected 0 to 255")
        color.extend(levels)
    return np.array(place).reshape(-1, 3), np.array(color, dtype=np.uint8).reshape(-1, 3)
