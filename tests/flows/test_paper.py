"""`dcap paper`, and what it shares with `dcap benchmark`: folders of scenes, a judge; the same tables after a kill."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from fake_api import Answer, FakeApi, message, question_of
from judged import REPLY, SCORES
from tiny_rooms import write_tiny_objects, write_tiny_rooms

from dcap.scene.errors import InputError
from dcap.scene.settings import PROJECT_ROOT
from dcap.synthetic.dataset import make_dataset
from flows.benchmark_config import dataset_file, judge_options, request_digest
from flows.cli.app import main
from flows.options import BenchmarkOptions, PaperOptions
from flows.samples import load_samples

METHODS = "no_drop,holodeck"
"""Methods without a drop: seconds, not minutes."""


def judging(body: dict[str, object]) -> Answer:
    """A model that likes what it sees on the left."""
    return message(json.dumps(SCORES if question_of(body) == "judge_score" else REPLY))


def tables(run: Path) -> dict[str, bytes]:
    """Every table and figure of a run, and what its samples are."""
    names = ("tables/*", "figures/*.png", "dataset/*.yaml", "judging/*.parquet", "study/study.json")
    return {one.relative_to(run).as_posix(): one.read_bytes() for name in names for one in sorted(run.glob(name))}


@pytest.mark.slow
@pytest.mark.long
def test_one_command_for_a_folder_of_scenes(tmp_path: Path, server: str, api: FakeApi) -> None:
    """Sentences name assets as assets.csv does, both methods are placed, a model judges, the study is prepared. The
    same command again asks nobody and leaves the same tables in the same folder."""
    api.answers = [judging]
    write_tiny_rooms(tmp_path / "rooms", 2)
    for one in write_tiny_objects(tmp_path / "objects"):
        if one.stem not in ("mug", "book"):
            one.unlink()
    (tmp_path / "objects" / "assets.csv").write_text("file,name,category\nmug.glb,beaker,mug\n")
    command = [
        "paper",
        "--dataset",
        str(tmp_path / "rooms"),
        "--objects",
        str(tmp_path / "objects"),
        "--per-scene",
        "2",
    ]
    command += ["--methods", METHODS, "--judge", "anthropic", "--judge-model", "claude-sonnet-5-5"]
    assert main(command) == 0
    (run,) = (tmp_path / "data" / "runs").glob("paper-rooms-*")
    asked = len(api.asked)
    samples = load_samples(run / "dataset" / "samples.yaml")
    assert len(samples) == 4
    mugs = [one for one in samples if one.object.endswith("mug.glb")]
    assert mugs
    assert all("beaker" in one.prompt and one.object_options.label == "beaker mug" for one in mugs)
    page = (run / "index.html").read_text()
    assert "<h3>Table 1" not in page
    assert "claude-sonnet-5-5" in page
    assert f"dcap study serve {run.name}" in page
    assert re.search(r'href="tables/table1\.csv"', page)
    scenes = list(csv.DictReader((run / "tables" / "dataset.csv").open()))
    assert [(one["scene"], one["mesh"]) for one in scenes] == [("room_000.glb", "given"), ("room_001.glb", "given")]
    study = json.loads((run / "study" / "study.json").read_text())
    assert study["raters"] == {}
    first = tables(run)
    assert main(command) == 0
    assert tables(run) == first
    assert len(api.asked) == asked
    assert [one.name for one in (tmp_path / "data" / "runs").glob("paper-*")] == [run.name]


@pytest.mark.slow
@pytest.mark.long
def test_a_killed_evaluation_goes_on(tmp_path: Path) -> None:
    """Of scenes that are splats: killed while it places and while it makes the study, it ends in the tables of one that
    nobody disturbed; a second run makes no placement again."""
    make_dataset(tmp_path, rooms=["hall_01", "study_02"], objects=["ball", "book"], splats=60_000)
    command = ["paper", "--dataset", str(tmp_path / "splat_rooms"), "--objects", str(tmp_path / "objects"),
               "--per-scene", "1", "--methods", METHODS]  # fmt: skip
    whole = finished(command, tmp_path / "whole")
    scenes = list(csv.DictReader((whole / "tables" / "dataset.csv").open()))
    assert [one["mesh"] for one in scenes] == ["reconstructed from the splats"] * 2
    data = tmp_path / "killed"
    killed(command, data, "methods/*/samples/*/placement.json")
    first = stamps(data)
    killed(command, data, "report.html")
    second = stamps(data)
    run = finished(command, data)
    assert first
    assert first.items() <= second.items()
    assert second.items() <= stamps(data).items()
    assert run.name == whole.name
    assert tables(run).keys() == tables(whole).keys()
    for name, content in tables(whole).items():
        if name not in ("dataset/samples.yaml", "study/study.json"):  # paths and digests of times differ
            assert tables(run)[name] == content, name
    before = stamps(data)
    finished(command, data)
    assert stamps(data) == before


def stamps(data: Path) -> dict[str, int]:
    """When each stage's result was recorded: a stage that is computed again records it again."""
    return {one.name: one.stat().st_mtime_ns for one in (data / "cache" / "records").iterdir()}


def started(command: list[str], data: Path) -> "subprocess.Popen[bytes]":
    """The command in a process group of its own."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    environment |= {"DCAP_DATA": str(data), "PYTHONPATH": str(PROJECT_ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "flows.cli", *command], env=environment, stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip


def finished(command: list[str], data: Path) -> Path:
    """Run it to its end; the folder of its run."""
    process = started(command, data)
    _, said = process.communicate()
    assert process.returncode == 0, said.decode()
    (run,) = (data / "runs").glob("paper-*")
    return run


def killed(command: list[str], data: Path, *signs: str) -> None:
    """Run it until a file of its run is there that fits one of the patterns, and kill it."""
    process = started(command, data)
    while process.poll() is None and not any(list((data / "runs").glob(f"paper-*/{sign}")) for sign in signs):
        time.sleep(0.05)
    assert process.poll() is None, "it ended before it could be killed"
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not list((data / "runs").glob("paper-*/index.html"))


def test_which_samples_a_data_set_has(tmp_path: Path) -> None:
    """A file as it is; a folder with samples.yaml has those; a folder of scenes needs objects, nothing else does."""
    assert dataset_file(BenchmarkOptions()) == (None, None)
    given = tmp_path / "set" / "samples.yaml"
    given.parent.mkdir()
    given.write_text("[]")
    assert dataset_file(BenchmarkOptions(dataset=given)) == (given, None)
    assert dataset_file(BenchmarkOptions(dataset=given.parent)) == (given, None)
    for options, told in (
        (BenchmarkOptions(dataset=tmp_path), "name the meshes to place: --objects FOLDER"),
        (BenchmarkOptions(dataset=given.parent, objects=tmp_path), "samples with objects; leave it out"),
        (BenchmarkOptions(objects=tmp_path), "the embedded rooms have samples with objects"),
    ):
        with pytest.raises(InputError, match=told):
            dataset_file(options)


@pytest.mark.slow
def test_a_folder_of_scenes_is_sampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As `dcap dataset sample` does; below the data folder, by what was asked; a scene that cannot be read is left out
    and told. The same request has the same file."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    write_tiny_rooms(tmp_path / "rooms", 2)
    write_tiny_objects(tmp_path / "objects")
    (tmp_path / "rooms" / "room_009.glb").write_bytes(b"no mesh")
    options = BenchmarkOptions(dataset=tmp_path / "rooms", objects=tmp_path / "objects", per_scene=2)
    path, made = dataset_file(options)
    assert path is not None
    assert made is not None
    assert path == tmp_path / "data" / "runs" / "samples" / f"rooms-{request_digest(options)}" / "samples.yaml"
    assert list(made.left_out) == ["room_009"]
    text = path.read_bytes()
    assert len(load_samples(path)) == 4
    assert dataset_file(options)[0] == path
    assert path.read_bytes() == text
    shutil.rmtree(path.parent)
    one, _ = dataset_file(options.model_copy(update={"scenes": "room_001"}))
    assert one is not None
    assert one != path
    assert {Path(sample.scene).stem for sample in load_samples(one)} == {"room_001"}


def test_what_was_asked_names_the_folder(tmp_path: Path) -> None:
    """Workers, threads and who judges do not count; data set, methods, limit and settings of stages do."""
    base = PaperOptions()
    same = (PaperOptions(workers=7), PaperOptions(threads=3), PaperOptions(judge="anthropic"))
    assert {request_digest(one) for one in same} == {request_digest(base)}
    others = (
        PaperOptions(limit=3), PaperOptions(methods="dcap"), PaperOptions(dataset=tmp_path), PaperOptions(per_scene=2),
        PaperOptions(solver="mls"), PaperOptions(scenes="hall_01"),
    )  # fmt: skip
    assert len({request_digest(one) for one in (base, *others)}) == 1 + len(others)


def test_who_judges(monkeypatch: pytest.MonkeyPatch) -> None:
    """A model with its own name and budget; nobody by default; what cannot be asked is refused before anything runs."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "key")
    assert judge_options(PaperOptions()) is None
    asked = judge_options(PaperOptions(judge="anthropic", judge_model="claude-sonnet-5-5", max_cost=2.0))
    assert asked is not None
    assert (asked.language, asked.model, asked.max_cost) == ("anthropic", "claude-sonnet-5-5", 2.0)
    for options, told in (
        (PaperOptions(judge_model="x"), "are for a model"),
        (PaperOptions(judge="anthropic", methods="dcap"), "a judge compares methods"),
        (PaperOptions(judge="openai"), "--judge openai needs --judge-model NAME"),
        (PaperOptions(judge="replay"), "--judge replay needs --judge-replay DIR"),
    ):
        with pytest.raises(InputError, match=told):
            judge_options(options)
