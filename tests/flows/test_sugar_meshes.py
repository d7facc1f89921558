"""SuGaR runs once for a scene that only has splats, and never for one with a mesh."""

import shutil
from pathlib import Path

import pytest
from fake_sugar import fake_sugar

from dcap.geometry.splatting.camera_path import PathConfig
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample, SourceOptions
from dcap.scene.writers.gaussians import write_compressed_splats
from dcap.scene.writers.interiorgs import MESH_NAME, write_interiorgs
from dcap.synthetic.rooms import build_room
from flows.prepare_sugar import GIVEN, OWN, SUGAR, mesh_source, with_sugar


@pytest.fixture(autouse=True)
def few_views(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three small pictures; a data folder of this test."""
    monkeypatch.setattr("flows.prepare_sugar.VIEWS", PathConfig(views=3, width=64, height=48))
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


@pytest.fixture
def scenes(tmp_path: Path) -> Path:
    """One room as a mesh, as splats, and as a file of splats without annotations."""
    built = build_room("hall_01", 0)
    folder = tmp_path / "scenes"
    write_interiorgs(folder / "meshed", built.record, 0)
    shutil.copytree(folder / "meshed", folder / "splats")
    (folder / "splats" / MESH_NAME).unlink()
    splats = splats_on_mesh(built.record.mesh, 0.06, seed=0)
    write_compressed_splats(folder / "splats" / "3dgs_compressed.ply", splats)
    shutil.copy(folder / "splats" / "3dgs_compressed.ply", folder / "bare.ply")
    return folder


def samples(folder: Path) -> dict[str, Sample]:
    """A sample in each scene."""
    return {name: Sample(name, str(folder / name), "ball.glb", "") for name in ("meshed", "splats", "bare.ply")}


@pytest.mark.slow
def test_each_scene_without_a_mesh_gets_one(scenes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In its folder, or next to what was prepared of a file, where unit and axis are stated; a second run does not run
    SuGaR again."""
    kinds = {name: mesh_source(scenes / name).kind for name in ("meshed", "splats", "bare.ply")}
    assert kinds == {"meshed": GIVEN, "splats": OWN, "bare.ply": OWN}
    sugar = tmp_path / "sugar"
    sugar.mkdir()
    monkeypatch.setenv("PATH", fake_sugar(sugar))
    made = with_sugar(samples(scenes), sugar, threads=0, quiet=True)
    assert {name: mesh_source(Path(one.scene)).kind for name, one in made.items()} == {
        "meshed": GIVEN, "splats": SUGAR, "bare.ply": SUGAR,
    }  # fmt: skip
    given = samples(scenes)
    assert made["meshed"] == given["meshed"]
    assert made["splats"] == given["splats"]  # annotations state metres and z up
    assert Path(made["bare.ply"].scene).name == "mesh"
    assert made["bare.ply"].scene_options == SourceOptions(up="z", unit="m")
    (sugar / "train.py").write_text("raise SystemExit('out of memory')")
    assert with_sugar(samples(scenes), sugar, threads=0, quiet=True) == made
    shutil.rmtree(scenes / "splats" / "output")
    with pytest.raises(InputError, match=r"SuGaR failed on .* out of memory; all it said: .*sugar\.log"):
        with_sugar(samples(scenes), sugar, threads=0, quiet=True)


def test_a_folder_without_sugar(tmp_path: Path) -> None:
    """Is refused before anything is rendered."""
    with pytest.raises(InputError, match=r"no train\.py there"):
        with_sugar({}, tmp_path, threads=0, quiet=True)
