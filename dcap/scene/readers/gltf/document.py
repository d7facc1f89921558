"""The document of a glTF 2.0 file (.gltf or .glb), the content of its URIs, and its accessors.

Guaranteed: a document is an object, its lists hold objects, and chunks end within the file.
Source: Khronos, "glTF 2.0 Specification", section 4.4 (GLB).

Content of the URIs of a glTF file: embedded data, or a file next to the document.

glTF accessors: typed views into buffers, checked against the available bytes before they are read.
"""

import base64
import struct
from collections.abc import Iterator
from mmap import mmap
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError, format_error
from dcap.scene.readers.files import absence, find_file, parse_json, read_bytes
from dcap.scene.readers.mesh.raw import MAX_CORNERS

Json = dict[str, object]
"""The document, whose values are checked where they are used."""

Entry = dict[str, Any]
"""One entry of the document; wrong types inside it are detected on use."""

Value = TypeVar("Value")

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
LARGEST = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0, 5125: 4294967295.0}
"""The integer that a normalised accessor maps to one."""

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

INCONSISTENT = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""Errors that contradictory entries raise."""


def require(path: Path, document: Json, key: str, kind: type[Value], default: Value) -> Value:
    """`document[key]`, which must have the stated type if it exists."""
    value = document.get(key, default)
    if not isinstance(value, kind):
        raise FormatError(f"{path}: glTF key {key!r} is a {type(value).__name__}, expected {kind.__name__}")
    return value


def entries(path: Path, document: Json, key: str) -> list[Entry]:
    """The list `document[key]`, empty if it is missing; every entry must be an object."""
    found = require(path, document, key, list, [])
    for index, entry in enumerate(found):
        if not isinstance(entry, dict):
            raise FormatError(f"{path}: entry {index} of glTF key {key!r} is a {type(entry).__name__}, expected dict")
    return found


def read_document(path: Path, data: bytes | mmap) -> tuple[Json, int]:
    """The document, and the offset at which it ends [bytes]."""
    if data[:4] != b"glTF":
        return _parsed(path, data[:]), len(data)
    if len(data) < 20:
        raise FormatError(f"{path}: {len(data)} bytes are less than a GLB header (20): the file is truncated")
    version, length, size, kind = struct.unpack_from("<IIII", data, 4)
    if version != 2 or kind != JSON_CHUNK:
        raise FormatError(f"{path}: GLB version {version}, first chunk {kind:#x}; only glTF 2.0 is read")
    if length > len(data) or 20 + size > len(data):
        raise FormatError(f"{path}: the header promises {length} bytes, the file has {len(data)}: it is truncated")
    return _parsed(path, data[20 : 20 + size]), 20 + size


def binary_chunk(path: Path, data: bytes, start: int) -> bytes | None:
    """The bytes of the chunk that begins at `start`; None if the file ends there."""
    if start + 8 > len(data) or start + 8 > struct.unpack_from("<I", data, 8)[0]:
        return None
    size, kind = struct.unpack_from("<II", data, start)
    if kind != BINARY_CHUNK or start + 8 + size > len(data):
        raise FormatError(
            f"{path}: the binary chunk promises {size} bytes, {len(data) - start - 8} follow: it is truncated"
        )
    return data[start + 8 : start + 8 + size]


def uris(path: Path, document: Json) -> Iterator[str]:
    """Every URI of a buffer or picture that is not embedded data."""
    for entry in (*entries(path, document, "buffers"), *entries(path, document, "images")):
        uri = require(path, entry, "uri", str, "data:")
        if not uri.startswith("data:"):
            yield uri


def _parsed(path: Path, text: bytes) -> Json:
    document = parse_json(path, text, "glTF JSON")
    if not isinstance(document, dict):
        raise FormatError(f"{path}: the glTF JSON is not an object")
    version = str(require(path, document, "asset", dict, {}).get("version", "2.0"))
    if version.partition(".")[0] != "2":
        raise FormatError(f"{path}: glTF version {version[:20]!r}; only glTF 2.0 is read")
    return document


def uri_bytes(path: Path, uri: str) -> bytes:
    """Bytes of a data URI, or of a file next to the document at `path`."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except ValueError as error:
            raise FormatError(f"{path}: a data URI is broken: {error}") from None
    found = find_file(path.parent, unquote(uri))
    if found is None:
        raise FormatError(f"{path}: the file {unquote(uri)!r} that it names {absence(unquote(uri))}")
    return read_bytes(path.parent / found)


def missing(path: Path, uri: str) -> str:
    """Reason why the file named by a URI is missing, as the end of a sentence; empty if it exists, or if the URI is
    data."""
    if uri.startswith("data:") or find_file(path.parent, unquote(uri)) is not None:
        return ""
    return absence(unquote(uri))


class Accessors:
    """The accessors of one document over its loaded buffers."""

    def __init__(self, path: Path, document: Json, buffers: list[bytes]) -> None:
        self.path, self.buffers = path, buffers
        self.entries = entries(path, document, "accessors")
        self.views = entries(path, document, "bufferViews")
        for index in range(len(self.entries)):
            try:
                self._check(index)
            except (InputError, *INCONSISTENT) as broken:
                what = str(broken if isinstance(broken, InputError) else self._inconsistent(index, broken))
                raise format_error(path, what.removeprefix(f"{path}: "), ("accessors", index)) from None

    def _inconsistent(self, index: int, cause: Exception) -> FormatError:
        return FormatError(f"{self.path}: accessor {index} is inconsistent ({type(cause).__name__}: {cause})")

    def view(self, index: int) -> bytes:
        """The bytes of one buffer view."""
        view = self.views[index]
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        data = self.buffers[int(view["buffer"])]
        if start < 0 or length < 0 or start + length > len(data):
            raise FormatError(
                f"{self.path}: buffer view {index} ends at byte {start + length}, its buffer has {len(data)}"
            )
        return data[start : start + length]

    def read(self, index: int) -> NDArray[np.generic]:
        """The values of one accessor, shape (count, width); normalised integers become floats."""
        try:
            if index < 0:
                raise FormatError(f"{self.path}: there is no accessor {index}")
            return self._read(index)
        except INCONSISTENT as broken:
            raise self._inconsistent(index, broken) from None

    def _read(self, index: int) -> NDArray[np.generic]:
        entry = self.entries[index]
        dtype, width, count = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]], int(entry["count"])
        if "bufferView" in entry:
            values = self._strided(entry, dtype, width, count)
        else:
            values = np.zeros((count, width), dtype=dtype)
        if "sparse" in entry:
            values = self._with_sparse(values, entry["sparse"], dtype, width)
        if entry.get("normalized") and dtype.kind != "f":
            # glTF 2.0, section 3.6.2.2: f = max(c / (2^(b-1) - 1), -1), f = c / (2^b - 1).
            return np.asarray(np.maximum(values.astype(np.float64) / LARGEST[entry["componentType"]], -1.0))
        return values

    def _strided(
        self, entry: dict[str, int], dtype: np.dtype[np.generic], width: int, count: int
    ) -> NDArray[np.generic]:
        view = self.views[entry["bufferView"]]
        data, start = self.view(entry["bufferView"]), int(entry.get("byteOffset", 0))
        row = dtype.itemsize * width
        stride = int(view.get("byteStride", row))
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize)).copy()

    def _with_sparse(
        self, values: NDArray[np.generic], sparse: dict[str, dict[str, int]], dtype: np.dtype[np.generic], width: int
    ) -> NDArray[np.generic]:
        count = int(sparse["count"])  # type: ignore[call-overload]
        indices, replacement = sparse["indices"], sparse["values"]
        at = np.frombuffer(
            self.view(indices["bufferView"]), COMPONENTS[indices["componentType"]], count, indices.get("byteOffset", 0)
        )
        new = np.frombuffer(
            self.view(replacement["bufferView"]), dtype, count * width, replacement.get("byteOffset", 0)
        )
        values[at] = new.reshape(count, width)
        return values

    def _check(self, index: int) -> None:
        """Refuse an accessor that extends beyond its bytes, or that would allocate zeros without limit."""
        entry = self.entries[index]
        count = int(entry["count"])
        row = np.dtype(COMPONENTS[entry["componentType"]]).itemsize * WIDTHS[entry["type"]]
        available = sum(map(len, self.buffers))
        if count < 0 or ("bufferView" not in entry and count * row > 64 * available + 4096):
            raise FormatError(f"{self.path}: accessor {index} promises {count} values without data")
        if count > MAX_CORNERS:
            raise InputError(
                f"{self.path}: accessor {index} has {count} values > {MAX_CORNERS}; decimate the mesh first"
            )
        if "bufferView" not in entry:
            return
        view = self.views[int(entry["bufferView"])]
        stride = int(view.get("byteStride", row))
        end = int(entry.get("byteOffset", 0)) + (count - 1) * stride + row if count else 0
        length = len(self.view(int(entry["bufferView"])))
        if stride < row or end > length:
            raise FormatError(
                f"{self.path}: accessor {index} promises {count} values ({end} bytes), its view has {length} bytes"
            )
