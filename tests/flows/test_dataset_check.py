"""`dcap dataset check`: a dataset file line by line, exit codes, JSON and the plot."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from dcap.scene.errors import Severity
from dcap.synthetic.recipes import object_recipes, room_names
from flows.cli.app import main
from flows.dataset_check import as_tree, check_dataset, in_words, totals
from flows.samples import EMBEDDED, SPLAT_ROOMS, load_yaml

SQUARE = "v 0 0 0\nv 3 0 0\nv 3 3 0\nv 0 3 0\nf 1 2 3 4\n"
BOX = [{"x": x, "y": y, "z": z} for x in (0, 1) for y in (0, 2) for z in (0, 0.5)]


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder with one room of a bed and a door, and one object."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    room = tmp_path / "data" / "rooms" / "bedroom"
    room.mkdir(parents=True)
    (room / "scene.obj").write_text(SQUARE)
    beside = [{**corner, "x": corner["x"] + 1.5} for corner in BOX]
    entries = [{"label": "Bed", "ins_id": "1", "bounding_box": BOX}, {"label": "Door", "bounding_box": beside}]
    (room / "labels.json").write_text(json.dumps(entries, indent=1))
    structure = {"rooms": [{"profile": [[-1, -1], [4, -1], [4, 4], [-1, 4]]}]}
    (room / "structure.json").write_text(json.dumps(structure))
    (tmp_path / "data" / "objects").mkdir()
    (tmp_path / "data" / "objects" / "mug.obj").write_text(SQUARE)
    return tmp_path


def dataset(folder: Path, *rows: str) -> Path:
    """A dataset file."""
    (folder / "set.yaml").write_text("\n".join(rows) + "\n")
    return folder / "set.yaml"


GOOD = "- {id: a, room: bedroom, object: mug, prompt: put it}"


def test_every_mistake_of_a_dataset_file_is_told(data: Path) -> None:
    """Each key with its own line, samples after broken ones too, and names that nothing answers to."""
    rows = ["- id: a", "  room: bedrom", "  object: mug", "  promt: put it", "  mass: heavy", "- nothing",
            "- {id: b, room: bedroom, object: mug, prompt: x, up: x,", "   seed: -1}",
            "- {id: b, room: bedroom, object: mgu,", "   prompt: y}", GOOD, GOOD]  # fmt: skip
    report = check_dataset(dataset(data, *rows))
    told = [(one.line, one.what) for one in report.findings if one.severity is Severity.ERROR]
    expected = [
        (1, "key 'prompt' is missing"), (2, "room 'bedrom' is neither"),
        (4, "unknown key 'promt'; did you mean 'prompt'"), (5, "mass is 'heavy'"),
        (6, "expected keys and values"), (7, "up 'x' is not one of"), (8, "seed is -1"),
        (9, "object 'mgu' is neither next to the file nor in"), (12, "two samples have the id 'a'"),
    ]  # fmt: skip
    assert [line for line, _ in told] == [line for line, _ in expected], told
    assert all(words in what for (_, what), (_, words) in zip(told, expected, strict=True))
    assert "did you mean 'mug'" in told[7][1]


def test_the_scenes_and_objects_of_a_dataset_file_are_checked(data: Path) -> None:
    """Each once, with all of theirs."""
    (data / "data" / "objects" / "mug.obj").write_text("v 0 0 0\nf 1 2 3\n")
    report = check_dataset(dataset(data, GOOD, GOOD.replace("id: a", "id: b")))
    assert [(one.path.name, one.line) for one in report.findings if one.severity is Severity.ERROR] == [("mug.obj", 2)]
    (row,) = report.scenes
    assert (len(row.facts.labels), row.things, dict(row.kinds), row.facts.faces) == (2, 1, {"bed": 1}, 2)


def test_texts_that_are_trees_of_shared_parts_are_told(data: Path) -> None:
    """Written out each would have 9^40 words: they are told at their lines, and the check goes on."""
    tree = ["  id:", "    - &a0 lol", *(f"    - &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 41))]
    rows = [
        "-",
        *tree,
        "  room: *a40",
        "  object: *a40",
        "  prompt: *a40",
        "  mass: *a40",
        "  seed: *a40",
        "  up: *a40",
    ]
    told = [one for one in check_dataset(dataset(data, *rows, GOOD)).findings if one.severity is Severity.ERROR]
    assert {one.what.split(": ")[1].split(" is ")[0] for one in told} >= {"id", "room", "prompt", "mass", "seed", "up"}
    assert len({one.line for one in told}) == 7
    assert all(len(one.what) < 2_000 for one in told)


def test_outcomes_that_are_trees_of_shared_parts_are_told(data: Path) -> None:
    """As in the dataset file."""
    tree = ["  base:", "    - &a0 lol", *(f"    - &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 41))]
    for key in ("part", "top", "front", "feasible"):
        rows = ["x: *a40", "a:", f"  {key}: *a40"]
        (data / "truth.yaml").write_text("\n".join(["b:", *tree, *rows]) + "\n")
        told = [one for one in check_dataset(dataset(data, GOOD)).findings if one.severity is Severity.ERROR]
        assert [one.path.name for one in told] == ["truth.yaml"] * 3
        assert all(len(one.what) < 2_000 for one in told)


def test_a_name_that_no_file_can_have(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Too long for the file system: told like any that is not there."""
    assert main(["dataset", "check", str(data / ("a" * 300))]) == 2
    assert "no such file or folder" in capsys.readouterr().err
    (finding,) = check_dataset(dataset(data, GOOD.replace("bedroom", "b" * 300))).findings
    assert "is neither next to the file" in finding.what


def test_a_device_is_no_folder(capsys: pytest.CaptureFixture[str]) -> None:
    """It is told for what it is not, once."""
    assert main(["dataset", "check", "/dev/null"]) == 2
    assert "/dev/null: error: neither a file nor a folder" in capsys.readouterr().out


def test_scenes_that_cannot_be_read_are_no_scenes_without_supports(data: Path) -> None:
    """The share of scenes with a deformable support is that of the scenes whose instances are known."""
    rooms = data / "data" / "rooms"
    assert "1 scene, 1 (100 %)" in in_words(check_dataset(rooms))
    (rooms / "torn").mkdir()
    (rooms / "torn" / "labels.json").write_text("[")
    (rooms / "bed").mkdir()
    (rooms / "bed" / "bed.obj").write_text("f 1 2 3\n")
    report = check_dataset(rooms)
    assert "1 scene, 1 (100 %) with at least one; median 1, mean 1.0, 1 in all (2 unreadable, left out)" in in_words(
        report
    )
    found = totals(report)
    assert (found["scenes"], found["scenes_unreadable"], found["deformable_supports"]) == (3, 2, 1)


def test_intended_outcomes_are_checked(data: Path) -> None:
    """Unreadable ones, and those of samples that are not there."""
    (data / "truth.yaml").write_text("a: {base: bed}\nb: {base: bed}\nc:\n  tops: up\n")
    report = check_dataset(dataset(data, GOOD))
    told = [(one.path.name, one.line, one.severity) for one in report.findings if one.path.name == "truth.yaml"]
    assert told == [("truth.yaml", 2, "warning"), ("truth.yaml", 3, "error"), ("truth.yaml", 3, "warning")]


def test_an_embedded_dataset_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One line says how to make it, not one for each sample."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    assert main(["dataset", "check"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "make it with `dcap dataset make`" in captured.err


def test_exit_codes(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """0 with warnings, 2 with errors and where nothing is, and then one line on standard error only."""
    path = dataset(data, GOOD)
    assert main(["dataset", "check", str(path)]) == 0
    assert "0 errors" in capsys.readouterr().out
    (data / "data" / "rooms" / "bedroom" / "labels.json").write_text('[\n"bed"]')
    assert main(["dataset", "check", str(path), "--json"]) == 2
    tree = json.loads(capsys.readouterr().out)
    assert tree["errors"] == 1
    assert tree["findings"][0]["line"] == 2
    assert tree["totals"]["scenes"] == len(tree["scenes"]) == 1
    assert list(tree["totals"]) == [
        "scenes", "scenes_unreadable", "scenes_with_deformable_supports", "instances", "objects",
        "deformable_supports", "deformable_kinds", "faces", "splats", "object_meshes", "object_faces",
    ]  # fmt: skip
    assert main(["dataset", "check", str(data / "nothing")]) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n")) == ("", 1)


@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_the_plot_is_written(data: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Beside the report, in either form; another suffix is refused."""
    plot = data / "plots" / f"figure{suffix}"
    assert main(["dataset", "check", str(data / "data"), "--plot", str(plot)]) == 0
    if suffix == ".png":
        with Image.open(plot) as image:
            assert min(image.size) > 400
    else:
        assert "<svg" in plot.read_text()
    capsys.readouterr()
    assert main(["dataset", "check", str(data / "data"), "--plot", str(data / "figure.pdf")]) == 2
    captured = capsys.readouterr()
    assert ".pdf" in captured.err
    assert captured.out == ""  # refused before anything is checked


def test_a_mesh_by_itself_is_checked(data: Path) -> None:
    """It is named by its file."""
    report = check_dataset(data / "data" / "objects" / "mug.obj")
    assert [row.facts.labels for row in report.scenes] == [("mug",)]
    assert "mug.obj" in in_words(report)
    assert as_tree(report)["errors"] == 0


def test_the_tracked_dataset_of_splats_is_sound(data: Path) -> None:
    """Nothing but that its rooms are not generated is told; its samples are those of the rooms, in splat_rooms/."""
    for one in check_dataset(SPLAT_ROOMS).findings:
        assert "is neither next to the file" in one.what or one.severity is not Severity.ERROR, one
    rows, all_rows = load_yaml(SPLAT_ROOMS), load_yaml(EMBEDDED)
    assert isinstance(rows, list)
    assert isinstance(all_rows, list)
    known, objects = {row["id"]: row for row in all_rows}, object_recipes()
    for row in rows:
        assert row == known[row["id"]] | {"room": f"splat_rooms/{known[row['id']]['room']}"}
        assert known[row["id"]]["room"] in room_names()
        assert row["object"] in objects


@given(text=st.text() | st.recursive(
    st.sampled_from(["a", "- a", "id", "room: bedroom", "1", "null", "[a, b]", "{id: a}", "&x [*x]", "!!python/none"]),
    lambda inner: st.builds("{}: {}\n- {}".format, inner, inner, inner), max_leaves=5,
))  # fmt: skip
@settings(max_examples=60)
def test_fuzzed_dataset_files_never_end_a_check(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Any text: findings with a path, nothing raised."""
    path = tmp_path_factory.mktemp("fuzz") / "set.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    for one in check_dataset(path).findings:
        assert str(one).startswith(str(path))
        assert "\n" not in str(one)
