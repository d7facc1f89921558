"""What a job says wherever it is read, and where a worker's flow runs find its places and cores."""

import json
from pathlib import Path

import pytest

from dcap.cores import SHARE, available_cores
from dcap.language.protocol.session import Session
from dcap.scene.json_tree import JsonObject
from dcap.scene.settings import data_root
from dcap.scene.types.sample import Sample
from flows.benchmark_config import benchmark_config
from flows.configure import with_threads
from flows.elsewhere import SampleJob, fetched
from flows.place import PlaceConfig
from flows.run_names import WatchedRun
from flows.sample_run import FailedSample, Plan
from flows.settings.own import run_settings
from flows.worker import whole_places

RUN = WatchedRun("run", None, frozenset())


@pytest.fixture
def sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sample:
    """One with short paths, as they are beside the data; its labels are a link to a file of another name."""
    monkeypatch.chdir(tmp_path)
    for name in ("room.glb", "mug.glb", "SHA256-1"):
        Path(name).touch()
    Path("labels.json").symlink_to("SHA256-1")
    return Sample("one", "room.glb", "mug.glb", "put it there", labels="labels.json")


def test_a_job_can_be_read_in_any_folder(sample: Sample, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths are whole, and name what they named: a file of labels is read by its name."""
    job = SampleJob(sample, PlaceConfig(), Session(), RUN)
    text = json.dumps(job.to_json())
    (elsewhere := tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(elsewhere)
    read = SampleJob.from_json(json.loads(text))
    assert (read.sample.scene, read.sample.object) == (str(tmp_path / "room.glb"), str(tmp_path / "mug.glb"))
    assert read.sample.labels == str(tmp_path / "labels.json")
    assert read.run == RUN
    assert read.config == job.config


def test_errors_name_files_as_they_were_given(sample: Sample, tmp_path: Path) -> None:
    """Wherever the sample was placed."""
    told: JsonObject = {"error": f"{tmp_path / 'mug.glb'}: an empty file", "details": ""}
    ended = fetched(Plan(sample, (), "mesh", "new"), PlaceConfig(), told)
    assert isinstance(ended, FailedSample)
    assert ended.message == "mug.glb: an empty file"


def test_threads_are_those_of_every_stage_that_has_some() -> None:
    """And nothing else changes."""
    changed = with_threads(PlaceConfig(), 3)
    assert {changed.drop.threads, changed.scene_mesh.threads, changed.object_mesh.threads, changed.drift.threads} == {3}
    assert with_threads(changed, 0) == with_threads(PlaceConfig(), 0)


def test_who_places_divides_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads of this program share its cores; a worker of the pool has its own, unless a person gave a number."""
    monkeypatch.setattr("flows.benchmark_config.available_cores", lambda: 8)

    def threads(**asked: object) -> int:
        return benchmark_config({}, run_settings({"workers": 4, **asked}))[0].drop.threads

    assert threads() == 2
    assert threads(runner="dask") == 2
    assert threads(runner="pool") == 0
    assert threads(runner="pool", threads=3) == 3


def test_a_share_of_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a worker gives its flow runs counts; what is no number does not."""
    monkeypatch.delenv(SHARE, raising=False)
    all_of_them = available_cores()
    for given, cores in (("3", 3), ("0", all_of_them), ("many", all_of_them), ("", all_of_them)):
        monkeypatch.setenv(SHARE, given)
        assert available_cores() == cores


def test_a_workers_places_are_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its flow runs have another working directory; a URL is no path, and a link to settings stays where it lies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DCAP_DATA", "data")
    monkeypatch.setenv("DCAP_STORE", "store")
    monkeypatch.delenv("DCAP_CONFIG", raising=False)
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "mine.yaml").write_text("run: {workers: 1}\n")
    (tmp_path / "dcap.yaml").symlink_to("elsewhere/mine.yaml")
    wanted = {"DCAP_DATA": tmp_path / "data", "DCAP_STORE": tmp_path / "store", "DCAP_CONFIG": tmp_path / "dcap.yaml"}
    assert whole_places() == {name: str(path) for name, path in wanted.items()}
    assert data_root() == tmp_path / "data"
    monkeypatch.setenv("DCAP_STORE", "s3://bucket/prefix")
    monkeypatch.setenv("DCAP_CONFIG", "")
    assert whole_places() == {"DCAP_DATA": str(tmp_path / "data")}
