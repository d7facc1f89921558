"""A benchmark is one flow run: its children, names, tags, states, dependencies and artifacts tell the truth."""

import importlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fake_pipeline_code import DATASET, PIPELINE
from headless_page import chromium, headless_page
from prefect_pages import PrefectPages, edges

from flows.cli.app import main
from flows.server import prefect_server

CHAIN = {
    ("segment", "scan", "mesh"),
    ("intent", "scene", "segment"),
    ("anchor", "intent", "intent"),
    ("drop", "anchor", "anchor"),
    ("render", "settled", "drop"),
}
"""(stage, parameter, what made it) of the fake pipeline, by its code."""
OVERVIEW = {("overview", "scene", "segment"), ("overview", "item", "segment")}
HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The fake pipeline and its data set, the object of one sample with a name that a page might act on."""
    folder = tmp_path_factory.mktemp("watched")
    (folder / "fake_pipeline.py").write_text(PIPELINE)
    (folder / "fine.ply").write_text("fine")
    (folder / "broken.ply").write_text("broken")
    (folder / f"{HOSTILE.replace('/', '')}.ply").write_text("fine")
    (folder / "set.yaml").write_text(DATASET + odd_sample())
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder / "data"))
        patch.setenv("PREFECT_HOME", str(folder / "data"))
        patch.delenv("PREFECT_API_URL", raising=False)
        patch.syspath_prepend(str(folder))
        patch.setattr("flows.sample_run.place_by", importlib.import_module("fake_pipeline").place)
        yield folder / "set.yaml"


def odd_sample() -> str:
    """A sample whose object is no page's friend."""
    return f"- {{id: odd, scene: fine.ply, object: '{HOSTILE.replace('/', '')}.ply', prompt: on the piano, seed: 3}}\n"


@pytest.fixture(scope="module")
def pages(dataset: Path) -> Iterator[PrefectPages]:
    """The pages that somebody watches while benchmarks run."""
    with prefect_server() as url:
        yield PrefectPages(url)


def newest(pages: PrefectPages) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """The newest benchmark and its children by name."""
    runs: list[dict[str, Any]] = [run for run in pages.flow_runs() if "method:dcap" in str(run["tags"])]
    return runs[0], {str(run["name"]): run for run in pages.flow_runs(runs[0]["id"])}


def told(run: dict[str, Any]) -> tuple[str, str, str]:
    """Type, name and message of a run's state."""
    state = run["state"]
    return state["type"], state["name"], state["message"] or ""


def in_time(check: Any) -> None:
    """Wait for what a server records a little later."""
    import time

    deadline = time.monotonic() + 30
    while True:
        try:
            check()
        except AssertionError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return


@pytest.mark.slow
def test_a_benchmark_as_its_pages_show_it(
    dataset: Path, pages: PrefectPages, capsys: pytest.CaptureFixture[str]
) -> None:
    """One run with a child per sample that has work; all that was cached is in the table only."""
    assert main(["benchmark", "--dataset", str(dataset), "--json"]) == 4
    folder = Path(json.loads(capsys.readouterr().out)["run"])
    parent, children = newest(pages)
    assert parent["name"] == folder.name
    assert set(parent["tags"]) == {f"run:{folder.name}", "method:dcap"}
    assert told(parent)[:2] == ("FAILED", "Failed")
    assert "5 samples: 1 at rest, 2 infeasible, 2 failed" in told(parent)[2]
    odd = f"dcap / fine / {HOSTILE.replace('/', '')}"
    assert set(children) == {"dcap / fine / fine / good", "dcap / fine / fine / none", "dcap / broken / fine", odd}
    good, none = children["dcap / fine / fine / good"], children["dcap / fine / fine / none"]
    assert told(good)[:2] == ("COMPLETED", "Completed")
    assert told(none) == ("COMPLETED", "Infeasible", "target_not_found: no piano; there is table")
    bad = children["dcap / broken / fine"]
    assert told(bad) == ("FAILED", "Failed", f"{dataset.parent / 'broken.ply'}: broken on purpose")
    assert set(good["tags"]) == {f"run:{folder.name}", "method:dcap", "scene:fine"}
    in_time(lambda: check_tasks(pages, good, none, bad))
    check_artifacts(pages, parent, folder)
    pictures = pages.artifacts(good["id"])["pictures"]
    assert "data:image/jpeg;base64," in str(pictures["data"])

    assert main(["benchmark", "--dataset", str(dataset), "--limit", "2"]) == 0
    parent, children = newest(pages)
    assert told(parent)[:2] == ("COMPLETED", "Completed")
    assert children == {}
    rows = json.loads(str(pages.artifacts(parent["id"])["results"]["data"]))
    assert [row["cached"] for row in rows] == ["cached", "cached"]

    assert main(["rerun", "last", "good", "--stage", "drop"]) == 0
    again = next(run for run in pages.flow_runs() if "scene:fine" in str(run["tags"]))
    in_time(lambda: check_rerun(pages, again))


@pytest.mark.slow
@pytest.mark.skipif(chromium() is None, reason="no Chromium")
def test_a_person_sees_the_samples_of_a_benchmark(dataset: Path, pages: PrefectPages, tmp_path: Path) -> None:
    """The pages list them under their run, with how each has ended."""
    assert main(["benchmark", "--dataset", str(dataset)]) == 4
    parent, children = newest(pages)
    with headless_page(f"{pages.url.removesuffix('/api')}/runs", tmp_path) as page:
        for words in (*children, parent["name"]):
            page.wait_for(f"document.body.innerText.includes({json.dumps(words)})")
        page.wait_for(row_of("dcap / broken / fine", f"run:{parent['name']}", "Failed"))


def row_of(name: str, *words: str) -> str:
    """Whether a page lists a run of this name with these words beside it; its parts come one after the other."""
    rows = "document.body.innerText.split('\\nplace\\n').slice(1)"
    return f"{rows}.some(row => row.startsWith({json.dumps(name)}) && {json.dumps(words)}.every(w => row.includes(w)))"


def check_tasks(pages: PrefectPages, good: dict[str, Any], none: dict[str, Any], bad: dict[str, Any]) -> None:
    """Names, tags, states and dependencies of task runs."""
    tasks = pages.task_runs(good["id"])
    names = [f"{stage} good" for stage in ("mesh", "segment", "intent", "anchor", "drop", "render")]
    assert sorted(str(run["name"]) for run in tasks) == sorted(names)
    assert all(set(run["tags"]) == set(good["tags"]) for run in tasks)  # type: ignore[call-overload]
    assert {told(run)[1] for run in tasks} <= {"Completed", "Cached"}
    assert edges(tasks) == CHAIN
    empty = {str(run["name"]): run["task_inputs"] for run in tasks}
    assert empty["intent good"].keys() == {"scene", "prompt"}  # type: ignore[attr-defined]
    tasks = pages.task_runs(none["id"])
    states = {str(run["name"]): told(run) for run in tasks}
    assert states["intent none"] == ("COMPLETED", "Infeasible", "target_not_found: no piano; there is table")
    assert set(states) == {"mesh none", "segment none", "intent none", "overview none"}
    assert edges(tasks) == {edge for edge in CHAIN if edge[0] in ("segment", "intent")} | OVERVIEW
    states = {str(run["name"]): told(run) for run in pages.task_runs(bad["id"])}
    assert states["mesh bad"][:2] == ("FAILED", "Failed")
    assert states["mesh bad"][2].endswith(": broken on purpose")
    assert "\n" not in states["mesh bad"][2]


def check_artifacts(pages: PrefectPages, parent: dict[str, Any], folder: Path) -> None:
    """Progress, results and the way to the report."""
    found = pages.artifacts(parent["id"])
    assert found["progress"]["data"] == 100.0
    assert found["progress"]["description"] == "5 of 5 samples, 2 failed"
    rows = {row["sample"]: row for row in json.loads(str(found["results"]["data"]))}
    assert list(rows) == ["good", "none", "bad", "gone: {x}", "odd"]
    assert rows["good"]["on"] == "table top"
    assert rows["odd"]["verdict"] == "infeasible"
    assert "gone.ply: no such file" in rows["gone: {x}"]["why"]
    assert str(folder / "report.html") in str(found["report"]["data"])


def check_rerun(pages: PrefectPages, again: dict[str, Any]) -> None:
    """Only the stage that was asked for is computed; what it does not change is cached."""
    states = {str(run["name"]): told(run)[1] for run in pages.task_runs(again["id"])}
    assert states["drop good"] == "Completed"
    assert {state for name, state in states.items() if name != "drop good"} == {"Cached"}
