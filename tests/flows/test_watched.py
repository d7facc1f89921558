"""Prefect's pages of a benchmark tell the truth; whatever is killed under it, what was finished is not repeated."""

import importlib
import json
import os
import signal
import time
from functools import partial
from pathlib import Path
from typing import Any

import patience
import psutil
import pytest
from fake_benchmark import end, fake_benchmark
from fake_pipeline_code import DATASET, PIPELINE
from headless_page import chromium, headless_page
from kept_records import kept_records
from prefect_pages import PrefectPages, Row, edges, in_time

from flows.cli.app import main

CHAIN = [("segment", "scan", "mesh"), ("intent", "scene", "segment"), ("anchor", "intent", "intent"),
         ("drop", "anchor", "anchor"), ("render", "settled", "drop")]  # fmt: skip
"""(stage, parameter, what made it) of the fake pipeline, by its code."""
OVERVIEW = [("overview", "scene", "segment"), ("overview", "item", "segment")]
NO_PIANO = "target_not_found: no piano; there is table"
PATIENCE = 240.0
"""For machines that are busy [s]."""
AT_ONCE_SECONDS = 5.0
SLOW = "put the ball on the slow table"
wait_until = partial(patience.wait_until, seconds=PATIENCE, every=0.05)


def told(run: Row) -> tuple[str, str, str]:
    """Type, name and message of a run's state."""
    return run["state"]["type"], run["state"]["name"], run["state"]["message"] or ""


def lineage_of_sample(sample: str, pairs: list[tuple[str, str, str]]) -> set[tuple[str, str, str]]:
    """The edges of a sample's stages."""
    return {(f"{stage} {sample}", parameter, f"{made} {sample}") for stage, parameter, made in pairs}


@pytest.fixture
def pages(server: str) -> PrefectPages:
    """The pages that somebody watches."""
    return PrefectPages(server)


@pytest.fixture
def dataset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The fake pipeline and its data set: feasible, infeasible, failing, and with a missing scene."""
    (tmp_path / "watched_pipeline.py").write_text(PIPELINE)
    (tmp_path / "fine.ply").write_text("fine")
    (tmp_path / "broken.ply").write_text("broken")
    (tmp_path / "watched.yaml").write_text(DATASET)  # runs of other tests on this server have other names
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()
    monkeypatch.delitem(importlib.sys.modules, "watched_pipeline", raising=False)  # type: ignore[attr-defined]
    monkeypatch.setattr("flows.sample_run.place_by", importlib.import_module("watched_pipeline").place)
    return tmp_path / "watched.yaml"


@pytest.mark.slow
def test_a_benchmark_as_its_pages_show_it(
    dataset: Path, pages: PrefectPages, capsys: pytest.CaptureFixture[str]
) -> None:
    """One run, with a task for each sample and in it one for each stage: names, tags, states, what each was made of,
    and a table. The second time all stages are cached."""
    assert main(["benchmark", "--dataset", str(dataset), "--json"]) == 4
    folder = Path(json.loads(capsys.readouterr().out)["run"])
    in_time(lambda: check_pages(pages, folder, dataset))
    assert main(["benchmark", "--dataset", str(dataset), "--limit", "1", "--json"]) == 0
    name = Path(json.loads(capsys.readouterr().out)["run"]).name
    (again,) = pages.flow_runs(f"run:{name}")
    assert told(again)[:2] == ("COMPLETED", "Completed")

    def all_are_cached() -> None:
        states = {name: told(run)[1] for name, run in pages.task_runs(again["id"]).items()}
        assert states.pop("good") == "Completed"
        assert [*states.values()] == ["Cached"] * 6

    in_time(all_are_cached)


def check_pages(pages: PrefectPages, folder: Path, dataset: Path) -> None:
    """Everything that the pages of a benchmark tell."""
    (run,) = pages.flow_runs(f"run:{folder.name}")
    assert run["name"] == folder.name
    assert set(run["tags"]) == {f"run:{folder.name}", "method:dcap"}
    assert told(run)[:2] == ("FAILED", "Failed")
    assert "4 samples: 1 at rest, 1 infeasible, 2 failed" in told(run)[2]
    tasks = pages.task_runs(run["id"])
    stages = ("mesh", "segment", "intent", "anchor", "drop", "render")
    assert set(tasks) == {
        "good", "none", "bad", "gone: {x}", *(f"{stage} good" for stage in stages), "mesh bad",
        *(f"{stage} none" for stage in ("mesh", "segment", "intent", "overview")),
    }  # fmt: skip
    infeasible = ("COMPLETED", "Infeasible", NO_PIANO)
    assert told(tasks["none"]) == told(tasks["intent none"]) == infeasible
    assert told(tasks["good"])[:2] == ("COMPLETED", "Completed")
    assert {told(tasks[f"{stage} good"])[1] for stage in stages} <= {"Completed", "Cached"}
    for name in ("bad", "mesh bad"):
        assert told(tasks[name])[:2] == ("FAILED", "Failed")
        assert f"{dataset.parent / 'broken.ply'}: broken on purpose" in told(tasks[name])[2] or name != "bad"
    for name in ("good", "drop good"):
        assert set(tasks[name]["tags"]) == {f"run:{folder.name}", "method:dcap", "scene:fine"}
    found = edges({name: one for name, one in tasks.items() if name.split()[-1] in ("good", "none")})
    assert found == {
        *lineage_of_sample("good", CHAIN), *lineage_of_sample("none", [*CHAIN[:2], *OVERVIEW]),
    }  # fmt: skip
    parents = {name: one["task_inputs"].get("__parents__") for name, one in tasks.items() if name.endswith(" good")}
    assert all([one["id"] for one in some] == [tasks["good"]["id"]] for some in parents.values() if some is not None)
    artifacts = pages.artifacts(run["id"])
    assert artifacts["progress"]["data"] == 100.0
    rows = {row["sample"]: row for row in json.loads(artifacts["results"]["data"])}
    assert list(rows) == ["good", "none", "bad", "gone: {x}"]
    assert (rows["good"]["on"], rows["none"]["verdict"]) == ("table top", "infeasible")
    assert str(folder / "report.html") in artifacts["report"]["data"]
    assert "data:image/jpeg;base64," in artifacts["pictures"]["data"]


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.long
@pytest.mark.skipif(chromium() is None, reason="no Chromium")
def test_a_person_sees_the_stages_of_a_benchmark(
    dataset: Path, pages: PrefectPages, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The page of the run lists its samples and stages."""
    assert main(["benchmark", "--dataset", str(dataset), "--json"]) == 4
    name = Path(json.loads(capsys.readouterr().out)["run"]).name
    (run,) = pages.flow_runs(f"run:{name}")
    with headless_page(f"{pages.url.removesuffix('/api')}/runs/flow-run/{run['id']}", tmp_path) as page:
        for words in (name, "drop good", "Infeasible"):
            page.wait_for(f"document.body.innerText.includes({json.dumps(words)})")


@pytest.fixture
def busy(tmp_path: Path) -> Path:
    """The file that keeps slow stages at work."""
    (tmp_path / "busy").touch()
    return tmp_path / "busy"


def begun(folder: Path, run: Any) -> int:
    """The process in which a slow stage is at work."""
    wait_until(lambda: (folder / "begun").exists() or run.poll() is not None)
    assert run.poll() is None, run.communicate()
    wait_until(lambda: (folder / "begun").read_text() != "")
    return int((folder / "begun").read_text())


@pytest.mark.long
@pytest.mark.slow
def test_a_killed_benchmark_goes_on(tmp_path: Path, pages: PrefectPages, busy: Path) -> None:
    """Its job ends with it. The next run says that it has crashed, finishes, and repeats nothing that was finished."""
    killed = fake_benchmark(tmp_path, [f"{SLOW} heavy", "put the ball on the table"], pages.url)
    try:
        job = begun(tmp_path, killed)
        (folder,) = (tmp_path / "data" / "runs").glob("killed-*")
        wait_until((folder / "samples" / "s1" / "placement.json").exists)
        (run,) = pages.flow_runs(f"run:{folder.name}")
        os.kill(killed.pid, signal.SIGKILL)
        wait_until(lambda: not psutil.pid_exists(job) or psutil.Process(job).status() == psutil.STATUS_ZOMBIE)
    finally:
        end(killed)
    before = kept_records(tmp_path / "data")
    assert run["state_type"] == "RUNNING"
    busy.unlink()
    again = fake_benchmark(tmp_path, [f"{SLOW} heavy", "put the ball on the table"], pages.url)
    try:
        out, err = again.communicate(timeout=PATIENCE)
    finally:
        end(again)
    assert again.returncode == 0, err
    assert json.loads(out)["at_rest"] == 2
    assert kept_records(tmp_path / "data").items() >= before.items()
    (run,) = pages.flow_runs(f"run:{folder.name}")
    assert told(run) == ("CRASHED", "Crashed", "its program was killed")
    tasks = pages.task_runs(run["id"])
    assert {name: told(tasks[name])[0] for name in ("s0", "intent s0", "s1")} == {
        "s0": "CRASHED", "intent s0": "CRASHED", "s1": "COMPLETED",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.long
def test_a_benchmark_killed_in_each_stage_goes_on(tmp_path: Path, pages: PrefectPages) -> None:
    """And in the middle of a record: each run goes on where the one before was killed, and repeats nothing that was
    finished."""
    busy, finished = tmp_path / "busy", dict[str, Any]()
    for where in ("mesh", "segment", "record", "intent", "anchor", "drop", "render"):
        busy.write_text(where)
        (tmp_path / "begun").unlink(missing_ok=True)
        killed = fake_benchmark(tmp_path, ["put the ball on the table"], pages.url)
        try:
            begun(tmp_path, killed)
            os.kill(killed.pid, signal.SIGKILL)
        finally:
            end(killed)
        records = kept_records(tmp_path / "data")
        assert records.items() >= finished.items(), where
        assert len(records) == len(finished) + (where != "mesh"), where
        finished = records
    busy.unlink()
    last = fake_benchmark(tmp_path, ["put the ball on the table"], pages.url)
    try:
        out, err = last.communicate(timeout=PATIENCE)
    finally:
        end(last)
    assert last.returncode == 0, err
    assert json.loads(out)["at_rest"] == 1
    records = kept_records(tmp_path / "data")
    assert records.items() >= finished.items()
    assert len(records) == len(finished) + 1


@pytest.mark.slow
@pytest.mark.long
def test_samples_go_on_without_their_server(tmp_path: Path, busy: Path) -> None:
    """It is killed while one is placed: all are placed, the report is written, one line says what is incomplete, and
    the exit code is that of the samples."""
    run = fake_benchmark(tmp_path, [SLOW, "put the ball on the table", "put the ball on the piano"])
    try:
        begun(tmp_path, run)
        family = psutil.Process(run.pid).children(recursive=True)
        (server,) = (one for one in family if "server" in one.cmdline() and "start" in one.cmdline())
        server.kill()
        busy.unlink()
        out, err = run.communicate(timeout=PATIENCE)
    finally:
        end(run)
    assert run.returncode == 0, err
    counts = json.loads(out)
    assert (counts["samples"], counts["at_rest"], counts["infeasible"], counts["failed"]) == (3, 2, 1, 0)
    assert (Path(counts["run"]) / "report.html").is_file()
    assert sum("server was lost" in line for line in err.splitlines()) == 1, err
    assert "Traceback" not in err


@pytest.mark.long
@pytest.mark.slow
def test_an_interrupted_benchmark_ends_at_once(tmp_path: Path, busy: Path) -> None:
    """Although one stage computes in a thread and another in a process of its own; no process stays, its server
    neither, and nothing counts as failed."""
    run = fake_benchmark(tmp_path, [f"{SLOW} heavy", SLOW])
    try:
        begun(tmp_path, run)
        family = psutil.Process(run.pid).children(recursive=True)
        assert len(family) >= 4  # the fork server and its job, the server and its keeper
        begin = time.monotonic()
        os.kill(run.pid, signal.SIGINT)
        _, err = run.communicate(timeout=PATIENCE)
        took = time.monotonic() - begin
    finally:
        end(run)
    assert run.returncode == 130
    assert took < AT_ONCE_SECONDS
    assert err.endswith("dcap: interrupted\n")
    assert "Traceback" not in err
    wait_until(
        lambda: not any(one.is_running() and one.status() != psutil.STATUS_ZOMBIE for one in family), seconds=30.0
    )
    assert not list((tmp_path / "data" / "runs").rglob("error.txt"))
