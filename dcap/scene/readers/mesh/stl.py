"""STL meshes, binary and ascii, by trimesh. The format has no units, axes, colours or shared vertices.

trimesh only gets input that needs no guessing: exactly as many facets as stated in the header, or a complete text.
"""

from io import BytesIO, StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError
from dcap.scene.readers.files import read_bytes
from dcap.scene.readers.mesh.raw import RawMesh, check_face_count, unnamed_mesh

HEADER, FACET = 84, 50
"""Lengths of the header and of one facet of a binary file [bytes]."""


def read_stl(path: Path) -> RawMesh:
    """Read an STL file; equal corners become one vertex."""
    data = read_bytes(path)
    corners = _ascii(path, data) if _is_ascii(data) else _binary(path, data)
    check_face_count(path, len(corners) // 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return unnamed_mesh(path, vertices, index.reshape(-1, 3).astype(np.int64))


def _facets(data: bytes) -> int:
    """Number of facets stated in the header of a binary file; -1 if the file is shorter than a header."""
    return int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else -1


def _is_ascii(data: bytes) -> bool:
    """Return whether a file is ascii; a binary file may begin with 'solid' too, but its length then fits its facet
    count."""
    return data[:512].lstrip().lower().startswith(b"solid") and len(data) != HEADER + FACET * _facets(data)


def _binary(path: Path, data: bytes) -> NDArray[np.float64]:
    """Corners (3 m, 3) of a binary file, ignoring trailing bytes."""
    count = _facets(data)
    if count < 0:
        raise FormatError(f"{path}: {len(data)} bytes are less than an STL header ({HEADER})")
    size = HEADER + FACET * count
    if size > len(data):
        raise FormatError(
            f"{path}: the header promises {count} facets ({size} bytes), the file has {len(data)}: truncated"
        )
    from trimesh.exchange.stl import load_stl_binary  # trimesh takes a quarter of a second to load

    found = load_stl_binary(BytesIO(data[:size]))
    return np.asarray(found.get("vertices", np.zeros((0, 3))), dtype=np.float64)


def _ascii(path: Path, data: bytes) -> NDArray[np.float64]:
    """Corners (3 m, 3) of all solids of an ascii file."""
    text = data.decode("latin-1").replace("\r", "\n")  # trimesh would spend seconds guessing the encoding
    if "endsolid" not in text[-1000:].lower():
        raise FormatError(f"{path}: no endsolid: the file is truncated")
    from trimesh.exchange.stl import load_stl_ascii

    try:
        found = load_stl_ascii(StringIO(text))
    except ValueError as broken:
        raise FormatError(
            f"{path}: ASCII STL: a facet does not have three vertices of three numbers ({broken})"
        ) from None
    solids = found["geometry"].values() if "geometry" in found else [found]
    return np.concatenate([np.zeros((0, 3)), *(solid["vertices"] for solid in solids)])
