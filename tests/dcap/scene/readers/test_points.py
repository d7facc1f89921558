"""Point clouds: each format gives the same points, colours and normals; what is no cloud is refused in a line."""

import re
from pathlib import Path

import numpy as np
import open3d
import pytest
import trimesh
from point_files import WRITERS, points_on, without_normals, write_npy, write_pcd, write_ply_points

from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.points.formats import is_points, read_points
from dcap.scene.readers.scenes.sugar import find_mesh, has_no_faces
from dcap.scene.readers.source import read_file, read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions


def cloud() -> PointCloud:
    """A box of many colours, 0.4 x 0.3 x 0.2 m, on the plane z = 0."""
    solid = trimesh.creation.box((0.4, 0.3, 0.2))
    colors = np.random.default_rng(0).integers(0, 256, solid.vertices.shape)
    return points_on(Mesh.of(solid.vertices + np.array([0.0, 0.0, 0.1]), solid.faces, colors), 2000)


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("normals", [True, False])
def test_each_format_gives_the_points_that_were_written(tmp_path: Path, name: str, normals: bool) -> None:
    """Positions to nine digits or single precision, colours to the byte, normals where the format keeps them."""
    given = cloud() if normals else without_normals(cloud())
    path = WRITERS[name](tmp_path / name, given)
    assert is_points(path)
    assert has_no_faces(path)
    found, _ = read_points(path)
    np.testing.assert_allclose(found.position, given.position, atol=1e-7)
    np.testing.assert_array_equal(found.color, given.color)
    if given.normal is None or name == "a.pts":
        assert found.normal is None
    else:
        assert found.normal is not None
        np.testing.assert_allclose(found.normal, given.normal, atol=1e-6)


def test_packed_pcd_is_read(tmp_path: Path) -> None:
    """What Open3D writes compressed is read as it was."""
    given = cloud()
    points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(given.position))
    points.colors = open3d.utility.Vector3dVector(given.color / 255.0)
    open3d.io.write_point_cloud(tmp_path / "a.pcd", points, compressed=True)
    found, _ = read_points(tmp_path / "a.pcd")
    np.testing.assert_allclose(found.position, given.position, atol=1e-6)  # single precision of 0.4 m
    np.testing.assert_array_equal(found.color, given.color)
    (tmp_path / "b.pcd").write_bytes((tmp_path / "a.pcd").read_bytes()[:-100])
    with pytest.raises(InputError, match=r"b\.pcd: .*truncated"):
        read_points(tmp_path / "b.pcd")


def test_pixels_without_a_measurement_are_no_points(tmp_path: Path) -> None:
    """An organised PCD says nan where its camera saw nothing: those go and are counted; in a list of points they are
    broken."""
    given = cloud()
    given.position[7:107] = np.nan
    image = write_pcd(tmp_path / "image.pcd", given, height=40)
    found, notes = read_points(image)
    assert len(found) == 1900
    assert any("100 of 2000" in note for note in notes)
    with pytest.raises(InputError, match=r"list\.pcd: point 7 is not finite.*100 of 2000"):
        read_points(write_pcd(tmp_path / "list.pcd", given))


@pytest.mark.parametrize(
    ("text", "told"),
    [("//X Y Z R G B\n", "columns 4 to 6"), ("x,y,z,r,g,b\n", "columns 4 to 6"), ("600\n", "columns 4 to 6")],
)
def test_a_text_may_begin_with_names_or_a_count(tmp_path: Path, text: str, told: str) -> None:
    """Comments, a line of names and a count are stepped over; commas are as good as blanks."""
    given = without_normals(cloud()).subset(np.arange(600))
    mark = "," if "," in text else " "
    lines = [mark.join(f"{v:.9g}" for v in (*p, *c)) for p, c in zip(given.position, given.color, strict=True)]
    (tmp_path / "a.xyz").write_text(text + "\n".join(lines) + "\n")
    found, notes = read_points(tmp_path / "a.xyz")
    np.testing.assert_allclose(found.position, given.position, atol=1e-7)
    np.testing.assert_array_equal(found.color, given.color)
    assert any(told in note for note in notes)


def broken_files(folder: Path) -> dict[str, tuple[Path, str]]:
    """Files that are refused, and what the line says."""
    given = without_normals(cloud())
    hole, flat, line = (given.position.copy() for _ in range(3))
    hole[3, 1] = np.nan
    flat[:, 2] = 1e-4 * np.sin(np.arange(len(flat)))
    line[:, 1:] = 0.0
    ply = write_ply_points(folder / "whole.ply", given).read_bytes()
    pcd = write_pcd(folder / "whole.pcd", given).read_bytes()
    files = {
        "nan.npy": "point 3 is not finite", "flat.npy": "lie in a plane", "line.npy": "lie in a plane",
        "few.npy": "40 points, expected at least 100", "same.npy": "all 500 points lie at", "none.npy": "no points",
        "turned.npy": r"shape \(3, 2000\)", "pickle.npy": "cannot be read as arrays", "words.npy": "type <U1",
        "names.npz": "none of its arrays", "short.ply": "truncated", "short.pcd": "truncated", "empty.xyz": "empty",
        "words.xyz": "line 2 is", "ragged.xyz": "not the same numbers", "head.pcd": "no DATA line",
        "field.pcd": "expected x y z",
    }  # fmt: skip
    arrays = {
        "nan": hole, "flat": flat, "line": line, "few": given.position[:40], "same": np.ones((500, 3)),
        "none": np.zeros((0, 3)), "turned": given.position.T, "words": np.array([["a", "b", "c"]] * 200),
    }  # fmt: skip
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    np.save(folder / "pickle.npy", np.array([{"x": 1}], dtype=object), allow_pickle=True)
    np.savez(folder / "names.npz", left=given.position, right=given.position)
    (folder / "short.ply").write_bytes(ply[:-500])
    (folder / "short.pcd").write_bytes(pcd[:-500])
    (folder / "empty.xyz").write_bytes(b"")
    (folder / "words.xyz").write_text("no numbers\nat all\n")
    (folder / "ragged.xyz").write_text("0 0 0\n1 1 1\n2 2\n")
    (folder / "head.pcd").write_bytes(pcd[:60])
    (folder / "field.pcd").write_bytes(pcd.replace(b"FIELDS x y z", b"FIELDS u v w"))
    return {name: (folder / name, what) for name, what in files.items()}


def test_what_is_no_cloud_is_refused_in_a_line(tmp_path: Path) -> None:
    """Broken, empty, nan, too few, in a plane: one line with the file and the value."""
    missed = []
    for path, what in broken_files(tmp_path).values():
        try:
            read_file(path)
            missed.append(f"{path.name}: read")
        except InputError as error:
            text = str(error)
            if "\n" in text or path.name not in text or not re.search(what, text):
                missed.append(f"{path.name}: {text}")
    assert not missed, "\n".join(missed)


def test_a_mesh_beside_points_is_taken(tmp_path: Path) -> None:
    """Of a folder the mesh counts, then splats, then points, of which one must be named."""
    write_npy(tmp_path / "labels.npy", cloud())
    assert find_mesh(tmp_path)[0].name == "labels.npy"
    (tmp_path / "room.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert find_mesh(tmp_path)[0].name == "room.obj"
    assert not has_no_faces(tmp_path)


def test_points_need_a_mesher(tmp_path: Path) -> None:
    """Where no surface is reconstructed, points are refused by name."""
    path = write_npy(tmp_path / "a.npy", cloud())
    with pytest.raises(InputError, match=r"a\.npy: a point cloud, not a mesh"):
        read_scan(path, SourceOptions(), Role.OBJECT)
