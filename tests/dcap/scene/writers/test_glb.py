"""Labelled GLB files: what is written is read back as the same instances and parts, and by others as a plain scene."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dcap.language.offline.client import OfflineClient
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.boxes import min_area_box
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from tasks.mesh.stage import cleaned
from tasks.segment.stage import SegmentConfig, segment

CORNERS = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def block(low: tuple[float, float, float], size: tuple[float, float, float], color: tuple[int, int, int]) -> Mesh:
    """A closed box of twelve triangles."""
    faces = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
    return Mesh.of(np.array(low) + CORNERS * size, faces, color)


THINGS = {
    ("bed_7", "bed"): [
        ("frame", block((0, 0, 0), (1.5, 2, 0.3), (120, 80, 50))),
        ("mattress", block((0, 0, 0.3), (1.5, 2, 0.2), (240, 240, 235))),
        ("pillow", block((0.1, 1.5, 0.5), (0.5, 0.4, 0.1), (250, 250, 250))),
        ("pillow", block((0.8, 1.5, 0.5), (0.5, 0.4, 0.1), (250, 250, 250))),
    ],
    ("12", "night stand"): [("body", block((1.6, 1.6, 0), (0.4, 0.4, 0.5), (90, 60, 30)))],
    ("night_stand_0", "night stand"): [("body", block((-0.5, 1.6, 0), (0.4, 0.4, 0.5), (90, 60, 30)))],
}
"""Three things in odd order of ids: by id and label, their parts."""


def made() -> Segmentation:
    """The segmentation of `THINGS`, and a crumb that belongs to none."""
    meshes, instance, part, instances = [], [], [], []
    for i, ((one, label), pieces) in enumerate(THINGS.items()):
        for k, (_, mesh) in enumerate(pieces):
            meshes.append(mesh)
            instance += [i] * 12
            part += [k] * 12
        whole = min_area_box(np.concatenate([mesh.vertices for _, mesh in pieces]))
        parts = tuple(Part(name, min_area_box(mesh.vertices), 1.0) for name, mesh in pieces)
        instances.append(Instance(one, label, whole, parts, None))
    meshes.append(block((3, 3, 0), (0.2, 0.2, 0.2), (1, 2, 3)))
    face_instance, face_part = (np.array([*x, *[-1] * 12], dtype=np.int32) for x in (instance, part))
    return Segmentation(Mesh.concatenate(meshes), tuple(instances), face_instance, face_part)


def test_instances_and_parts_come_back(tmp_path: Path) -> None:
    """Ids, labels, part names, the faces of each and their colours; the crumb stays nobody's."""
    first = made()
    (tmp_path / "room.glb").write_bytes(glb_bytes(labelled_nodes(first)))
    scan = read_scan(tmp_path / "room.glb", SourceOptions(), Role.SCENE)
    assert (scan.up, scan.unit_source, scan.notes) == ("y", "format", ())
    back = segment(cleaned(scan), SegmentConfig(), OfflineClient())
    assert [(a.id, a.label, [p.name for p in a.parts]) for a in back.instances] == [
        (one, label, [name for name, _ in pieces]) for (one, label), pieces in THINGS.items()
    ]
    np.testing.assert_array_equal(back.face_instance, first.face_instance)
    np.testing.assert_array_equal(back.face_part, first.face_part)
    assert np.abs(back.mesh.triangles - first.mesh.triangles).max() < 1e-6  # float32 of metres
    color = [mesh.colors[mesh.faces].mean(axis=1) for mesh in (first.mesh, back.mesh)]
    assert np.abs(color[0] - color[1]).max() < 1.0


def test_what_is_added_by_hand_is_found_by_its_name(tmp_path: Path) -> None:
    """A node without a label beside labelled ones is an instance by its name, as in any glTF."""
    lamp = Node("Floor Lamp.001", block((2.5, 0, 0), (0.3, 0.3, 1.5), (9, 9, 9)))
    (tmp_path / "room.glb").write_bytes(glb_bytes([*labelled_nodes(made()), lamp]))
    found = segment(read_scan(tmp_path / "room.glb", SourceOptions(), Role.SCENE), SegmentConfig(), OfflineClient())
    assert [(one.id, one.label) for one in found.instances][3:] == [("floor_lamp", "floor lamp")]


@pytest.mark.parametrize("gap", [0.5, 0.0])
def test_nodes_of_one_name_are_one_thing_only_where_they_touch(tmp_path: Path, gap: float) -> None:
    """Two chairs that stand apart are two instances, also under the same name; pieces of one chair are one."""
    for names in (("chair", "chair"), ("Chair.001", "Chair.002")):
        nodes = [Node(n, block((i * (0.5 + gap), 0, 0), (0.5, 0.5, 1), (9, 9, 9))) for i, n in enumerate(names)]
        nodes.append(Node("table", block((3, 3, 0), (1, 1, 0.7), (9, 9, 9))))
        (tmp_path / "room.glb").write_bytes(glb_bytes(nodes))
        found = segment(read_scan(tmp_path / "room.glb", SourceOptions(), Role.SCENE), SegmentConfig(), OfflineClient())
        expected = ["chair_0", "chair_1", "table"] if gap else ["chair", "table"]
        assert [one.id for one in found.instances] == expected


def test_others_read_it(tmp_path: Path) -> None:
    """Another library finds the nodes, y up, the colours and no waste: chunks end where the file ends."""
    data = glb_bytes(labelled_nodes(made()))
    (tmp_path / "room.glb").write_bytes(data)
    assert struct.unpack_from("<I", data, 8)[0] == len(data)
    loaded = trimesh.load_scene(tmp_path / "room.glb", process=False)
    np.testing.assert_allclose(loaded.bounds, [[-0.5, 0, -3.2], [3.2, 0.6, 0]], atol=1e-6)
    assert {"bed_7", "mattress", "pillow.2", "unassigned"} <= set(loaded.graph.nodes)
    frame = loaded.geometry["frame"]
    assert (np.asarray(frame.visual.vertex_colors)[:, :3] == [120, 80, 50]).all()


def test_same_input_same_bytes_and_nothing_is_a_valid_file() -> None:
    """The writer has no clock and no counter; a scene without faces has no empty lists, which the standard forbids."""
    assert glb_bytes(labelled_nodes(made())) == glb_bytes(labelled_nodes(made()))
    none = np.full(84, -1, np.int32)
    nothing = replace(made(), instances=(), face_instance=none, face_part=none)
    assert [node.name for node in labelled_nodes(nothing)] == ["unassigned"]
    empty = glb_bytes([Node("empty", Mesh.concatenate([]))])
    document = json.loads(empty[20:])
    assert not {"meshes", "accessors", "buffers"} & set(document)
    assert document["nodes"] == [{"name": "empty"}]
