"""`dcap dataset prepare-sugar`: exactly what SuGaR takes, nothing half-written, and its meshes found afterwards."""

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from colmap_files import read_colmap
from fake_sugar import fake_sugar
from PIL import Image

from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.readers.scenes.sugar import find_mesh, has_only_splats
from dcap.scene.readers.splats.splats import read_splats
from dcap.scene.writers.gaussians import write_compressed_splats
from dcap.scene.writers.interiorgs import MESH_NAME, write_interiorgs
from dcap.synthetic.rooms import build_room
from flows.cli.app import main
from flows.prepare_sugar import publish


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An InteriorGS folder with splats and no mesh."""
    folder = tmp_path_factory.mktemp("scenes") / "a hall"
    built = build_room("hall_01", 0)
    write_interiorgs(folder, built.record, 0)
    (folder / MESH_NAME).unlink()
    write_compressed_splats(folder / "3dgs_compressed.ply", splats_on_mesh(built.record.mesh, 0.06, seed=0))
    return folder


def prepare(scene: Path, out: Path, *options: str) -> int:
    """Run the command for a few small pictures."""
    size = ["--views", "6", "--width", "64", "--height", "48"]
    return main(["dataset", "prepare-sugar", str(scene), "--out", str(out), *size, *options])


@pytest.fixture(scope="module")
def prepared(room: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "my hall"
    assert prepare(room, out) == 0
    return out


def files(folder: Path) -> dict[str, bytes]:
    """All files below a folder."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_everything_that_sugar_takes_is_there(prepared: Path, room: Path) -> None:
    """And nothing else: pictures alone in images/, one for each camera of cameras.json and of the COLMAP model."""
    pictures = [f"images/view_{k:05d}.png" for k in range(6)]
    assert set(files(prepared)) == {
        *pictures, "sparse/0/cameras.txt", "sparse/0/images.txt", "sparse/0/points3D.txt", "checkpoint/cameras.json",
        "checkpoint/point_cloud/iteration_7000/point_cloud.ply", "run_sugar.sh", "prepared.json",
    }  # fmt: skip
    for name in pictures:
        pixels = np.asarray(Image.open(prepared / name))
        assert pixels.shape == (48, 64, 3)
        assert pixels.std() > 2.0
        assert np.median(pixels) > 50  # a room by day, not the black behind it
    cameras = json.loads((prepared / "checkpoint" / "cameras.json").read_text())
    model = read_colmap(prepared / "sparse" / "0")
    assert [f"images/{c['img_name']}.png" for c in cameras] == pictures == [f"images/{i.name}" for i in model.images]
    for camera, image in zip(cameras, model.images, strict=True):
        assert set(camera) == {"id", "img_name", "width", "height", "position", "rotation", "fy", "fx"}
        assert image.position == pytest.approx(camera["position"])
        assert np.allclose(image.camera_from_world.T, camera["rotation"], rtol=0.0, atol=1e-12)
    cloud = read_splats(prepared / "checkpoint" / "point_cloud" / "iteration_7000" / "point_cloud.ply")
    splats = read_splats(room / "3dgs_compressed.ply")
    assert cloud.degree == 3
    assert np.array_equal(cloud.position, splats.position)
    assert not cloud.rest.any()
    assert len(model.points) == (splats.opacity > 0.5).sum()


def test_the_same_input_gives_the_same_bytes(prepared: Path, room: Path, tmp_path: Path) -> None:
    """But for the paths that it names, for any number of threads."""
    assert prepare(room, tmp_path / "other", "--threads", "1") == 0
    first, again = files(prepared), files(tmp_path / "other")
    assert first.keys() == again.keys()
    assert all(first[name] == again[name] for name in first if name not in ("run_sugar.sh", "prepared.json"))


@pytest.mark.slow
def test_a_second_run_replaces_the_first_and_keeps_the_rest(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Fewer views leave no old ones; what was put beside them stays; nothing temporary is left."""
    out = tmp_path / "out"
    assert prepare(room, out) == 0
    (out / "mesh").mkdir()
    (out / "mesh" / "a.txt").write_text("mine")
    capsys.readouterr()
    assert prepare(room, out, "--views", "2", "--seed", "3", "--json") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((out / "prepared.json").read_text())
    assert list(printed) == [
        "scene", "splats", "views", "points", "config", "world_from_file", "command", "then", "notes",
    ]  # fmt: skip
    assert (printed["views"], printed["config"]["seed"]) == (2, 3)
    assert len(list((out / "images").iterdir())) == 2
    assert (out / "mesh" / "a.txt").read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_meshes_of_sugar_are_found_in_the_scene(
    prepared: Path, room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Through run_sugar.sh, with a stand-in that reads and writes what SuGaR does; paths with spaces."""
    assert has_only_splats(room)
    path = fake_sugar(tmp_path)
    done = subprocess.run(
        ["sh", str(prepared / "run_sugar.sh"), str(tmp_path)], capture_output=True, text=True,
        env=os.environ | {"PATH": path},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    mesh, _ = find_mesh(room)
    assert mesh == room / "output" / "refined_mesh" / "my hall" / "sugarfine_x.obj"
    assert not has_only_splats(room)
    mesh.unlink()
    assert find_mesh(room)[0].read_text() == "coarse_mesh"
    record = json.loads((prepared / "prepared.json").read_text())
    assert record["then"] == f"dcap place '{room}' OBJECT \"PROMPT\""
    assert record["command"] in (prepared / "run_sugar.sh").read_text()
    assert f"-c '{prepared}/checkpoint/'" in record["command"]
    wrong = subprocess.run(["sh", str(prepared / "run_sugar.sh")], capture_output=True, text=True)
    assert wrong.returncode != 0
    assert "folder of SuGaR" in wrong.stderr


def test_a_file_of_splats_gets_a_folder_for_its_mesh(room: Path, tmp_path: Path) -> None:
    """Units and axes of the mesh are stated then, because no annotation does."""
    assert prepare(room / "3dgs_compressed.ply", tmp_path / "out", "--views", "3") == 0
    record = json.loads((tmp_path / "out" / "prepared.json").read_text())
    assert record["then"] == f'dcap place {tmp_path}/out/mesh OBJECT "PROMPT" --up z --unit m'


@pytest.mark.slow
def test_another_scene_does_not_replace_a_result(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The default folder has the scene's name, dots and all; of two scenes of one name the second is refused."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    small = ["--views", "1", "--width", "16", "--height", "16"]
    scenes = [tmp_path / "a" / "hall.1", tmp_path / "b" / "hall.1"]
    for scene in scenes:
        shutil.copytree(room, scene)
    assert main(["dataset", "prepare-sugar", str(scenes[0]), *small]) == 0
    (result,) = (tmp_path / "data").rglob("prepared.json")
    assert result.parent.name == "hall.1"
    before = files(tmp_path / "data")
    capsys.readouterr()
    assert main(["dataset", "prepare-sugar", str(scenes[1]), *small]) == 2
    said = capsys.readouterr().err
    assert all(words in said for words in (str(scenes[0]), str(scenes[1]), str(result.parent), "--out"))
    assert files(tmp_path / "data") == before


@pytest.mark.parametrize("failing", [1, 2, 3, 4])
@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
def test_what_ends_a_replacement_leaves_the_old_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: int, kind: type[BaseException]
) -> None:
    """At any of its steps (aside, in place, two entries of others): nothing is lost, nothing is left over."""
    out, draft = tmp_path / "out", tmp_path / "draft"
    for folder, text in ((out, "old"), (draft, "new")):
        folder.mkdir()
        (folder / "prepared.json").write_text(text)
    for name in ("mesh", "notes"):
        (out / name).mkdir()
        (out / name / "a.txt").write_text("mine")
    before, steps, replace = files(out), iter(range(1, 100)), os.replace

    def failing_replace(source: Path, target: Path) -> None:
        if next(steps) == failing:
            raise kind(5, "broken")
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing_replace)
    with pytest.raises(kind):
        publish(draft, out)
    assert files(out) == before
    assert {p.name for p in tmp_path.iterdir()} <= {"out", "draft"}
    monkeypatch.undo()
    if draft.is_dir():
        publish(draft, out)
        assert files(out) == before | {"prepared.json": b"new"}


def refused(capsys: pytest.CaptureFixture[str], scene: Path, out: Path) -> str:
    """What the command says in its one line."""
    capsys.readouterr()
    before = set(out.rglob("*"))
    assert prepare(scene, out) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("dcap: ")
    assert captured.err.count("\n") == 1
    assert set(out.rglob("*")) == before
    return captured.err


def test_what_cannot_be_prepared(capsys: pytest.CaptureFixture[str], room: Path, tmp_path: Path) -> None:
    """One line with the path and what to do; nothing is written."""
    empty = tmp_path / "empty"
    empty.mkdir()
    said = refused(capsys, empty, tmp_path / "out")
    assert f"{empty}: no Gaussian splats" in said
    assert "3dgs_compressed.ply" in said
    assert "no such file" in refused(capsys, tmp_path / "gone", tmp_path / "out")
    (empty / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert "no Gaussian splats" in refused(capsys, empty, tmp_path / "out")
    assert "a mesh, not Gaussian splats" in refused(capsys, empty / "a.obj", tmp_path / "out")
    assert "not empty and not made by prepare-sugar" in refused(capsys, room, empty)
    assert "lies in the scene" in refused(capsys, room, room / "sugar")
    assert "is a file" in refused(capsys, room, empty / "a.obj")
    assert not (tmp_path / "out").exists()
