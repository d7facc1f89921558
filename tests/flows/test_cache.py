"""The cache tells what it holds, keeps what a run needs, and gives up what nothing needs or what is damaged."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from known_records import known_result

from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import FileScale
from flows.cli.app import main
from flows.configure import LanguageOptions
from flows.output import RECORDS, records_json
from flows.place import PlaceConfig
from flows.run_files import write_request
from flows.sample_run import FinishedSample, StageResult
from tasks.artifact import Ref, Store
from tasks.records import find_record, records_root

OLD = time.time() - 5 * 86_400


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty data folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


def recorded(stage: str, number: float, *inputs: Ref[Any]) -> Ref[Any]:
    """What a stage has made out of other artifacts."""
    given = {f"input{index}": one for index, one in enumerate(inputs)}
    return known_result(stage, number, {**given, "number": number})


def record_of(ref: Ref[Any]) -> Path:
    """The file of its record."""
    assert ref.record is not None
    return records_root() / ref.record.key


def a_source(data: Path, text: str) -> Ref[Any]:
    """A foreign file in the store."""
    data.mkdir(parents=True, exist_ok=True)
    (data / "room.obj").write_text(text)
    return Store.default().add_source(data / "room.obj")


def a_run(data: Path, name: str, *results: Ref[Any]) -> Path:
    """The folder of a placement that is made of these results."""
    folder = data / "runs" / name
    folder.mkdir(parents=True)
    sample = Sample("one", "room.obj", "ball.obj", "put it down", mass=None)
    write_request(folder, sample, PlaceConfig(), LanguageOptions())
    rows = tuple(StageResult(one.record.recipe["stage"], one, False) for one in results if one.record)
    finished = FinishedSample(sample, None, rows)  # type: ignore[arg-type] # what was placed is not looked at
    (folder / RECORDS).write_text(json.dumps(records_json(finished)))
    return folder


def age(folder: Path) -> None:
    """Make everything in the cache old."""
    for path in folder.rglob("*"):
        os.utime(path, (OLD, OLD), follow_symlinks=False)


def told_by(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> Any:
    """What a command prints as JSON."""
    capsys.readouterr()
    assert main(["cache", *words, "--json"]) == code
    return json.loads(capsys.readouterr().out)


def held() -> set[Ref[Any]]:
    """The artifacts in the store."""
    return set(Store.default().refs())


def test_sizes_by_stage_count_what_is_shared_once(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rows add up to the bytes on disk: an artifact that two stages made counts for the first."""
    source = a_source(data, "v 0 0 0\n")
    recorded("mesh", 1.0, source)
    shared = recorded("segment", 1.0, source)
    loose = Store.default().save(FileScale(9.0, "nobody's"))
    rows = {row["stage"]: row for row in told_by(capsys, "du")["stages"]}
    assert (rows["mesh"]["artifacts"], rows["segment"]["artifacts"]) == (1, 0)
    assert rows["mesh"]["bytes"] == Store.default().size(shared)
    assert rows["without a record"]["bytes"] == Store.default().size(loose)
    assert (rows["source files"]["artifacts"], rows["records"]["records"]) == (1, 2)
    assert rows["mesh"]["seconds"] == 2.0
    objects = [path for path in (data / "cache" / "store").rglob("*") if path.is_file()]
    files = [*objects, *records_root().iterdir()]
    assert sum(row["bytes"] for row in rows.values()) == sum(path.stat().st_size for path in files)
    assert main(["cache", "du"]) == 0
    assert "segment" in capsys.readouterr().out


def test_what_a_placement_was_made_from_is_kept(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its records, their artifacts, inputs and sources stay, also those of a stage that it shares with another sample
    and does not name; all else goes."""
    source, other_source = a_source(data, "v 0 0 0\n"), a_source(data, "v 1 1 1\n")
    label = Store.default().save(FileScale(5.0, "given"))
    shared = recorded("plan", 0.5, a_source(data, "v 2 2 2\n"))
    mesh = recorded("mesh", 1.0, source, label)
    drop = recorded("drop", 2.0, mesh, shared)
    other = recorded("mesh", 3.0, other_source)
    a_run(data, "place", mesh, drop)
    age(data / "cache")
    before = held()
    dry = told_by(capsys, "gc")
    assert (dry["records"], dry["artifacts"], dry["deleted"]) == (1, 2, False)
    assert held() == before
    assert told_by(capsys, "gc", "--yes")["bytes"] == dry["bytes"]
    assert before - held() == {other, other_source}
    assert {path.name for path in records_root().iterdir()} == {record_of(one).name for one in (shared, mesh, drop)}
    assert told_by(capsys, "verify")["damaged"] == []
    assert told_by(capsys, "gc")["artifacts"] == 0


def test_what_is_young_is_left_with_what_it_was_made_from(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A day protects by default, whatever the age of its inputs; zero days protect nothing."""
    mesh = recorded("mesh", 1.0)
    old = recorded("mesh", 2.0)
    age(data / "cache")
    drop = recorded("drop", 3.0, mesh)
    told = told_by(capsys, "gc", "--yes")
    assert (told["artifacts"], told["young"]) == (1, 4)
    assert held() == {mesh, drop}
    assert old not in held()
    assert told_by(capsys, "gc", "--yes", "--older-than", "0")["artifacts"] == 2
    assert held() == set()
    assert list(records_root().iterdir()) == []


def test_a_placement_elsewhere_is_kept_if_it_is_named(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only the folder of runs is looked through without being told."""
    mesh = recorded("mesh", 1.0)
    os.rename(a_run(data, "place", mesh), tmp_path / "elsewhere")
    age(data / "cache")
    assert told_by(capsys, "gc", "--keep", str(tmp_path / "elsewhere"))["artifacts"] == 0
    assert told_by(capsys, "gc")["artifacts"] == 1
    assert main(["cache", "gc", "--keep", str(tmp_path / "nothing")]) == 2


def test_a_run_that_cannot_be_read_keeps_what_its_samples_name(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As one of a later version; it is told, and the rest is collected. One of an earlier version keeps nothing: no
    command can use it."""
    mesh, other = recorded("mesh", 1.0), recorded("mesh", 2.0)
    folder = a_run(data, "odd/samples/one", mesh)
    (folder / "sample.json").unlink()
    (data / "runs" / "odd" / "run.json").write_text("{")
    age(data / "cache")
    told = told_by(capsys, "gc", "--yes")
    assert str(data / "runs" / "odd") in told["unknown"][0]
    assert other not in held()
    assert mesh in held()
    (data / "runs" / "odd" / "run.json").write_text("{}")
    told = told_by(capsys, "gc", "--yes")
    assert "another version" in told["unknown"][0]
    assert told["runs"] == []
    assert mesh not in held()


@pytest.mark.slow
def test_nothing_is_deleted_under_a_running_program(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """While another program has the cache open, collecting is refused and names it; a dry run is not."""
    recorded("mesh", 1.0)
    age(data / "cache")
    program = "from tasks.artifact import Store; Store.default(); print('open', flush=True); input()"
    root = str(Path(__file__).parents[2])
    other = subprocess.Popen(
        [sys.executable, "-c", program], cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert other.stdout is not None
    assert other.stdout.readline() == "open\n"
    assert main(["cache", "gc", "--yes"]) == 2
    assert "in use by another program" in capsys.readouterr().err
    assert told_by(capsys, "gc")["artifacts"] == 1
    other.communicate("\n")
    assert told_by(capsys, "gc", "--yes")["artifacts"] == 1


def test_litter_of_killed_programs_is_collected(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Drafts, records cut short and idle locks go once they are old enough; fresh ones may be at work."""
    mesh = recorded("mesh", 1.0)
    a_run(data, "place", mesh)
    building = data / "cache" / "store" / "building"
    (building / "old").mkdir()
    (building / "old" / "mesh.ply").write_bytes(b"half")
    (records_root() / "drop-half").write_text("{")
    (data / "cache" / "locks").mkdir(exist_ok=True)
    (data / "cache" / "locks" / "drop-1.lock").touch()
    age(data / "cache")
    (building / "fresh").mkdir()
    assert told_by(capsys, "gc", "--yes")["litter"] == 2
    assert [path.name for path in building.iterdir()] == ["fresh"]
    assert list((data / "cache" / "locks").iterdir()) == []
    assert list(records_root().iterdir()) == [record_of(mesh)]
    assert held() == {mesh}


def test_damage_is_told_and_repaired(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 4 names what is damaged; a repair deletes it, leaves what is sound, and all is well afterwards."""
    sound, flipped, gone, swapped = (recorded("mesh", number) for number in (1.0, 2.0, 3.0, 4.0))
    store = Store.default()
    file = store.folder(flipped) / "value.json"
    file.write_bytes(b"x" + file.read_bytes()[1:])
    for path in store.folder(gone).iterdir():
        path.unlink()
    record_of(swapped).write_bytes(record_of(sound).read_bytes())
    (records_root() / "mesh-folder").mkdir()
    told = told_by(capsys, "verify", code=4)
    assert {"kind": "FileScale", "sha256": flipped.sha256} in told["damaged"]
    whys = {Path(row["path"]): row["why"] for row in told["damaged_records"]}
    assert whys.keys() == {*map(record_of, (flipped, gone, swapped)), records_root() / "mesh-folder"}
    assert record_of(sound).name in whys[record_of(swapped)]
    assert main(["cache", "verify"]) == 4
    assert str(record_of(swapped)) in capsys.readouterr().out
    assert told_by(capsys, "verify", "--repair")["repaired"]
    assert list(records_root().iterdir()) == [record_of(sound)]
    assert store.has(sound)
    told = told_by(capsys, "verify")
    assert (told["damaged"], told["damaged_records"]) == ([], [])


def test_a_repair_leaves_no_gap_before_a_sound_record(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A stage that was computed again beside damaged records is still cached once those have gone."""
    ref = recorded("mesh", 1.0)
    path = record_of(ref)
    os.rename(path, path.with_name(f"{path.name}-r2"))
    for name in (path.name, f"{path.name}-r1"):
        path.with_name(name).write_text("cut short")
    told_by(capsys, "verify", "--repair")
    assert find_record(path.name) == (path.name, ref)
