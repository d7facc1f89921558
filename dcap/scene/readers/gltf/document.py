"""The JSON document of a glTF 2.0 file: on its own (.gltf) or as the first chunk of a container (.glb).

Guaranteed: a document is an object, its lists hold objects, and chunks end within the file.
Source: Khronos, "glTF 2.0 Specification", section 4.4 (GLB).
"""

import struct
from collections.abc import Iterator
from mmap import mmap
from pathlib import Path
from typing import Any, TypeVar

from dcap.scene.errors import FormatError
from dcap.scene.readers.files.json_text import parse_json

Json = dict[str, object]
"""The document, whose values are checked where they are used."""

Entry = dict[str, Any]
"""One entry of the document; a wrong type inside it is found where it is used."""

Value = TypeVar("Value")

JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def require(path: Path, document: Json, key: str, kind: type[Value], default: Value) -> Value:
    """`document[key]`, which must have the stated type if it is there."""
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
    """The document and where what follows it begins [bytes]."""
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
    """The bytes of the chunk that begins at `start`; None where the file ends there."""
    if start + 8 > len(data) or start + 8 > struct.unpack_from("<I", data, 8)[0]:
        return None
    size, kind = struct.unpack_from("<II", data, start)
    if kind != BINARY_CHUNK or start + 8 + size > len(data):
        raise FormatError(
            f"{path}: the binary chunk promises {size} bytes, {len(data) - start - 8} follow: it is truncated"
        )
    return data[start + 8 : start + 8 + size]


def uris(path: Path, document: Json) -> Iterator[str]:
    """Every URI of a buffer or picture that is not the data itself."""
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
