"""Writers of small mesh files, sound or not, and what the readers make of them."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan

CUBE = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]) - [0.5, 0.5, 0.0]
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
"""A closed unit cube standing on z = 0, outward quads: area 6, volume 1."""


def scan_of(path: Path, role: Role = Role.SCENE, **options: str) -> Scan:
    """Read with options."""
    return read_scan(path, SourceOptions(**options), role)


def refusal(path: Path, role: Role = Role.SCENE, **options: str) -> str:
    """The one line with which a source is refused."""
    with pytest.raises(InputError) as caught:
        scan_of(path, role, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def volume(mesh: Mesh) -> float:
    """Signed volume by the divergence theorem [m^3]."""
    a, b, c = mesh.triangles.transpose(1, 0, 2)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def write_ply(
    path: Path, order: str, vertices: NDArray[np.float64], polygons: list[list[int]], promised: int = 0
) -> Path:
    """A PLY file with vertex colours; `promised` overstates the vertex count."""
    name = {"a": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = (
        f"ply\nformat {name} 1.0\ncomment made by a test\nelement vertex {promised or len(vertices)}\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
        f"property uchar blue\nelement face {len(polygons)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    if order == "a":
        rows = [" ".join(map(repr, map(float, v))) + " 10 20 30" for v in vertices]
        rows += [" ".join(map(str, [len(p), *p])) for p in polygons]
        path.write_text(head + "\n".join(rows))
    else:
        body = b"".join(struct.pack(order + "fffBBB", *v, 10, 20, 30) for v in vertices)
        body += b"".join(struct.pack(f"{order}B{len(p)}i", len(p), *p) for p in polygons)
        path.write_bytes(head.encode() + body)
    return path


def write_obj(path: Path, vertices: NDArray[np.float64], polygons: list[list[int]]) -> Path:
    """A plain OBJ file."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join(lines + ["f " + " ".join(str(i + 1) for i in p) for p in polygons]))
    return path


def glb(document: dict[str, object], binary: bytes) -> bytes:
    """A GLB container."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def cube_document(scale: float = 1.0, **extra: object) -> tuple[dict[str, object], bytes]:
    """A cube as glTF: y up, one named node."""
    triangles = np.array([t for q in QUADS for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])], dtype="<u2")
    points = (CUBE[:, [0, 2, 1]] * [1, 1, -1] * scale).astype("<f4")
    binary = points.tobytes() + triangles.tobytes()
    document: dict[str, object] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "Crate", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
                      {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"}],
        "bufferViews": [{"buffer": 0, "byteLength": 96}, {"buffer": 0, "byteOffset": 96, "byteLength": 72}],
        "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    return document | extra, binary
