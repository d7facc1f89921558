"""Samples that others place, a cluster or the workers of the pool, end as they do at home."""

import os
import shutil
import signal
import subprocess
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import psutil
import pytest
from desk_room import desk_dataset
from foreign_names import LIBRARIES, OURS, foreign_folder, marks
from kept_records import Stamp, kept_records
from pool_runs import PATIENCE, a_worker, data_folder, placed_results, taken, wait_until, waiting
from prefect_pages import PrefectPages
from process_trees import descendants
from s3_server import s3_server
from watched_run import results as kept_results

from dcap.packages import module_command
from dcap.scene.errors import InputError, ServerGoneError
from dcap.scene.settings import data_root
from flows.cli.app import main
from flows.runners import RunnerName, check_runner, told_by
from flows.server import prefect_server

SAMPLES = {"mug": "put the mug on the desk", "book": "put the book on the desk", "lost": "put the mug on the piano"}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A desk in a room, and what is put on it: rigid on rigid, the cheapest drops."""
    return desk_dataset(tmp_path_factory.mktemp("runners"), SAMPLES)


@pytest.fixture(scope="module")
def at_home(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    """What threads of this program give."""
    with data_folder(tmp_path_factory.mktemp("home")):
        found = placed_results(dataset)
    assert [found[name][0] for name in SAMPLES] == ["at_rest", "at_rest", "infeasible"]  # type: ignore[index]
    return found


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("runner", ["dask", "ray"])
def test_a_cluster_gives_the_same(dataset: Path, at_home: object, tmp_path: Path, runner: str) -> None:
    """Samples are children of the benchmark's flow run, wherever they are placed."""
    if find_spec(f"prefect_{runner}") is None:
        pytest.skip(f"the extra `{runner}` is not installed")
    with data_folder(tmp_path), prefect_server() as url:
        assert placed_results(dataset, "--runner", runner) == at_home
        pages = PrefectPages(url)
        benchmark = next(run for run in pages.flow_runs() if "method:dcap" in run["tags"])  # type: ignore[operator]
        assert len(pages.flow_runs(str(benchmark["id"]))) == len(SAMPLES)


@pytest.mark.slow
@pytest.mark.long
def test_workers_of_the_pool_give_the_same(
    dataset: Path, at_home: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker takes the samples of a benchmark, says in each of their flow runs who it is, and shows there what came
    of it. Both are started beside the data, from where its paths are short, and where foreign modules lie."""
    data = tmp_path / "data"
    monkeypatch.chdir(foreign_folder(tmp_path, OURS + LIBRARIES))
    for path in dataset.parent.iterdir():
        shutil.copy(path, ".")
    with data_folder(data), prefect_server() as url:
        with a_worker(environment={"DCAP_DATA": os.path.relpath(data)}):
            assert placed_results(Path(dataset.name), "--runner", "pool") == at_home
        pages = PrefectPages(url)
        placed = [run for run in pages.post("/flow_runs/filter") if run["deployment_id"]]
        assert len(placed) == len(SAMPLES)
        assert all(any(str(tag).startswith("worker:") for tag in run["tags"]) for run in placed)  # type: ignore[attr-defined]
        assert sorted(str(run["state_name"]) for run in placed) == ["Completed", "Completed", "Infeasible"]
        assert all("pictures" in pages.artifacts(run["id"]) for run in placed)
        (benchmark,) = (run for run in pages.flow_runs() if "method:dcap" in run["tags"])  # type: ignore[operator]
        stand_ins = [str(run["name"]) for run in pages.task_runs(benchmark["id"])]
        assert sorted(stand_ins) == sorted(str(run["name"]) for run in placed)
        assert "dcap / room / book" in stand_ins
    assert marks(tmp_path) == ""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("who", ["a worker", "the next benchmark"])
def test_nobody_places_what_a_killed_benchmark_has_left(dataset: Path, tmp_path: Path, who: str) -> None:
    """Its samples wait in the pool; the first who sees them says that nobody waits for them."""
    with data_folder(tmp_path), prefect_server() as url:
        pages = PrefectPages(url)
        command = module_command("flows.cli", "benchmark", "--dataset", str(dataset), "--runner", "pool")
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as benchmark:
            wait_until(lambda: len(waiting(pages)) == len(SAMPLES))
            benchmark.kill()
        if who == "a worker":
            with a_worker():
                wait_until(lambda: not waiting(pages) and ended(pages) == {"CRASHED"})
        else:
            assert main(["benchmark", "--dataset", str(dataset), "--limit", "1"]) == 0
            assert not waiting(pages)
            assert ended(pages) == {"CRASHED"}


def ended(pages: PrefectPages) -> set[object]:
    """How those of the pool stand."""
    return {run["state_type"] for run in pages.post("/flow_runs/filter") if run["deployment_id"]}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_machines_share_nothing_but_a_store_and_a_server(
    dataset: Path, at_home: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two workers, each with a data folder of its own, place what a third machine asks for; a fourth, which was not
    there, has the whole of it without computing."""
    with (
        s3_server() as s3,
        data_folder(tmp_path / "asks"),
        prefect_server() as url,
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setenv("DCAP_STORE", s3.bucket())
        patch.setenv("PREFECT_API_URL", url)
        first, second = ({"DCAP_DATA": str(tmp_path / name), "PREFECT_HOME": str(tmp_path / name)} for name in "ab")
        with a_worker(1, first), a_worker(1, second):
            assert placed_results(dataset, "--runner", "pool") == at_home
        placed = [run for run in PrefectPages(url).post("/flow_runs/filter") if run["deployment_id"]]
        assert len({str(tag) for run in placed for tag in run["tags"] if str(tag).startswith("worker:")}) == 2  # type: ignore[attr-defined]
        patch.setenv("DCAP_DATA", str(tmp_path / "late"))
        capsys.readouterr()
        assert main(["plan", "--dataset", str(dataset)]) == 0
        assert "3 of 3 samples are cached" in capsys.readouterr().out
        assert placed_results(dataset) == at_home


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_samples_of_a_lost_worker_begin_again(dataset: Path, at_home: object, tmp_path: Path) -> None:
    """A worker that is killed with all its processes says nothing; another takes over what it had."""
    with data_folder(tmp_path), prefect_server() as url:
        pages = PrefectPages(url)
        command = module_command("flows.cli", "benchmark", "--dataset", str(dataset), "--runner", "pool")
        with a_worker() as first, subprocess.Popen(command, stdout=subprocess.DEVNULL) as benchmark:
            wait_until(lambda: any(run["state_type"] == "RUNNING" for run in taken(pages)))
            for pid in reversed(descendants(first.pid)):
                os.kill(pid, signal.SIGKILL)
            with a_worker():
                assert benchmark.wait(PATIENCE) == 0
        assert "CRASHED" in {run["state_type"] for run in taken(pages)}
        assert kept_results(data_root()) == at_home


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_worker_that_is_killed_after_each_stage_loses_nothing(tmp_path: Path) -> None:
    """A worker and the benchmark that waits for it are killed as the next stage begins, as often as there are stages;
    the next ones compute no stage again, and the last end with the results of a run that nobody has disturbed."""
    dataset = desk_dataset(tmp_path, {"mug": SAMPLES["mug"]})
    command = module_command("flows.cli", "benchmark", "--dataset", str(dataset), "--runner", "pool")
    with data_folder(tmp_path / "whole"):
        assert main(["benchmark", "--dataset", str(dataset)]) == 0
        whole = kept_results(data_root())
    with data_folder(tmp_path / "broken"), prefect_server():
        stages = len(kept_records(tmp_path / "whole"))
        done: dict[str, Stamp] = {}
        for _ in range(stages):
            known = len(done)
            with a_worker() as worker, subprocess.Popen(command, stdout=subprocess.DEVNULL) as benchmark:
                wait_until(lambda known=known: len(kept_records(tmp_path / "broken")) > known)  # type: ignore[misc]
                for pid in (benchmark.pid, *reversed(descendants(worker.pid))):
                    with suppress(ProcessLookupError):  # of a stage that has ended meanwhile
                        os.kill(pid, signal.SIGKILL)
            now = kept_records(tmp_path / "broken")
            assert now.items() >= done.items()
            if len(now) == stages:
                break
            done = now
        with a_worker():
            assert main(command[-5:]) == 0
        assert kept_records(tmp_path / "broken").items() >= done.items()
        assert kept_results(data_root()) == whole


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_flow_run_that_somebody_has_deleted_is_not_waited_for(dataset: Path, tmp_path: Path) -> None:
    """Its sample has failed, and the benchmark says so."""
    with data_folder(tmp_path), prefect_server() as url:
        pages = PrefectPages(url)
        command = module_command(
            "flows.cli", "benchmark", "--dataset", str(dataset), "--runner", "pool", "--limit", "1"
        )
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as benchmark:
            wait_until(lambda: waiting(pages))
            pages.delete(f"/flow_runs/{waiting(pages)[0]}")
            _, said = benchmark.communicate(timeout=PATIENCE)
        assert benchmark.returncode == 4
        assert "somebody has deleted its flow run" in said


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGTERM], ids=lambda kind: kind.name)
def test_a_worker_ends_with_all_that_it_has_started(dataset: Path, tmp_path: Path, kind: signal.Signals) -> None:
    """Even killed alone it leaves no process that goes on with its sample, or asks for others."""
    with data_folder(tmp_path), prefect_server() as url:
        pages = PrefectPages(url)
        command = module_command("flows.cli", "benchmark", "--dataset", str(dataset), "--runner", "pool")
        with a_worker() as worker, subprocess.Popen(command, stdout=subprocess.DEVNULL) as benchmark:
            wait_until(lambda: any(run["state_type"] == "RUNNING" for run in taken(pages)))
            family = [psutil.Process(pid) for pid in descendants(worker.pid)[1:]]
            assert any("prefect.engine" in one.cmdline() for one in family)
            worker.send_signal(kind)
            wait_until(lambda: not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in family))
            benchmark.send_signal(signal.SIGINT)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_benchmark_and_a_rerun_are_started_from_the_pages(dataset: Path, at_home: object, tmp_path: Path) -> None:
    """What a person starts there with parameters is run by a worker, and its state says how it ended. No more
    simulations run at once than a limit of the server allows."""
    with data_folder(tmp_path), prefect_server() as url:
        pages = PrefectPages(url)
        (tmp_path / "dcap.yaml").write_text("run: {simulations: 1}\n")
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("DCAP_CONFIG", str(tmp_path / "dcap.yaml"))
            with a_worker():
                held: set[int] = set()
                asked = {"dataset": str(dataset), "workers": 2}
                ended = started(pages, "benchmark", asked, lambda: held.update(busy(pages)))
                assert ended["state"]["type"] == "COMPLETED", ended["state"]
                assert kept_results(data_root()) == at_home
                assert held == {0, 1}
                again = started(pages, "rerun", {"sample": "mug", "stage": "drop"})
                assert again["state"]["message"].startswith("at rest on desk")
                wrong = started(pages, "rerun", {"sample": "nobody"})
                assert wrong["state"]["type"] == "FAILED"
                assert "nobody" in wrong["state"]["message"]
                none = started(pages, "benchmark", {"dataset": str(tmp_path)})
                assert none["state"]["type"] == "FAILED"
                assert none["state"]["message"].startswith(f"{tmp_path}: ")


def started(
    pages: PrefectPages, name: str, values: dict[str, object], look: Callable[[], object] = lambda: None
) -> Any:
    """A flow run of a deployment, once it has ended; `look` is called meanwhile."""
    wait_until(lambda: name in deployments(pages))
    path = f"/deployments/{deployments(pages)[name]}/create_flow_run"
    made = pages.create(path, parameters=values, state={"type": "SCHEDULED"})

    def end() -> Any:
        look()
        found: Any = next(run for run in pages.post("/flow_runs/filter") if run["id"] == made["id"])
        return found if found["state"]["type"] in ("COMPLETED", "FAILED", "CRASHED", "CANCELLED") else None

    wait_until(end)
    return end()


def deployments(pages: PrefectPages) -> dict[str, str]:
    """Their ids by name."""
    return {str(one["name"]): str(one["id"]) for one in pages.post("/deployments/filter")}


def busy(pages: PrefectPages) -> list[int]:
    """How many of the simulations that may run do run."""
    return [int(str(one["active_slots"])) for one in pages.post("/v2/concurrency_limits/filter")]


def test_a_server_that_is_gone_is_no_lost_worker() -> None:
    """A cluster's process that has waited for it in vain ends the benchmark, and fails no sample."""

    class Ended:
        def __init__(self, value: object) -> None:
            self.value = value

        def result(self, raise_on_failure: bool) -> object:
            return self.value

    assert told_by(Ended(OSError("a machine")))["error"] == "its worker was lost: a machine"  # type: ignore[arg-type]
    with pytest.raises(ServerGoneError, match="gone"):
        told_by(Ended(ServerGoneError("gone")))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "cluster", "batch", "said"),
    [
        (RunnerName.LOCAL, "tcp://a:8786", False, "--cluster tcp://a:8786 is for --runner dask or ray, not local"),
        (RunnerName.POOL, "", True, "--batch gathers the questions of one program; with --runner pool there are many"),
    ],
)
def test_runners_that_cannot_work_are_refused(name: RunnerName, cluster: str, batch: bool, said: str) -> None:
    """Before anything is computed."""
    with pytest.raises(InputError) as caught:
        check_runner(name, cluster, batch=batch)
    assert str(caught.value) == said


def test_a_runner_that_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its extra is named."""
    monkeypatch.setattr("flows.runners.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"--runner dask needs prefect-dask; pip install 'dcap\[dask\]'"):
        check_runner(RunnerName.DASK, "", batch=False)


def test_an_unknown_runner(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The command names those that there are."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    assert main(["benchmark", "--runner", "slurm"]) == 2
    assert "--runner 'slurm' is not one of local, dask, ray, pool" in capsys.readouterr().err
