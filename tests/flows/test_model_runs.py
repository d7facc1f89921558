"""A whole run with a model: asked at once or in batches, recorded, replayed with nobody to ask, stopped by its budget.

The model is a stand-in on the loopback interface.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import trimesh
from fake_api import KEY, FakeApi, fails, question_of, self_willed

from dcap.language.model.reply_folder import ReplyFolder
from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT
from flows.configure import LanguageOptions
from flows.output import RECORDS

DATASET = """
- {id: lacks, scene: room.glb, object: cube.stl, prompt: put the steel cube on the piano}
- {id: rests, scene: room.glb, object: cube.stl, prompt: put the steel cube on the table}
"""
TIMINGS = re.compile(rb'"timings": \{[^}]*\}')
"""How long the stages took: what alone may differ between two runs."""


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, api: FakeApi) -> Path:
    """A table on a floor, a cube, and two sentences."""
    scene = trimesh.Scene()
    table = trimesh.creation.box(bounds=[(-0.4, 0.0, -0.3), (0.4, 0.7, 0.3)])
    floor = trimesh.creation.box(bounds=[(-1.5, -0.02, -1.5), (1.5, 0.0, 1.5)])
    for name, mesh in (("table", table), ("floor", floor)):
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    scene.export(tmp_path / "room.glb")
    trimesh.creation.box(extents=(0.06, 0.06, 0.06)).export(tmp_path / "cube.stl")
    (tmp_path / "set.yaml").write_text(DATASET)
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    return tmp_path / "set.yaml"


def run(dataset: Path, *options: str, expected: int = 0) -> Path:
    """The folder of a benchmark run in a process of its own."""
    return dcap(dataset, "benchmark", "--dataset", str(dataset), *options, expected=expected)


def dcap(dataset: Path, *words: str, expected: int = 0) -> Path:
    """The folder of the last run after a command in a process of its own."""
    command = [sys.executable, "-m", "flows.cli", *words]
    environment = os.environ | {"PYTHONPATH": str(PROJECT_ROOT)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == expected, done.stderr
    (dataset.parent / "told.log").open("a").write(done.stdout + done.stderr)
    return (Path(os.environ["DCAP_DATA"]) / "runs" / "last").resolve()


def contents(folder: Path) -> dict[str, object]:
    """The bytes of the samples' files, without how long it took and the keys of records, which differ by who was asked,
    and the rows of the table."""
    found: dict[str, object] = {
        str(path.relative_to(folder)): TIMINGS.sub(b"", path.read_bytes())
        for path in sorted((folder / "samples").rglob("*"))
        if path.is_file() and path.name != RECORDS
    }
    rows = pq.read_table(folder / "results.parquet").drop(["seconds"])
    return found | {"results.parquet": rows.to_pylist()}


@pytest.mark.slow
@pytest.mark.long
def test_a_recorded_run_replays_to_the_same_bytes(dataset: Path, api: FakeApi, monkeypatch: pytest.MonkeyPatch) -> None:
    """Asked at once, in batches, or replayed with no server and no key: the same files. The key is nowhere."""
    recording = dataset.parent / "recording"
    asking = ("--language", "anthropic", "--max-cost", "5")
    first = run(dataset, *asking, "--record", str(recording))
    spent = json.loads((first / "summary.json").read_text())["language"]
    assert spent["asked"] == len(api.asked) > 4
    assert spent["usd"] == pytest.approx(len(api.asked) * (1000 * 2 + 100 * 10) / 1e6)
    assert f"{spent['asked']} replies asked for" in (first / "report.html").read_text()
    assert set(contents(first)) >= {
        "samples/rests/object.ply",
        "samples/rests/closeup.png",
        "samples/lacks/placement.json",
    }

    in_batches = run(dataset, *asking, "--batch", "--model", "claude-opus-5-5")
    assert contents(in_batches) == contents(first)
    assert json.loads((in_batches / "summary.json").read_text())["language"]["batch"] == spent["asked"]
    assert api.batches

    for name in ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    asked = len(api.asked)
    monkeypatch.setenv("DCAP_DATA", str(dataset.parent / "elsewhere"))  # nothing is known there
    replayed = run(dataset, "--replay", str(recording))
    assert contents(replayed) == contents(first)
    assert len(api.asked) == asked

    files = [path for path in dataset.parent.rglob("*") if path.is_file()]
    assert len(files) > 50
    assert not [path for path in files if KEY.encode() in path.read_bytes()]


@pytest.mark.long
@pytest.mark.slow
def test_a_spent_budget_stops_in_a_line(dataset: Path, api: FakeApi) -> None:
    """Nothing is asked that may exceed the budget; the samples say so, and a larger budget goes on from there."""
    asking = ("--language", "anthropic")
    stopped = run(dataset, *asking, "--limit", "1", "--max-cost", "0.01", expected=4)
    assert not api.asked
    assert (
        (stopped / "samples" / "lacks" / "error.txt")
        .read_text()
        .startswith("--max-cost 0.01 USD: 0.0000 USD are spent")
    )
    gone_on = run(dataset, *asking, "--limit", "1", "--max-cost", "5", "--only-failed")
    assert len(json.loads((gone_on / "run.json").read_text())["samples"]) == 1


@pytest.mark.long
@pytest.mark.slow
def test_a_rerun_asks_again_and_keeps_what_it_hears(dataset: Path, api: FakeApi) -> None:
    """The stage's question goes out although a reply is kept; later runs and the recording have the new one alone."""
    recording = dataset.parent / "recording"
    asking = ("--language", "anthropic", "--limit", "1", "--record", str(recording))
    first = run(dataset, *asking)
    assert dcap(dataset, "rerun", "last", "lacks", "--stage", "intent", "--max-cost", "nan", expected=2) == first
    assert "piano" in outcome(first)["message"]
    asked = [question_of(body) for body in api.asked]
    assert any('\\"missing\\":\\"the piano' in path.read_text() for path in recording.rglob("*.json"))
    api.answers = [self_willed(intent={"missing": "a harpsichord"})]
    assert dcap(dataset, "rerun", "last", "lacks", "--stage", "intent", expected=3) == first
    assert "harpsichord" in outcome(first)["message"]
    assert "harpsichord" in (first / "report.html").read_text()
    assert [question_of(body) for body in api.asked] == [*asked, "intent"]
    assert json.loads((first / "summary.json").read_text())["language"]["asked"] == len(asked) + 1

    said = (first / "run.json").read_text()
    tree = json.loads(said)
    tree["language"]["max_cost"] = 0.001
    (first / "run.json").write_text(json.dumps(tree))
    # without a limit of its own it has that of its run
    assert dcap(dataset, "rerun", "last", "lacks", "--stage", "intent", expected=2) == first
    (first / "run.json").write_text(said)
    assert len(api.asked) == len(asked) + 1

    api.answers = [fails(500, "nobody_may_ask")]
    later = run(dataset, *asking)
    assert later != first
    assert outcome(later)["message"] == outcome(first)["message"]
    assert len(api.asked) == len(asked) + 1
    for folder in (recording, dataset.parent / "data" / "replies"):
        replies = [path.read_text() for path in folder.rglob("*.json")]
        assert any("harpsichord" in text for text in replies)
        assert not any('\\"missing\\":\\"the piano' in text for text in replies)


def outcome(folder: Path) -> dict[str, str]:
    """What became of the sample that lacks its base."""
    return dict(json.loads((folder / "samples" / "lacks" / "placement.json").read_text()))


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (LanguageOptions("oracle"), "oracle"),
        (LanguageOptions("replay"), "--replay DIR"),
        (LanguageOptions("anthropic", replay="x"), "--language replay"),
        (LanguageOptions(record="x"), "--record"),
        (LanguageOptions(batch=True), "--batch"),
        (LanguageOptions(model="m"), "--model"),
        (LanguageOptions(replay="nowhere"), "no recorded replies"),
        (LanguageOptions("anthropic", "someone-else", max_cost=1.0), "price of someone-else"),
        (LanguageOptions("anthropic", max_cost=-1.0), "--max-cost -1.0"),
        (LanguageOptions("anthropic", record="/proc/nobody"), "--record /proc/nobody"),
        (LanguageOptions("anthropic", "../elsewhere"), "--model '../elsewhere'"),
    ],
)
def test_options_that_cannot_be_meant_are_named(options: LanguageOptions, word: str) -> None:
    """One line that names the option."""
    with pytest.raises(InputError, match=word) as error:
        options.config()
    assert "\n" not in str(error.value)


def test_a_damaged_recording_and_a_plan_s(tmp_path: Path) -> None:
    """A mark that is none is named; a plan begins no recording, and one that is begun has its name."""
    asking = LanguageOptions("anthropic", record=str(tmp_path / "r"))
    assert asking.config(plan=True).recording == "to be begun"
    assert not (tmp_path / "r").exists()
    assert asking.config().recording == asking.config(plan=True).recording
    (tmp_path / "r" / "recording.json").write_text("{")
    with pytest.raises(InputError, match=r"recording\.json is damaged"):
        asking.config()


def test_a_recording_of_two_models_needs_a_choice(tmp_path: Path) -> None:
    """Its only model is taken; of two one must be chosen."""
    folder = ReplyFolder(tmp_path)
    folder.write("one", "ab" * 32, {}, {})
    assert LanguageOptions(replay=str(tmp_path)).config().model == "one"
    folder.write("two", "ab" * 32, {}, {})
    with pytest.raises(InputError, match="one, two; choose"):
        LanguageOptions(replay=str(tmp_path)).config()
    assert LanguageOptions(model="two", replay=str(tmp_path)).config().model == "two"
    with pytest.raises(InputError, match="none of --model three"):
        LanguageOptions(model="three", replay=str(tmp_path)).config()
