"""Samples placed by workers or clusters come to the same as those placed here, whatever is killed meanwhile."""

import fcntl
import json
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from desk_room import desk_dataset
from foreign_names import LIBRARIES, OURS, foreign_folder, marks
from kept_records import kept_records
from pool_runs import PATIENCE, a_program, a_worker, benchmark, data_folder, kept_results, placed_results, wait_until
from prefect_pages import PrefectPages, Row

from dcap.cores import SHARE, available_cores
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from flows.cli.app import main
from flows.configure import with_threads
from flows.place import PlaceConfig
from flows.runners import RunnerName, check_runner

SAMPLES = {"mug": "put the mug on the desk", "book": "put the book on the desk", "lost": "put the mug on the piano"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A desk in a room, and what is put on it: rigid on rigid, the cheapest drops."""
    return desk_dataset(tmp_path_factory.mktemp("pool"), SAMPLES)


@pytest.fixture(scope="module")
def at_home(dataset: Path, tmp_path_factory: pytest.TempPathFactory, shared_server: str) -> dict[str, object]:
    """What threads of this program give."""
    with data_folder(tmp_path_factory.mktemp("home")), pytest.MonkeyPatch.context() as patch:
        patch.setenv("PREFECT_API_URL", shared_server)
        found = placed_results(dataset)
    assert [found[name][0] for name in SAMPLES] == ["at_rest", "at_rest", "infeasible"]  # type: ignore[index]
    return found


@pytest.fixture
def pool_alone(shared_server: str, tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Iterator[None]:
    """Only one test at a time has workers on the server that all processes of tests share."""
    root = tmp_path_factory.getbasetemp()
    with ((root if worker_id == "master" else root.parent) / "pool.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def placed(pages: PrefectPages) -> list[Row]:
    """Flow runs of the pool, those that this test has made first."""
    rows: list[Row] = pages.post("/flow_runs/filter", sort="START_TIME_DESC")
    return [row for row in rows if row["deployment_id"]]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("runner", ["dask", "ray"])
def test_a_cluster_gives_the_same(dataset: Path, at_home: object, server: str, tmp_path: Path, runner: str) -> None:
    """Wherever samples are placed."""
    if find_spec(f"prefect_{runner}") is None:
        pytest.skip(f"the extra `{runner}` is not installed")
    with data_folder(tmp_path):
        assert placed_results(dataset, "--runner", runner) == at_home


@pytest.mark.usefixtures("pool_alone")
@pytest.mark.slow
@pytest.mark.long
def test_workers_that_share_a_store_give_the_same(
    dataset: Path, at_home: object, server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two workers, each with a data folder of its own, place what a third machine asks for; they are started where
    foreign modules lie. A fourth machine, which was not there, has all of it without computing."""
    folder = foreign_folder(tmp_path / "foreign", OURS + LIBRARIES)
    monkeypatch.setenv("DCAP_STORE", str(tmp_path / "shared"))
    monkeypatch.chdir(folder)
    with data_folder(tmp_path / "asks"):
        first, second = ({"DCAP_DATA": str(tmp_path / name)} for name in "ab")
        with a_worker(1, first), a_worker(1, second):
            assert placed_results(dataset, "--runner", "pool") == at_home
        rows = placed(PrefectPages(server))[: len(SAMPLES)]
        assert sorted(row["state_name"] for row in rows) == ["Completed", "Completed", "Infeasible"]
        assert {row["name"] for row in rows} == set(SAMPLES)
    with data_folder(tmp_path / "late"):
        assert placed_results(dataset) == at_home
    assert marks(folder) == ""


@pytest.mark.usefixtures("pool_alone")
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_samples_of_a_killed_worker_begin_again(dataset: Path, at_home: object, server: str, tmp_path: Path) -> None:
    """Nothing that it has started goes on; another worker takes over, repeats no stage that was finished, and the
    results are those of a run that nobody has disturbed."""
    with data_folder(tmp_path):
        pages = PrefectPages(server)
        with a_worker() as first, a_program(*benchmark(dataset, "--runner", "pool")) as run:
            wait_until(lambda: any(name.startswith("mesh_scene") for name in kept_records(tmp_path)))
            assert any(row["state_type"] == "RUNNING" for row in placed(pages))
            family = psutil.Process(first.pid).children(recursive=True)
            first.kill()
            wait_until(lambda: not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in family))
            done = kept_records(tmp_path)
            with a_worker():
                assert run.wait(PATIENCE) == 0
        assert kept_records(tmp_path).items() >= done.items()
        assert kept_results() == at_home


@pytest.mark.usefixtures("pool_alone")
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_benchmark_is_started_from_the_pages(dataset: Path, at_home: object, server: str, tmp_path: Path) -> None:
    """What a person starts there with parameters is run by a worker, and its state says how it ended; not more
    simulations run at once than a limit allows."""
    with data_folder(tmp_path), pytest.MonkeyPatch.context() as patch:
        pages = PrefectPages(server)
        (tmp_path / "dcap.yaml").write_text("run: {simulations: 1}\n")
        patch.setenv("DCAP_CONFIG", str(tmp_path / "dcap.yaml"))
        with a_worker():
            wait_until(lambda: any(one["name"] == "benchmark" for one in pages.post("/deployments/filter")))
            ids = {one["name"]: one["id"] for one in pages.post("/deployments/filter")}

            def started(name: str, **values: object) -> Row:
                made = pages.post(f"/deployments/{ids[name]}/create_flow_run", parameters=values)
                wanted = {"id": {"any_": [made["id"]]}}

                def now() -> Row:
                    (row,) = pages.post("/flow_runs/filter", flow_runs=wanted)
                    return dict(row)

                wait_until(lambda: now()["state_type"] in ("COMPLETED", "FAILED", "CRASHED"))
                return now()

            ended = started("benchmark", dataset=str(dataset), workers=2)
            assert ended["state_type"] == "COMPLETED", ended["state"]
            assert kept_results() == at_home
            (limit,) = pages.post("/v2/concurrency_limits/filter")
            assert (limit["name"], limit["limit"]) == ("dcap-simulations", 1)
            assert started("rerun", sample="mug", stage="drop")["state"]["message"].startswith("at rest on desk")
            assert started("benchmark", dataset=str(tmp_path))["state_type"] == "FAILED"


def test_a_job_can_be_read_in_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Paths are whole, and name what they named: a file of labels is read by its name."""
    from flows.pool import job_from_json, job_to_json
    from flows.watched import SampleJob

    monkeypatch.chdir(tmp_path)
    for name in ("room.glb", "mug.glb", "SHA256-1"):
        Path(name).touch()
    Path("labels.json").symlink_to("SHA256-1")
    sample = Sample("one", "room.glb", "mug.glb", "put it there", labels="labels.json")
    job = SampleJob(sample, PlaceConfig(), Session(), "run")
    text = json.dumps(job_to_json(job))
    (elsewhere := tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(elsewhere)
    read = job_from_json(json.loads(text))
    assert (read.sample.scene, read.sample.object) == (str(tmp_path / "room.glb"), str(tmp_path / "mug.glb"))
    assert read.sample.labels == str(tmp_path / "labels.json")
    assert (read.run, read.config) == ("run", job.config)


def test_threads_are_those_of_every_stage_that_has_some(monkeypatch: pytest.MonkeyPatch) -> None:
    """And nothing else changes; a worker has its share of the cores."""
    changed = with_threads(PlaceConfig(), 3)
    assert {changed.drop.threads, changed.scene_mesh.threads, changed.object_mesh.threads, changed.drift.threads} == {3}
    assert with_threads(changed, 0) == with_threads(PlaceConfig(), 0)
    monkeypatch.setenv(SHARE, "1")
    assert available_cores() == 1


def test_runners_that_cannot_work_are_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before anything is computed, in a line with the option; an extra that is not installed is named."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    for name, cluster, batch, words in (
        (RunnerName.LOCAL, "tcp://a:8786", False, "--cluster tcp://a:8786"),
        (RunnerName.POOL, "", True, "--batch"),
    ):
        with pytest.raises(InputError, match=words):
            check_runner(name, cluster, batch=batch)
    monkeypatch.setattr("flows.runners.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"'dcap\[dask\]'"):
        check_runner(RunnerName.DASK, "", batch=False)
    assert main(["benchmark", "--runner", "slurm"]) == 2
    assert "slurm" in capsys.readouterr().err
