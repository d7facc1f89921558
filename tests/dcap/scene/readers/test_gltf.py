"""glTF: quantised, strided and sparse geometry is what it stands for; compressed geometry is refused by name."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.source import read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions

POINTS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 1]], dtype=np.float64)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype="<u2")
"""A tetrahedron of volume 1, outward faces."""

TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


def write(path: Path, data: list[bytes], accessors: list[dict[str, Any]], **more: Any) -> Path:
    """A GLB with a buffer view per piece of data and one primitive: positions 0, indices 1."""
    binary, views = b"", []
    for piece in data:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(piece)})
        binary += piece + b"\0" * (-len(piece) % 4)
    document: dict[str, Any] = {
        "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"name": "Crate", "mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": accessors, "bufferViews": views, "buffers": [{"byteLength": len(binary)}],
    }  # fmt: skip
    for key, value in more.items():
        document[key] = value(document[key]) if callable(value) else value
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path


def accessor(view: int | None, kind: str, count: int, shape: str, **more: Any) -> dict[str, Any]:
    """One accessor."""
    base = {} if view is None else {"bufferView": view}
    return base | {"componentType": TYPES[kind], "count": count, "type": shape, **more}


INDICES = (FACES.tobytes(), accessor(1, "u2", 12, "SCALAR"))


def mesh_of(path: Path) -> Mesh:
    """Read as an object whose y is up."""
    return read_scan(path, SourceOptions(up="y"), Role.OBJECT).mesh


def same(mesh: Mesh, tolerance: float) -> None:
    """The tetrahedron, turned from y up to z up."""
    expected: NDArray[np.float64] = POINTS[:, [0, 2, 1]] * [1, -1, 1]
    np.testing.assert_allclose(mesh.triangles, expected[FACES], atol=tolerance)


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2"])
@pytest.mark.parametrize("normalized", [False, True])
def test_quantised_positions_stand_for_metres(tmp_path: Path, kind: str, normalized: bool) -> None:
    """KHR_mesh_quantization: integers, plain or as shares of their largest, under a node that scales them back."""
    most = np.iinfo(kind).max
    values = np.rint(POINTS / 3 * most)
    rows = np.zeros((4, 4), dtype="<" + kind)  # rows are padded to a multiple of four bytes
    rows[:, :3] = values
    path = write(
        tmp_path / "q.glb",
        [rows.tobytes(), INDICES[0]],
        [accessor(0, kind, 4, "VEC3", normalized=normalized), INDICES[1]],
        bufferViews=lambda views: [views[0] | {"byteStride": rows.strides[0]}, views[1]],
        nodes=[{"name": "Crate", "mesh": 0, "scale": [3 / (1 if normalized else most)] * 3}],
        extensionsUsed=["KHR_mesh_quantization"],
        extensionsRequired=["KHR_mesh_quantization"],
    )
    same(mesh_of(path), 3 / most)  # a step of the grid; half of one would do but for float32


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessors_replace_some_values(tmp_path: Path, based: bool) -> None:
    """Over a base, and over zeros where there is none."""
    base = POINTS.copy()
    base[[1, 3]] = 7.0 if based else 0.0
    base[2] = POINTS[2] if based else 0.0
    at = np.array([1, 3] if based else [1, 2, 3], dtype="u1")
    sparse = {
        "count": len(at), "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3},
    }  # fmt: skip
    path = write(
        tmp_path / "s.glb",
        [base.astype("<f4").tobytes(), INDICES[0], at.tobytes(), POINTS[at].astype("<f4").tobytes()],
        [accessor(0 if based else None, "f4", 4, "VEC3", sparse=sparse), INDICES[1]],
    )
    same(mesh_of(path), 1e-6)


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize("declared", [True, False])
def test_compression_is_named_with_its_remedy(tmp_path: Path, name: str, declared: bool) -> None:
    """Draco sits in primitives, Meshopt in buffer views; both are refused, also where it is not declared."""
    extension = {"extensions": {name: {"bufferView": 0, "buffer": 0, "count": 4, "byteStride": 12}}}
    where: dict[str, Any] = (
        {"meshes": lambda meshes: [{"primitives": [meshes[0]["primitives"][0] | extension]}]}
        if "draco" in name
        else {"bufferViews": lambda views: [views[0] | extension, views[1]]}
    )
    used = {"extensionsUsed": [name], "extensionsRequired": [name]} if declared else {}
    path = write(
        tmp_path / "c.glb", [POINTS.astype("<f4").tobytes(), INDICES[0]], [accessor(0, "f4", 4, "VEC3"), INDICES[1]],
        **where, **used,
    )  # fmt: skip
    with pytest.raises(InputError, match=f"{name}.*gltf-transform copy"):
        mesh_of(path)


def test_nodes_of_one_name_stay_apart(tmp_path: Path) -> None:
    """Names need not be unique in glTF: the second of two equal siblings gets a number, and children follow theirs."""
    nodes = [{"name": "A", "children": [1, 2]}, {"name": "B", "mesh": 0}, {"name": "B", "children": [3]}]
    nodes += [{"name": "C", "mesh": 0, "translation": [9, 0, 0]}]
    path = write(
        tmp_path / "n.glb", [POINTS.astype("<f4").tobytes(), INDICES[0]], [accessor(0, "f4", 4, "VEC3"), INDICES[1]],
        nodes=nodes,
    )  # fmt: skip
    assert read_scan(path, SourceOptions(), Role.SCENE).node_names == ("A/B", "A/B.2/C")


POSITIONS = (POINTS.astype("<f4").tobytes(), accessor(0, "f4", 4, "VEC3"))


def tetrahedra(path: Path, data: list[bytes], accessors: list[dict[str, Any]], **more: Any) -> RawMesh:
    """The tetrahedron in floats, with further data, as the reader finds it."""
    return read_gltf(write(path, [POSITIONS[0], INDICES[0], *data], [POSITIONS[1], INDICES[1], *accessors], **more))


def node_with(**more: Any) -> Any:
    """The one node with further keys."""
    return lambda nodes: [nodes[0] | more]


def test_each_copy_of_an_instanced_mesh_is_a_thing(tmp_path: Path) -> None:
    """EXT_mesh_gpu_instancing, listed as used only: three tetrahedra, moved, turned about x and scaled."""
    moved = np.array([[1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype="<f4")
    turned = np.array([[0, 0, 0, 127], [127, 0, 0, 0], [0, 0, 0, 127]], dtype="i1")
    scaled = np.array([[1, 1, 1], [1, 1, 1], [2, 2, 2]], dtype="<f4")
    attributes = {"TRANSLATION": 2, "ROTATION": 3, "SCALE": 4}
    mesh = tetrahedra(
        tmp_path / "i.glb", [one.tobytes() for one in (moved, turned, scaled)],
        [accessor(2, "f4", 3, "VEC3"), accessor(3, "i1", 3, "VEC4", normalized=True), accessor(4, "f4", 3, "VEC3")],
        extensionsUsed=["EXT_mesh_gpu_instancing"],
        nodes=node_with(translation=[10, 0, 0], extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}}),
    )  # fmt: skip
    assert mesh.node_names == ("Crate", "Crate.2", "Crate.3")
    expected = [POINTS + np.array([11, 0, 0]), POINTS * [1, -1, -1] + [10, 2, 0], 2 * POINTS + [10, 0, 3]]
    np.testing.assert_allclose(mesh.vertices, np.concatenate(expected), atol=1e-6)
    assert mesh.notes == ()


def test_a_skin_is_read_in_the_pose_of_its_joints(tmp_path: Path) -> None:
    """Each vertex goes with its joints; the node that has the skin, with a scale of 100, moves nothing."""
    joints = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], dtype="u1")
    weights = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]], dtype="<f4")
    bind = np.stack([np.eye(4), np.eye(4)])
    bind[1, 3, :3] = [0, -3, 0]  # column-major: the second joint's rest place is (0, 3, 0)
    nodes = [
        {"name": "Doll", "mesh": 0, "skin": 0, "scale": [100, 100, 100]},
        {"name": "hip", "children": [2], "translation": [5, 0, 0]},
        {"name": "arm", "translation": [0, 4, 0]},
    ]
    mesh = tetrahedra(
        tmp_path / "s.glb", [joints.tobytes(), weights.tobytes(), bind.astype("<f4").tobytes()],
        [accessor(2, "u1", 4, "VEC4"), accessor(3, "f4", 4, "VEC4"), accessor(4, "f4", 2, "MAT4")],
        nodes=nodes, scenes=[{"nodes": [0, 1]}], skins=[{"joints": [1, 2], "inverseBindMatrices": 4}],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}, "indices": 1}]}],
    )  # fmt: skip
    np.testing.assert_allclose(mesh.vertices, POINTS + np.array([[5, 0, 0], [5, 0, 0], [5, 1, 0], [5, 0.5, 0]]))


def test_morph_targets_move_vertices_by_their_weights(tmp_path: Path) -> None:
    """The weights of a node go before those of its mesh."""
    shift = np.tile(np.array([0, 0, 1], dtype="<f4"), (4, 1))
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": 2}]}
    for own, expected in (({}, 0.5), ({"weights": [2.0]}, 2.0)):
        mesh = tetrahedra(
            tmp_path / "m.glb", [shift.tobytes()], [accessor(2, "f4", 4, "VEC3")], nodes=node_with(**own),
            meshes=[{"primitives": [primitive], "weights": [0.5]}],
        )  # fmt: skip
        np.testing.assert_allclose(mesh.vertices, POINTS + np.array([0, 0, expected]))


def test_nodes_that_a_file_hides_are_left_out(tmp_path: Path) -> None:
    """KHR_node_visibility, with a note."""
    hidden = {"name": "ghost", "mesh": 0, "extensions": {"KHR_node_visibility": {"visible": False}}}
    mesh = tetrahedra(
        tmp_path / "v.glb", [], [], nodes=lambda nodes: [*nodes, hidden], scenes=[{"nodes": [0, 1]}],
        extensionsUsed=["KHR_node_visibility"],
    )  # fmt: skip
    assert mesh.node_names == ("Crate",)
    assert mesh.notes == ("nodes that the file hides are left out",)


def test_what_is_not_read_is_told(tmp_path: Path) -> None:
    """A texture in a format that is not read, and an extension that is listed as used only."""
    coordinates = np.zeros((4, 2), dtype="<f4")
    mesh = tetrahedra(
        tmp_path / "t.glb", [coordinates.tobytes()], [accessor(2, "f4", 4, "VEC2")],
        meshes=[{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        textures=[{"extensions": {"KHR_texture_basisu": {"source": 0}}}],
        extensionsUsed=["KHR_texture_basisu", "VENDOR_wobble"],
    )  # fmt: skip
    assert mesh.notes == (
        "t.glb uses the glTF extension VENDOR_wobble, which is not read",
        "texture 0 has no image that is read (KHR_texture_basisu): the material's colour is used",
    )
