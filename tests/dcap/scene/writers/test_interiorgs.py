"""Promises of the InteriorGS writer."""

import json
from pathlib import Path

import numpy as np
import pytest

from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.interiorgs import write_interiorgs
from dcap.scene.writers.meshes import write_ply
from dcap.synthetic.rooms import BuiltRoom, build_room


@pytest.fixture(scope="module")
def built() -> BuiltRoom:
    return build_room("hall_01", 0)


@pytest.fixture(scope="module")
def folder(built: BuiltRoom, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("room")
    write_interiorgs(path, built.record, 0)
    return path


def test_same_input_same_bytes(built: BuiltRoom, folder: Path, tmp_path: Path) -> None:
    """Writing twice gives identical files."""
    write_interiorgs(tmp_path, built.record, 0)
    assert all((tmp_path / p.name).read_bytes() == p.read_bytes() for p in folder.iterdir())


def test_boxes_have_eight_corners_of_a_box(folder: Path) -> None:
    """Whatever their order, the corners of each box span two heights and four points in plan."""
    for entry in json.loads((folder / "labels.json").read_text()):
        if "bounding_box" not in entry:
            assert entry["label"].lower() in ("room", "wall")
            continue
        corners = np.array([[c["x"], c["y"], c["z"]] for c in entry["bounding_box"]])
        assert corners.shape == (8, 3)
        assert len(np.unique(corners[:, 2])) == 2
        assert len(np.unique(corners[:, :2], axis=0)) == 4


def test_ply_holds_what_was_given(tmp_path: Path) -> None:
    """Header and body of the binary PLY agree with the mesh."""
    mesh = Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], (10, 20, 30))
    write_ply(tmp_path / "a.ply", mesh, ["made for a test"])
    data = (tmp_path / "a.ply").read_bytes()
    body = data[data.index(b"end_header\n") + len(b"end_header\n") :]
    row = np.frombuffer(body[: 3 * 51], dtype=[("place", "<f8", 6), ("color", "u1", 3)])
    np.testing.assert_array_equal(row["place"][:, :3], mesh.vertices)
    np.testing.assert_array_equal(row["place"][:, 3:], [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(row["color"], mesh.colors)
    assert body[3 * 51 :] == b"\x03" + np.array([0, 1, 2], dtype="<u4").tobytes()
