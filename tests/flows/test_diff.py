"""`dcap diff` reads runs and folders of placements, whole or not, and says in a line what it cannot read."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dcap.evaluation.outcome_table import row_of
from dcap.scene.types.sample import Sample
from flows.benchmark import new_run_folder
from flows.cli.app import main
from flows.configure import LanguageOptions
from flows.find_run import ASKED_VERSION
from flows.judge_run import write_rows
from flows.place import PlaceConfig
from flows.run_files import write_request

VERSION = f'{{"version": {ASKED_VERSION}'
ONE = Sample("one", "room.glb", "ball.obj", "put it there")
TWO = replace(ONE, id="two")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder of each test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    return tmp_path


def placed(x: float = 0.0, mass: float = 1.0, took: float = 1.0) -> dict[str, Any]:
    """The keys of placement.json that count."""
    return {
        "verdict": "at_rest", "reason": None, "base": {"id": "1", "label": "bed"}, "part": "top", "mass": mass,
        "scale": 1.0, "visible_fraction": 0.5, "timings": {"drop": took},
        "pose": {"position": [x, 0.0, 0.5], "quaternion": [1.0, 0.0, 0.0, 0.0]},
    }  # fmt: skip


def run_of(config: PlaceConfig, trees: dict[Sample, dict[str, Any] | None], *, ended: bool = True) -> str:
    """A run as a benchmark leaves it, with or without its table."""
    run = new_run_folder(Path("set.yaml"), list(trees), config, LanguageOptions())
    for sample, tree in trees.items():
        folder = run / "samples" / sample.id
        folder.mkdir(parents=True)
        if tree is not None:
            (folder / "placement.json").write_text(json.dumps(tree))
    if ended:
        write_rows(run, [row_of(sample, tree, "no surface", None) for sample, tree in trees.items()])
    return run.name


def compared(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """What the command says as JSON."""
    assert main(["diff", *words, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_same_results_in_other_times_are_no_difference(capsys: pytest.CaptureFixture[str]) -> None:
    """Times and threads may differ; they are shown when asked for."""
    threads = PlaceConfig().drop.model_copy(update={"threads": 7})
    first = run_of(PlaceConfig(), {ONE: placed(took=1.0)})
    second = run_of(PlaceConfig().model_copy(update={"drop": threads}), {ONE: placed(took=3.0)})
    assert main(["diff", first, second]) == 0
    assert "no difference" in capsys.readouterr().out
    assert "times" not in compared(capsys, first, "last")
    times = {one["metric"]: one["difference"] for one in compared(capsys, first, "last", "--times")["times"]}
    assert times == {"drop": 2.0, "total": 2.0}


@pytest.mark.parametrize("ended", [True, False])
def test_everything_that_differs_is_told(capsys: pytest.CaptureFixture[str], *, ended: bool) -> None:
    """Verdict, pose, a number, the sentence and a setting, whether or not the second run has its table."""
    first = run_of(PlaceConfig(), {ONE: placed(), TWO: placed()})
    render = PlaceConfig().render.model_copy(update={"size": 512})
    asked = replace(ONE, prompt="put it here")
    second = run_of(
        PlaceConfig().model_copy(update={"render": render}), {asked: placed(x=0.25, mass=2.0), TWO: None}, ended=ended
    )
    found = compared(capsys, first, second)
    assert not found["equal"]
    verdicts = [one for one in found["outcomes"] if one["key"] == "verdict"]
    assert verdicts == [{"sample": "two", "key": "verdict", "a": "at_rest", "b": "failed"}]
    assert found["poses"] == [{"sample": "one", "position_m": 0.25, "angle_deg": 0.0}]
    mass = [one for one in found["metrics"] if (one["sample"], one["metric"]) == ("one", "mass")]
    assert [(one["difference"], one["relative"]) for one in mass] == [(1.0, 0.5)]
    assert found["asked"] == [{"sample": "one", "key": "prompt", "a": "put it there", "b": "put it here"}]
    assert found["config"] == [{"key": "render.size", "a": 1024, "b": 512}]
    assert main(["diff", first, second]) == 0
    text = capsys.readouterr().out
    assert "render.size  1024  512" in text


def test_two_placements_are_compared_whatever_their_files_are_called(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Folders that `place` wrote have one sample each."""
    for name, thing, x in (("a", "ball.obj", 0.0), ("b", "cup.obj", 0.1)):
        (data / name).mkdir()
        (data / name / "placement.json").write_text(json.dumps(placed(x=x)))
        sample = replace(ONE, id=f"{thing} in room", object=thing)
        write_request(data / name, sample, PlaceConfig(), LanguageOptions())
    found = compared(capsys, str(data / "a"), str(data / "b"))
    assert (found["only_a"], found["only_b"], found["config"]) == ([], [], [])
    assert [one["position_m"] for one in found["poses"]] == [0.1]
    assert [(one["key"], one["a"], one["b"]) for one in found["asked"]] == [("object", "ball.obj", "cup.obj")]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("run.json", "{", "run.json: broken JSON"),
        ("run.json", VERSION + "}", "run.json: the file is damaged"),
        ("run.json", VERSION + ', "samples": [{"id": "one"}]}', "run.json: the file is damaged"),
        ("run.json", VERSION + ', "samples": [], "config": [1]}', "run.json: config: "),
        ("run.json", VERSION + ', "samples": [], "methods": [[1]]}', "run.json: methods.0: "),
        ("results.parquet", "no table", "results.parquet: cannot be read"),
        ("samples/one/placement.json", "[1]", "placement.json: the file is damaged"),
        ("samples/one/placement.json", '{"pose": {}}', "placement.json: the file is damaged"),
    ],
)
def test_a_damaged_run_is_one_line(
    data: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, words: str
) -> None:
    """Exit 2 and the file."""
    run = run_of(PlaceConfig(), {ONE: placed()})
    (data / "runs" / run / name).write_text(text)
    if name == "run.json":
        (data / "runs" / run / "results.parquet").unlink(missing_ok=True)
    assert main(["diff", run, run]) == 2
    said = capsys.readouterr().err
    assert (said.count("\n"), words in said) == (1, True), said


def test_a_run_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    """The runs that there are are named."""
    run = run_of(PlaceConfig(), {ONE: placed()})
    assert main(["diff", run, "nothing"]) == 2
    assert f"'nothing' is not a run; there are last, {run}" in capsys.readouterr().err
