"""Promises of the embedded dataset."""

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dcap.evaluation.outcome_table import read_truth
from dcap.geometry.distance import MeshDistance
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.errors import InputError
from dcap.scene.readers.scenes.sugar import COMPRESSED_NAME, has_only_splats
from dcap.scene.readers.splats.splats import CHUNK, read_splats
from dcap.scene.types.outcome import Reason
from dcap.scene.writers.gaussians import morton_order
from dcap.synthetic.dataset import SPLAT_ROOMS, make_dataset
from dcap.synthetic.recipes import object_recipes, room_names
from dcap.synthetic.rooms import build_room
from flows.samples import EMBEDDED, TRUTH, load_yaml


def make_few(folder: Path) -> None:
    """Make one room and four objects, of every format and several parts."""
    make_dataset(folder, 0, rooms=["hall_01"], objects=["mug", "apple", "folded_towel", "dumbbell"])


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    make_few(folder)
    return folder


def test_every_sample_names_a_room_and_an_object_and_has_a_truth() -> None:
    """rooms.yaml and truth.yaml agree with each other and with the generator."""
    rows = load_yaml(EMBEDDED)
    assert isinstance(rows, list)
    truth = read_truth(load_yaml(EMBEDDED.with_name(TRUTH)), TRUTH)
    assert len(rows) >= 38
    assert {row["id"] for row in rows} == set(truth)
    assert {row["room"] for row in rows} == set(room_names())
    assert {row["object"] for row in rows} <= set(object_recipes())


def test_truth_lies_apart_from_what_stages_read(made: Path) -> None:
    """Nothing in rooms/ or objects/ tells instance or part of a face."""
    table = pq.read_table(made / "truth" / "hall_01.parquet")
    assert table.column_names == ["instance", "label", "part"]
    assert not [p for p in (made / "rooms").rglob("*") if p.suffix == ".parquet"]
    assert {p.name for p in (made / "objects").iterdir()} == {
        "mug.glb",
        "apple.obj",
        "folded_towel.ply",
        "dumbbell.glb",
    }


def test_second_run_writes_nothing_and_damage_is_mended(made: Path) -> None:
    """What is whole is kept; a damaged file is made again with the same bytes."""
    files = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in made.rglob("*") if p.is_file()}
    make_few(made)
    assert {p: p.stat().st_mtime_ns for p in files} == {p: stamp for p, (stamp, _) in files.items()}
    (made / "objects" / "mug.glb").write_bytes(b"broken")
    make_few(made)
    assert {p: p.read_bytes() for p in files} == {p: data for p, (_, data) in files.items()}


SPLATS = 4000


@pytest.fixture(scope="module")
def splat_room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with one room as splats, and no objects."""
    folder = tmp_path_factory.mktemp("splats")
    make_splats(folder, SPLATS)
    return folder


def make_splats(folder: Path, count: int) -> None:
    """Make one room, as a mesh and as splats."""
    make_dataset(folder, 0, rooms=["hall_01"], objects=[], splats=count)


def test_a_room_of_splats_is_the_same_room(splat_room: Path) -> None:
    """The annotations are the bytes of the room with a mesh, which it has none of; the splats lie on that mesh.

    Quantisation moves a splat by half a step of 1/1023 of its chunk's extent at most along each axis.
    """
    room, splats = splat_room / "rooms" / "hall_01", splat_room / SPLAT_ROOMS / "hall_01"
    notes = {"labels.json", "structure.json", "occupancy.json", "occupancy.png"}
    assert {path.name for path in splats.iterdir()} == notes | {COMPRESSED_NAME}
    assert all((room / name).read_bytes() == (splats / name).read_bytes() for name in notes)
    assert has_only_splats(splats)
    read, mesh = read_splats(splats / COMPRESSED_NAME), build_room("hall_01", 0).record.mesh
    assert len(read) == SPLATS
    chunks = np.arange(SPLATS) // CHUNK
    extent = np.stack([np.ptp(read.position[chunks == c], axis=0) for c in range(chunks[-1] + 1)])[chunks]
    off = MeshDistance(mesh).unsigned(read.position.astype(np.float64))
    assert (off <= np.linalg.norm(0.5 * extent / 1023, axis=1) + 1e-5).all()
    true = splats_on_mesh(mesh, float(np.sqrt(mesh.face_areas.sum() / SPLATS)), 0)
    true = true.subset(morton_order(true.position))
    assert (np.abs(read.position - true.position) <= 0.5 * extent / 1023 + 1e-5).all()
    assert np.abs(read.opacity - true.opacity).max() <= 0.5 / 255 + 1e-6


@pytest.mark.slow
def test_rooms_of_splats_are_made_once_with_the_same_bytes(splat_room: Path, tmp_path: Path) -> None:
    """Another run keeps them, another folder gets the same, and another number of splats makes them anew."""
    file = splat_room / SPLAT_ROOMS / "hall_01" / COMPRESSED_NAME
    before = file.stat().st_mtime_ns
    make_splats(splat_room, SPLATS)
    assert file.stat().st_mtime_ns == before
    make_splats(tmp_path, SPLATS)
    assert (tmp_path / file.relative_to(splat_room)).read_bytes() == file.read_bytes()
    make_splats(tmp_path, SPLATS // 2)
    assert len(read_splats(tmp_path / file.relative_to(splat_room))) == SPLATS // 2


def test_only_the_rooms_that_are_asked_for(splat_room: Path) -> None:
    """And a name that none has is refused with the nearest."""
    assert [path.name for path in (splat_room / "rooms").iterdir()] == ["hall_01"]
    with pytest.raises(InputError, match="'hall_1'; did you mean 'hall_01'"):
        make_dataset(splat_room, 0, rooms=["hall_1"])


@pytest.mark.slow
@pytest.mark.long
def test_intended_supports_are_in_the_rooms() -> None:
    """Every id in truth.yaml is that of an instance with that label in its sample's room, and the only such one."""
    rows = load_yaml(EMBEDDED)
    assert isinstance(rows, list)
    rooms = {sample["id"]: sample["room"] for sample in rows}
    truths = read_truth(load_yaml(EMBEDDED.with_name(TRUTH)), TRUTH)
    assert truths.keys() == rooms.keys()
    labels = {name: room_labels(name) for name in set(rooms.values())}
    for sample, truth in truths.items():
        alike = [key for key, label in labels[rooms[sample]].items() if label == truth.base]
        assert alike == [truth.base_id] if truth.base_id else len(alike) != 1, sample


def room_labels(name: str) -> dict[str, str]:
    """Label of every instance of a generated room by its id, in small letters as stages see it."""
    built = build_room(name, 0)
    return {key: label.lower() for key, label in zip(built.instance_ids, built.instance_labels, strict=True)}


def test_samples_exercise_what_is_promised() -> None:
    """At least six infeasible samples with four different reasons; feasible ones name their support."""
    truth = read_truth(load_yaml(EMBEDDED.with_name(TRUTH)), TRUTH)
    reasons = [t.reason for t in truth.values() if not t.feasible]
    assert len(reasons) >= 6
    assert len(set(reasons)) >= 4
    assert set(reasons) <= {r.value for r in Reason}
    assert all(t.base for t in truth.values() if t.feasible)
    assert all(not t.reason for t in truth.values() if t.feasible)
