"""`dcap dataset sample` writes a data set that can be read, the same for the same seed, or nothing."""

import json
from pathlib import Path
from typing import Any

import pytest
from fake_api import FakeApi, offline_model, question_of, reason_of, says
from tiny_rooms import write_tiny_objects, write_tiny_rooms

from dcap.evaluation.outcome_table import read_truth
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from flows.cli.app import main
from flows.samples import load_samples, load_yaml
from flows.selection import of_scenes

pytestmark = pytest.mark.usefixtures("data")


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


def sampled(folder: Path, out: str, *more: str) -> int:
    arguments = ["dataset", "sample", str(folder / "rooms"), "--objects", str(folder / "objects"), "--per-scene", "4"]
    return main([*arguments, "--out", str(folder / out / "samples.yaml"), *more])


def files(folder: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in sorted(folder.iterdir())}


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    capsys.readouterr()
    assert main(["dataset", "sample", *arguments]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.count("\n") == 1
    return told.err


@pytest.mark.slow
@pytest.mark.long
def test_a_data_set_of_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Samples, truth, splits and figure 3 are written; a second run writes the same bytes; fewer scenes give the same
    samples for each; a scene that cannot be read is refused, and left out with `--skip`."""
    write_tiny_rooms(tmp_path / "rooms", 3)
    write_tiny_objects(tmp_path / "objects")
    assert sampled(tmp_path, "first", "--splits", "train=0.67,test=0.33", "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert (made["scenes"], made["samples"], made["splits"]) == (3, 12, {"train": 2, "test": 1})
    assert made["read_back"] >= 0.95 * made["samples"]
    first = files(tmp_path / "first")
    assert set(first) == {"samples.yaml", "truth.yaml", "train.txt", "test.txt", "supports.csv", "supports.png"}
    samples = load_samples(tmp_path / "first" / "samples.yaml")
    truths = read_truth(load_yaml(tmp_path / "first" / "truth.yaml"), "truth")
    assert set(truths) == {one.id for one in samples}
    assert all(Path(one.scene).is_file() and Path(one.object).is_file() for one in samples)
    test = of_scenes(samples, "test", tmp_path / "first")
    assert len(test) == 4
    assert sampled(tmp_path, "again", "--splits", "train=0.67,test=0.33") == 0
    assert files(tmp_path / "again") == first

    assert sampled(tmp_path, "one", "--scenes", "room_001") == 0
    alone = load_samples(tmp_path / "one" / "samples.yaml")
    assert alone == [one for one in samples if "room_001" in one.scene]

    (tmp_path / "rooms" / "room_009.glb").write_bytes(b"no mesh")
    capsys.readouterr()
    assert sampled(tmp_path, "bad") == 2
    told = capsys.readouterr().err
    assert "room_009" in told
    assert told.count("\n") == 1
    assert not (tmp_path / "bad").exists()
    assert sampled(tmp_path, "bad", "--skip") == 0
    assert "left out: room_009" in capsys.readouterr().err
    assert (tmp_path / "bad" / "samples.yaml").read_bytes() == first["samples.yaml"]


@pytest.mark.long
@pytest.mark.slow
def test_a_model_writes_the_sentences(tmp_path: Path, capsys: pytest.CaptureFixture[str], api: FakeApi) -> None:
    """A reply that does not hold of the scene goes back with the reason; a recording gives the same data set."""
    write_tiny_rooms(tmp_path / "rooms", 1)
    write_tiny_objects(tmp_path / "objects")
    wrong = {
        "samples": [{"object": "mug", "prompt": f"Put {n} mugs on the moon.", "base_id": "moon"} for n in range(4)]
    }
    refusals: list[bool] = []

    def model(body: dict[str, Any]) -> tuple[int, dict[str, Any]]:
        if question_of(body) == "samples" and not refusals:
            refusals.append(True)
            return says(wrong)(body)
        return offline_model(body)

    api.answers = [model]
    assert sampled(tmp_path, "asked", "--language", "anthropic", "--record", str(tmp_path / "replies")) == 0
    assert "base_id 'moon' is not listed" in reason_of(api.asked[-1])
    count = len(api.asked)
    assert sampled(tmp_path, "replayed", "--replay", str(tmp_path / "replies")) == 0
    assert len(api.asked) == count
    first, again = (files(tmp_path / name) for name in ("asked", "replayed"))
    assert {name: first[name] for name in again if name.endswith("yaml")} == {
        name: again[name] for name in again if name.endswith("yaml")
    }


def test_bad_inputs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each is one line with exit code 2, and nothing is written."""
    write_tiny_rooms(tmp_path / "rooms", 1)
    objects = str(write_tiny_objects(tmp_path / "objects")[0].parent)
    (tmp_path / "empty").mkdir()
    rooms, empty, out = str(tmp_path / "rooms"), str(tmp_path / "empty"), str(tmp_path / "out" / "samples.yaml")
    ends = ("--per-scene", "2", "--out", out)
    assert "no scene in this folder" in refused(capsys, empty, "--objects", objects, *ends)
    assert "no mesh there" in refused(capsys, rooms, "--objects", empty, *ends)
    assert "no such file" in refused(capsys, rooms, "--objects", "nowhere", *ends)
    assert "no such file" in refused(capsys, "nowhere", "--objects", objects, *ends)
    assert "--per-scene 0" in refused(capsys, rooms, "--objects", objects, "--per-scene", "0", "--out", out)
    assert "--infeasible 1" in refused(capsys, rooms, "--objects", objects, *ends, "--infeasible", "1")
    assert "--splits" in refused(capsys, rooms, "--objects", objects, *ends, "--splits", "train")
    assert "no scene is named 'kitchen'" in refused(capsys, rooms, "--objects", objects, *ends, "--scenes", "kitchen")
    assert not (tmp_path / "out").exists()


def test_the_truth_of_another_data_set_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A file beside which another truth lies is refused."""
    write_tiny_rooms(tmp_path / "rooms", 1)
    objects = str(write_tiny_objects(tmp_path / "objects")[0].parent)
    (tmp_path / "truth.yaml").write_text("mine: {base: bed}\n")
    ends = ("--objects", objects, "--per-scene", "2", "--out", str(tmp_path / "samples.yaml"))
    assert "truth of another data set (mine)" in refused(capsys, str(tmp_path / "rooms"), *ends)
    assert "a YAML file" in refused(capsys, str(tmp_path / "rooms"), *ends[:-1], str(tmp_path / "x.json"))


def test_a_split_is_not_what_has_its_names_elsewhere(tmp_path: Path) -> None:
    """`kitchen` of a split is the scene at the top, not that of another house, which another split has; where no scene
    is there, the end of a path will do, and a folder's name has no suffix."""
    scenes = ["kitchen.glb", "house_2/kitchen.glb", "room.1"]
    samples = [Sample(one, str(tmp_path / one), "mug.glb", "Put it there.") for one in scenes]
    assert [one.id for one in of_scenes(samples, "kitchen", tmp_path)] == ["kitchen.glb"]
    assert [one.id for one in of_scenes(samples, "house_2/kitchen", tmp_path)] == ["house_2/kitchen.glb"]
    assert [one.id for one in of_scenes(samples[1:], "kitchen", tmp_path)] == ["house_2/kitchen.glb"]
    with pytest.raises(InputError, match="no scene is named 'room'"):
        of_scenes(samples, "room", tmp_path)


def test_where_no_name_is_near_the_scenes_are_listed(tmp_path: Path) -> None:
    """The first ones, and how many more there are; of one that is near, that alone."""
    rooms = [f"bedroom_0{number}" for number in range(1, 8)]
    samples = [Sample(one, str(tmp_path / f"{one}.glb"), "mug.glb", "Put it there.") for one in rooms]
    with pytest.raises(InputError) as told:
        of_scenes(samples, "nosuch", tmp_path)
    first = "bedroom_01, bedroom_02, bedroom_03, bedroom_04, bedroom_05"
    assert str(told.value) == f"--scenes: no scene is named 'nosuch'; there are {first} and 2 more"
    with pytest.raises(InputError, match=r"'bedrom_07'; did you mean 'bedroom_07'\?$"):
        of_scenes(samples, "bedrom_07", tmp_path)
    with pytest.raises(InputError, match=r"'nosuch'; there are bedroom_01, bedroom_02$"):
        of_scenes(samples[:2], "nosuch", tmp_path)


def test_scenes_by_name(tmp_path: Path) -> None:
    """Names, a file of names, and a split beside the data set choose samples; an unknown name is refused."""
    write_tiny_rooms(tmp_path / "rooms", 2)
    rows = [f"- {{id: s{n}, scene: rooms/room_00{n}.glb, object: mug, prompt: Put it there.}}" for n in (0, 1)]
    (tmp_path / "set.yaml").write_text("\n".join(rows) + "\n")
    (tmp_path / "val.txt").write_text("# a remark\nrooms/room_001\n")
    samples = load_samples(tmp_path / "set.yaml")
    assert [one.id for one in of_scenes(samples, "", tmp_path)] == ["s0", "s1"]
    assert [one.id for one in of_scenes(samples, "room_000", tmp_path)] == ["s0"]
    assert [one.id for one in of_scenes(samples, "val", tmp_path)] == ["s1"]
    assert [one.id for one in of_scenes(samples, str(tmp_path / "val.txt"), tmp_path.parent)] == ["s1"]
    with pytest.raises(InputError, match="no scene is named 'room_003'"):
        of_scenes(samples, "room_003", tmp_path)
    with pytest.raises(InputError, match="names no scene"):
        of_scenes(samples, " , ", tmp_path)
