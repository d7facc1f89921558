"""STL meshes, binary and ascii. The format knows neither units, axes, colours nor shared vertices."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError
from dcap.scene.problems import Report, error, refusing
from dcap.scene.readers.raw import RawMesh, check_face_count, read_bytes

RECORD = np.dtype([("normal", "<f4", (3,)), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
"""One facet of a binary file: 50 bytes."""


def read_stl(path: Path, report: Report | None = None) -> RawMesh:
    """Read an STL file; equal corners become one vertex. With a `report`, broken facets are told and left out."""
    data = read_bytes(path)
    corners = _ascii(path, data, report or refusing(path)) if _is_ascii(data) else _binary(path, data)
    if len(corners):
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    else:
        vertices, index = np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    faces = index.reshape(-1, 3).astype(np.int64)
    return RawMesh(
        path=path, vertices=vertices, faces=faces, colors=None, paint=None,
        face_node=np.full(len(faces), -1, dtype=np.int32), node_names=(), up="", unit_metres=0.0, notes=(),
    )  # fmt: skip


def _is_ascii(data: bytes) -> bool:
    """A binary file may begin with 'solid' too: its length then fits its own facet count."""
    if not data[:512].lstrip().lower().startswith(b"solid"):
        return False
    count = int(np.frombuffer(data, "<u4", 1, 80)[0]) if len(data) >= 84 else -1
    return len(data) != 84 + 50 * count


def _binary(path: Path, data: bytes) -> NDArray[np.float64]:
    """Corners (m, 3, 3) of a binary file."""
    if len(data) < 84:
        raise FormatError(f"{path}: {len(data)} bytes are less than an STL header (84)")
    count = int(np.frombuffer(data, "<u4", 1, 80)[0])
    if 84 + 50 * count > len(data):
        raise FormatError(
            f"{path}: the header promises {count} facets ({84 + 50 * count} bytes), the file has {len(data)}: truncated"
        )
    check_face_count(path, count)
    return np.frombuffer(data, RECORD, count, 84)["corner"].astype(np.float64)


def _ascii(path: Path, data: bytes, report: Report) -> NDArray[np.float64]:
    """Corners (m, 3, 3) of an ascii file."""
    words = data.lower().split()
    at = [i for i, word in enumerate(words) if word == b"vertex"]
    if len(at) % 3 or (at and at[-1] + 3 >= len(words)) or not any(w == b"endsolid" for w in words[-64:]):
        raise FormatError(f"{path}: {len(at)} vertex lines and no endsolid: the file is truncated")
    values = [words[i + 1 : i + 4] for i in at]
    try:
        return np.array(values, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError:
        pass
    lines = [n for n, line in enumerate(data.split(b"\n"), start=1) for w in line.lower().split() if w == b"vertex"]
    sound = np.ones(len(at), dtype=bool)
    for index, (line, value) in enumerate(zip(lines, values, strict=True)):
        try:
            np.array(value, dtype=np.float64)
        except ValueError:
            sound[index] = False
            text = " ".join(word.decode("latin-1") for word in value)
            report(error(f"{text!r} in the STL data is not three numbers", line=line))
    whole = np.repeat(sound.reshape(-1, 3).all(axis=1), 3)
    kept = [value for value, good in zip(values, whole, strict=True) if good]
    return np.array(kept, dtype=np.float64).reshape(-1, 3, 3)
