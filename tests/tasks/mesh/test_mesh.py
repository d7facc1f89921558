"""The mesh stage: light cleaning that loses no surface."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from point_files import points_on, without_normals, write_ply_points

from dcap.geometry.distance import MeshDistance
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.writers.gaussians import write_splats
from tasks.artifact import Source, Store
from tasks.mesh.stage import MeshConfig, mesh_object, mesh_scene, needs_process

SQUARE = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nv 0 1 0 1 0 0\n"


def read(tmp_path: Path, text: str) -> tuple[Mesh, tuple[str, ...]]:
    """The cleaned mesh of an OBJ text and its notes."""
    (tmp_path / "x.obj").write_text(text)
    scan = mesh_scene(Source(tmp_path / "x.obj"), SourceOptions(up="z", unit="m"), MeshConfig())
    assert len(scan.face_node) == len(scan.mesh.faces)
    return scan.mesh, scan.notes


def test_degenerate_and_repeated_faces_go(tmp_path: Path) -> None:
    """A face without area and a repeated one are dropped and counted; a face turned the other way stays."""
    result, notes = read(tmp_path, SQUARE + "f 1 2 3\nf 1 3 4\nf 2 3 1\nf 3 2 1\nf 1 2 2\n")
    assert len(result.faces) == 3
    assert result.face_areas.sum() == pytest.approx(1.5)
    assert any("2 of 5 faces" in note for note in notes)


def test_equal_vertices_are_welded_where_colours_agree(tmp_path: Path) -> None:
    """Doubled corners of one colour become one vertex; a border between two colours keeps both."""
    again = SQUARE.splitlines()[0] + "\n" + SQUARE.splitlines()[2] + "\n"
    same, _ = read(tmp_path, SQUARE + again + "f 1 2 3\nf 5 6 4\n")
    other, _ = read(tmp_path, SQUARE + again.replace("1 0 0\n", "0 0 1\n") + "f 1 2 3\nf 5 6 4\n")
    assert (len(same.vertices), len(other.vertices)) == (4, 6)


@pytest.mark.parametrize(
    ("given", "file", "label"),
    [
        ("green sofa/model.obj", "green sofa/model.obj", "green sofa"),
        ("green sofa/chair.obj", "green sofa/chair.obj", "chair"),
        ("my_mug", "my_mug/textured.obj", "my mug"),
        ("my_mug", "my_mug/cup.obj", "cup"),
        ("out", "out/refined_mesh/lamp/mesh.obj", "lamp"),
        ("out", "out/refined_mesh/kitchen/mesh.obj", ""),
    ],
)  # fmt: skip
def test_a_folder_names_a_mesh_whose_file_says_nothing(tmp_path: Path, given: str, file: str, label: str) -> None:
    """The label is the file's name, or its folder's where that is `model` or the like, through the store too; where
    that is no word for a thing there is none."""
    (tmp_path / file).parent.mkdir(parents=True)
    (tmp_path / file).write_text(SQUARE + "f 1 2 3\n")
    store = Store(tmp_path / "store")
    source = store.load(store.add_source(tmp_path / given))
    assert isinstance(source, Source)
    assert mesh_scene(source, SourceOptions(up="z", unit="m"), MeshConfig()).label == label


def test_a_mesh_of_slivers_is_refused(tmp_path: Path) -> None:
    """Nothing left after cleaning is bad input, and the line names the file."""
    with pytest.raises(InputError, match=r"x\.obj.*zero area"):
        read(tmp_path, "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    with pytest.raises(InputError, match=r"x\.obj.*zero area"):  # an area only before near vertices become one
        read(tmp_path, "v 0 0 0\nv 1 0 0\nv 1 1e-8 0\nf 1 2 3\n")


@pytest.mark.slow
def test_splats_alone_become_a_clean_mesh(tmp_path: Path) -> None:
    """A box of splats through the stage: closed but for what no camera sees, within a cell of the truth, and named as
    reconstructed; only such a source asks for a process."""
    box = trimesh.creation.box((1.0, 0.8, 0.5))
    true = Mesh.of(box.vertices + np.array([0, 0, 0.25]), box.faces)
    write_splats(tmp_path / "crate.ply", splats_on_mesh(true, 0.02, seed=0))
    source = Source(tmp_path / "crate.ply")
    config = MeshConfig(surface=SurfaceConfig(places=4, pixels=128, cell=0.02))
    scan = mesh_scene(source, SourceOptions(unit="m"), config)
    assert needs_process(source)
    away = MeshDistance(true).unsigned(scan.mesh.vertices)
    assert np.quantile(away, 0.95) < 0.02
    assert scan.mesh.face_areas.sum() == pytest.approx(true.face_areas.sum(), rel=0.1)
    assert "reconstructed from Gaussian splats" in " ".join(scan.notes)
    (tmp_path / "crate.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert not needs_process(Source(tmp_path / "crate.obj"))


@pytest.mark.slow
def test_points_become_a_clean_mesh(tmp_path: Path) -> None:
    """A box of points without normals through the stage: as an object closed, and told what was assumed."""
    solid = trimesh.creation.box((0.3, 0.2, 0.1))
    true = Mesh.of(solid.vertices + np.array([0, 0, 0.05]), solid.faces)
    path = write_ply_points(tmp_path / "brick.ply", without_normals(points_on(true, 6000)))
    source = Source(path)
    config = MeshConfig(surface=SurfaceConfig(places=4, pixels=128))
    scan = mesh_object(source, SourceOptions(), config)
    assert needs_process(source)
    assert scan.label == "brick"
    # 6000 points on 0.22 m^2 lie 6 mm apart
    assert np.quantile(MeshDistance(true).unsigned(scan.mesh.vertices), 0.95) < 0.006
    assert trimesh.Trimesh(scan.mesh.vertices, scan.mesh.faces, process=False).is_watertight
    told = " ".join(scan.notes)
    for what in (
        "reconstructed from a point cloud",
        "assuming metres",
        "taken as up",
        "no normals",
        "mm apart",
        "holes up to",
    ):
        assert what in told
