"""scene_settled.ply: written where the scene has Gaussians, one clear line where it has none."""

from pathlib import Path

import numpy as np
import pytest
from dented_bed import anchor, ball, scene_of, settled

from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.errors import InputError
from dcap.scene.readers.splats.splats import read_splats
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import Scan
from dcap.scene.writers.gaussians import write_compressed_splats, write_splats
from flows.extra_output import write_settled_splats
from flows.output import SETTLED_SPLATS, splat_artifact, splats_of
from flows.place import PlaceConfig
from flows.placement_json import Values
from flows.run_files import FinishedPlacement
from flows.sample_run import FinishedSample


@pytest.fixture(autouse=True)
def coarse(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Few discs on the object, and a store of the test's own."""
    monkeypatch.setattr("dcap.geometry.splatting.discs.DETAIL", 60.0)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


def values(rest: bool = True) -> Values:
    scene = scene_of()
    nodes = np.full(len(scene.mesh.faces), -1, dtype=np.int32)
    scan = Scan(scene.mesh, nodes, (), (), (), "", np.eye(4), "z", 1.0, "option", ())
    lost = None if rest else Infeasible(Reason.TOPPLED, "it fell over", None)
    return Values(scan, None, scene, ball(), None, anchor(), None, None, settled() if rest else None, None, lost)


def placed_in(scene: Path, folder: Path, *, rest: bool = True) -> FinishedPlacement:
    sample = Sample("ball in room", str(scene), "ball.glb", "put the ball on the bed")
    return FinishedPlacement(folder, FinishedSample(sample, None, ()), values(rest), PlaceConfig())  # type: ignore[arg-type]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    """A folder with compressed splats."""
    folder = tmp_path / "room"
    folder.mkdir()
    write_compressed_splats(folder / "3dgs_compressed.ply", splats_on_mesh(scene_of().mesh, 0.06, seed=0))
    return folder


def test_a_scene_of_splats_is_written(room: Path, tmp_path: Path) -> None:
    """On demand and beside the other files: the same bytes, and the scene's Gaussians first."""
    placement = placed_in(room, tmp_path)
    path = write_settled_splats(placement, tmp_path / "new" / "out")
    assert path == tmp_path / "new" / "out" / SETTLED_SPLATS
    assert list(path.parent.iterdir()) == [path]
    assert splat_artifact(placement.finished, placement.values, tmp_path) == {"splats": SETTLED_SPLATS}
    assert (tmp_path / SETTLED_SPLATS).read_bytes() == path.read_bytes()
    given, found = read_splats(room / "3dgs_compressed.ply"), read_splats(path)
    assert len(found) > len(given)
    far = np.abs(given.position[:, 0]) > 1.0
    assert np.array_equal(found.position[: len(given)][far], given.position[far])


def test_a_scene_without_gaussians_is_one_line(tmp_path: Path) -> None:
    """On demand; beside the other files there is nothing to say."""
    scene = tmp_path / "room.obj"
    scene.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    placement = placed_in(scene, tmp_path)
    assert splats_of(str(scene)) is None
    with pytest.raises(InputError, match="no Gaussian splats") as refused:
        write_settled_splats(placement, tmp_path / "out")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()
    assert splat_artifact(placement.finished, placement.values, tmp_path) == {}


def test_without_a_rest_state_there_is_nothing_to_write(room: Path, tmp_path: Path) -> None:
    placement = placed_in(room, tmp_path, rest=False)
    with pytest.raises(InputError, match="toppled"):
        write_settled_splats(placement, tmp_path / "out")
    assert splat_artifact(placement.finished, placement.values, tmp_path) == {}


def test_what_keeps_the_file_from_being_made_spoils_no_placement(
    room: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Splats beside a mesh, of another frame: refused on demand, told when placing."""
    moved = splats_on_mesh(scene_of().mesh, 0.06, seed=0).transformed(np.diag([3.0, 3.0, 3.0, 1.0]))
    write_splats(tmp_path / "other.ply", moved)
    placement = placed_in(tmp_path / "other.ply", tmp_path)
    with pytest.raises(InputError, match="not in its frame"):
        write_settled_splats(placement, tmp_path / "out")
    assert splat_artifact(placement.finished, placement.values, tmp_path) == {}
    assert "not in its frame" in caplog.text
    assert not (tmp_path / SETTLED_SPLATS).exists()
    (room / "second.ply").write_bytes((tmp_path / "other.ply").read_bytes())
    assert splats_of(str(room)) == room / "3dgs_compressed.ply"
    (room / "3dgs_compressed.ply").rename(room / "first.ply")
    assert splat_artifact(placed_in(room, tmp_path).finished, values(), tmp_path) == {}
    assert "name one" in caplog.text
