"""What well-kept libraries get wrong for us, the reasons of decision 023: where a test fails, one is mended.

Each test shows the library's answer beside ours; the day that it fails, our own code of that kind may go.
"""

import io
import json
import struct
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from plyfile import PlyData

from dcap.scene.errors import FormatError
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.readers.mesh.obj import read_obj
from dcap.scene.readers.mesh.ply import read_ply
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.mesh.stl import read_stl
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.glb import Node, glb_bytes

TRIANGLE = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def area(raw: RawMesh) -> float:
    """Total area of what our readers return."""
    return float(Mesh.of(raw.vertices, raw.faces).face_areas.sum())


def loaded(path: Path) -> trimesh.Trimesh:
    """One mesh of all that trimesh finds."""
    mesh = trimesh.load_scene(path, process=False).to_mesh()
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def glb(path: Path, vertices: bytes, accessor: dict[str, object], **more: object) -> Path:
    """One triangle as GLB, whose positions are described by `accessor`."""
    document = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "accessors": [accessor],
        "bufferViews": [{"buffer": 0, "byteLength": len(vertices)}], "buffers": [{"byteLength": len(vertices)}],
    }  # fmt: skip
    text = json.dumps(document | more).encode()
    text += b" " * (-len(text) % 4)
    vertices += b"\0" * (-len(vertices) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(vertices), 0x004E4942) + vertices
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


def peak_of(action: Callable[[], object]) -> int:
    """Memory that a call takes at most, whether or not it raises [bytes]."""
    tracemalloc.start()
    try:
        action()
    except Exception:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return peak


def test_trimesh_cuts_concave_polygons_of_an_obj_as_fans(tmp_path: Path) -> None:
    """An L of area 3 becomes triangles that overlap, of area 4."""
    outline = np.roll([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], 1, axis=0)
    text = "".join(f"v {x} {y} 0\n" for x, y in outline) + "f 1 2 3 4 5 6\n"
    (tmp_path / "l.obj").write_text(text)
    assert area(read_obj(tmp_path / "l.obj")) == pytest.approx(3.0)
    assert loaded(tmp_path / "l.obj").area == pytest.approx(4.0)


def test_trimesh_counts_negative_indices_of_an_obj_from_the_last_line(tmp_path: Path) -> None:
    """They count from the face that uses them: of two triangles of area 1/2 and 2 it makes one, twice."""
    small, large = (f"v 0 0 0\nv {size} 0 0\nv 0 {size} 0\nf -3 -2 -1\n" for size in (1, 2))
    (tmp_path / "two.obj").write_text(small + large)
    assert area(read_obj(tmp_path / "two.obj")) == pytest.approx(2.5)
    assert loaded(tmp_path / "two.obj").area == pytest.approx(4.0)


def test_trimesh_reads_normalised_gltf_positions_as_they_are_stored(tmp_path: Path) -> None:
    """65535 is 1 m, not 65 km."""
    stored = np.c_[TRIANGLE * 65535, np.zeros(3)].astype("<u2").tobytes()
    accessor = {"bufferView": 0, "componentType": 5123, "normalized": True, "count": 3, "type": "VEC3"}
    view = [{"buffer": 0, "byteLength": len(stored), "byteStride": 8}]
    path = glb(tmp_path / "a.glb", stored, accessor, bufferViews=view)
    assert np.ptp(read_gltf(path).vertices) == pytest.approx(1.0)
    assert np.ptp(loaded(path).vertices) == pytest.approx(65535)


def test_trimesh_leaves_sparse_gltf_values_out(tmp_path: Path) -> None:
    """The third corner is moved to x = 5 by a sparse accessor."""
    stored = TRIANGLE.astype("<f4").tobytes() + struct.pack("<H2x3f", 2, 5, 1, 0)
    views = [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size in ((0, 36), (36, 2), (40, 12))]
    sparse = {"count": 1, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}
    path = glb(tmp_path / "a.glb", stored, accessor, bufferViews=views)
    assert read_gltf(path).vertices.max() == 5.0
    assert loaded(path).vertices.max() == 1.0


def test_trimesh_reads_gltf_files_whose_required_extension_it_lacks(tmp_path: Path) -> None:
    """What a packed buffer holds is no coordinates."""
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    named = ["EXT_meshopt_compression"]
    stored = TRIANGLE.astype("<f4").tobytes()
    path = glb(tmp_path / "a.glb", stored, accessor, extensionsUsed=named, extensionsRequired=named)
    with pytest.raises(FormatError, match="EXT_meshopt_compression"):
        read_gltf(path)
    assert len(loaded(path).faces) == 1


def test_trimesh_allocates_what_a_gltf_promises(tmp_path: Path) -> None:
    """A million values without any data, in a file of half a kilobyte."""
    accessor = {"componentType": 5126, "count": 999_999, "type": "VEC3"}
    path = glb(tmp_path / "a.glb", TRIANGLE.astype("<f4").tobytes(), accessor)
    assert peak_of(lambda: read_gltf(path)) < 1e6
    assert peak_of(lambda: loaded(path)) > 12e6


def test_trimesh_writes_only_one_of_two_nodes_of_one_name() -> None:
    """A pillow on the bed and a pillow on the couch: parts are told by their trail, names repeat."""
    mesh = Mesh.of(TRIANGLE, [[0, 1, 2]])
    ours = glb_bytes([Node(name, children=(Node("pillow", mesh),)) for name in ("bed", "couch")])
    scene = trimesh.Scene()
    for name in ("bed", "couch"):
        scene.graph.update(name, "world")
        scene.add_geometry(trimesh.Trimesh(TRIANGLE, [[0, 1, 2]]), node_name="pillow", parent_node_name=name)
    named = []
    for data in (ours, scene.export(file_type="glb")):
        document = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
        named.append([node["name"] for node in document["nodes"]].count("pillow"))
    assert named == [2, 1]


def binary_ply(comment: str, count: int, polygons: list[list[int]]) -> bytes:
    """A PLY of the four corners of a square."""
    head = f"ply\nformat binary_little_endian 1.0\ncomment {comment}\nelement vertex {count}\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    head += f"element face {len(polygons)}\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"<B{len(p)}i", len(p), *p) for p in polygons)


def test_trimesh_refuses_a_binary_ply_of_triangles_and_quads(tmp_path: Path) -> None:
    """It takes the length of the first list for all."""
    (tmp_path / "a.ply").write_bytes(binary_ply("mixed", 4, [[0, 1, 2], [0, 1, 2, 3]]))
    assert len(read_ply(tmp_path / "a.ply").faces) == 3
    with pytest.raises(ValueError, match="unexpected length"):
        trimesh.load(tmp_path / "a.ply")


def test_plyfile_allocates_what_a_header_promises(tmp_path: Path) -> None:
    """Which is why the counts are compared with the file's length before it sees them."""
    data = binary_ply("liar", 10_000_000, [[0, 1, 2]])
    (tmp_path / "a.ply").write_bytes(data)
    assert peak_of(lambda: read_ply(tmp_path / "a.ply")) < 2e6
    assert peak_of(lambda: PlyData.read(io.BytesIO(data))) > 1e8


def test_plyfile_refuses_comments_that_are_not_ascii(tmp_path: Path) -> None:
    """Which is why it is given a header without them."""
    data = binary_ply("von Jürgen", 4, [[0, 1, 2, 3]])
    (tmp_path / "a.ply").write_bytes(data)
    assert len(read_ply(tmp_path / "a.ply").faces) == 2
    with pytest.raises(UnicodeDecodeError):
        PlyData.read(io.BytesIO(data))


def test_trimesh_finds_nothing_in_an_stl_with_bytes_at_its_end(tmp_path: Path) -> None:
    """Which is why it is given no more than the header promises."""
    data = bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, *TRIANGLE.ravel(), 0) + b"\0\0"
    (tmp_path / "a.stl").write_bytes(data)
    assert len(read_stl(tmp_path / "a.stl").faces) == 1
    assert not len(loaded(tmp_path / "a.stl").faces)
