"""A dataset run plans first, computes only what is missing, keeps going, and tells the truth."""

import errno
import hashlib
import importlib
import json
import shutil
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import jsonschema
import pyarrow.parquet as pq
import pytest
from fake_pipeline_code import DATASET, PIPELINE, TRUTH

from dcap.scene.errors import LanguageError
from dcap.scene.types.sample import Sample
from flows.benchmark import new_run_folder, rerun_sample
from flows.cli.app import main
from flows.configure import LanguageOptions
from flows.place import PlaceConfig
from tasks.artifact import Store
from tasks.records import records_root


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory, shared_server: str) -> Iterator[Path]:
    """A dataset of four samples on a fake pipeline: feasible, infeasible, failing, and with a missing scene."""
    folder = tmp_path_factory.mktemp("benchmark")
    (folder / "fake_pipeline.py").write_text(PIPELINE)
    (folder / "fine.ply").write_text("fine")
    (folder / "broken.ply").write_text("broken")
    (folder / "truth.yaml").write_text(TRUTH)
    (folder / "set.yaml").write_text(DATASET)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder / "data"))
        patch.setenv("PREFECT_API_URL", shared_server)
        patch.syspath_prepend(str(folder))
        patch.delitem(sys.modules, "fake_pipeline", raising=False)  # of an earlier folder
        patch.setattr("flows.sample_run.place_by", importlib.import_module("fake_pipeline").place)
        yield folder / "set.yaml"


def check_maps(run: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Maps of a sample of a run, over a photo too; what has none is told in a line."""
    assert main(["maps", "last", "good"]) == 0
    made = run.resolve() / "samples" / "good" / "maps"
    assert capsys.readouterr().out == f"{made}\n"
    assert {"rgb.png", "depth.npy", "ids.json", "camera.json", "colmap"} <= {path.name for path in made.iterdir()}
    camera, photo = ["--camera", str(made / "camera.json")], ["--over", str(made / "rgb.png")]
    assert main(["maps", "last", "good", *camera, *photo, "--out", str(folder / "over")]) == 0
    assert (folder / "over" / "composite.png").is_file()
    capsys.readouterr()
    (folder / "no.json").write_text("{}")
    for words, told in (
        (["none"], "no maps: target_not_found"),
        (["nobody"], "not a sample"),
        (["good", *photo], "--camera FILE"),
        (["good", "--camera", str(folder / "no.json")], "width: Field required"),
        (["good", *camera, "--over", str(folder / "no.json")], "no.json"),
    ):
        assert main(["maps", "last", *words, "--out", str(folder / "none")]) == 2
        said = capsys.readouterr().err
        assert told in said
        assert len(said.splitlines()) == 1
        assert not (folder / "none").exists()


def stamps_of_records() -> dict[str, int]:
    """When each record was written."""
    return {path.name: path.stat().st_mtime_ns for path in records_root().iterdir()}


def check_changed_rerun(folder: Path, before: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    """A stage that comes to something else now: what depends on it follows, and nothing else."""
    (folder / "nudged").touch()
    records = stamps_of_records()
    assert main(["rerun", "last", "good", "--stage", "drop", "--json"]) == 0
    (folder / "nudged").unlink()
    now = json.loads(capsys.readouterr().out)
    assert now["pose"]["position"][2] == pytest.approx(before["pose"]["position"][2] - 0.1)
    written = {name for name, stamp in stamps_of_records().items() if records.get(name) != stamp}
    assert {name.rpartition("-")[0] for name in written} == {"drop", "render"}


def check_comparison(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The last run against the first: what was mended, and nothing else."""
    assert main(["diff", str(run), "last", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert {one["sample"] for one in found["outcomes"]} == {"bad", "gone: {x}"}
    assert [found[name] for name in ("only_a", "only_b", "poses", "asked", "config", "versions")] == [[]] * 6
    assert main(["diff", "last", "last"]) == 0
    assert "no difference" in capsys.readouterr().out


def check_origin(run: Path, dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A picture of the first run goes back to the file that was given, whose hash stands there."""
    picture = run / "samples" / "good" / "settled.png"
    assert main(["provenance", str(picture), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sample"]["prompt"] == "put the ball on the table"
    stages = {one["stage"] for one in found["steps"].values()}
    assert stages == {None, "mesh", "segment", "intent", "anchor", "drop", "render"}
    (source,) = [one for one in found["steps"].values() if one["kind"] == "Source"]
    content = (dataset.parent / "fine.ply").read_bytes()
    assert source["files"] == [{"name": "fine.ply", "sha256": hashlib.sha256(content).hexdigest(), "size": 4}]
    assert [found["steps"][root]["stage"] for root in found["roots"]] == ["render"]


@pytest.mark.slow
def test_a_benchmark_from_cold_to_warm(
    dataset: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cold: two samples get through, two fail and are kept as such. Warm: nothing is computed that is cached.
    After mending, only what failed runs. One stage can be computed again."""
    folder = dataset.parent
    assert main(["plan", "--dataset", str(dataset), "--json"]) == 0
    said = capsys.readouterr()
    assert "0 of 4 samples are cached" in said.err
    plan = json.loads(said.out)
    assert [row["runs"] for row in plan] == ["mesh", "mesh", "mesh", None]
    assert "gone.ply" in plan[3]["why"]
    assert all(list(row) == ["sample", "cached", "runs", "why", "may_run", "stages"] for row in plan)

    assert main(["benchmark", "--dataset", str(dataset), "--json"]) == 4
    counts = json.loads(capsys.readouterr().out)
    assert (counts["samples"], counts["at_rest"], counts["infeasible"], counts["failed"]) == (4, 1, 1, 2)
    assert (counts["feasible_as_intended"], counts["feasible_intended"]) == (1, 2)
    assert counts["infeasible_with_right_reason"] == 1
    run = Path(counts["run"])
    assert run == (folder / "data" / "runs" / "last").resolve()
    assert (run / "report.html").is_file()
    assert pq.read_table(run / "results.parquet")["sample"].to_pylist() == ["good", "none", "bad", "gone: {x}"]
    assert f"{folder / 'broken.ply'}: broken on purpose" in (run / "samples" / "bad" / "error.txt").read_text()
    placement = json.loads((run / "samples" / "good" / "placement.json").read_text())
    assert placement["pose"] == {"position": [0.0, 0.0, 1.0], "quaternion": [1.0, 0.0, 0.0, 0.0]}
    for name in ("good", "none"):
        folder_of = run / "samples" / name
        schema = json.loads((folder_of / "placement.schema.json").read_text())
        jsonschema.Draft202012Validator.check_schema(schema)
        jsonschema.validate(json.loads((folder_of / "placement.json").read_text()), schema)
    with pytest.raises(jsonschema.ValidationError, match="verdict"):
        jsonschema.validate({**placement, "verdict": 3}, schema)
    assert {path.name for path in (run / "samples" / "good").iterdir()} == {
        "placement.json", "placement.schema.json", "object.ply", "object.glb", "contacts.glb", "scene.glb",
        "scene.json", "records.json", "clean.png",
        "settled.png", "closeup.png", "before_after.png", "contact.png", "profile.png",
    }  # fmt: skip

    assert {path.name for path in (run / "samples" / "none").iterdir()} == {
        "placement.json", "placement.schema.json", "scene.glb", "scene.json", "records.json", "clean.png",
        "candidates.png",
    }  # fmt: skip

    records = stamps_of_records()
    assert main(["benchmark", "--dataset", str(dataset), "--limit", "2"]) == 0
    assert stamps_of_records() == records

    (folder / "gone.ply").write_text("fine")
    assert main(["benchmark", "--dataset", str(dataset)]) == 4
    (folder / "broken.ply").write_text("mended")
    capsys.readouterr()
    assert main(["benchmark", "--dataset", str(dataset), "--only-failed", "--json"]) == 0
    said = capsys.readouterr()
    assert "1 failed (bad) and run again, 3 finished and come from the cache" in said.err
    assert json.loads(said.out)["samples"] == 4
    assert main(["benchmark", "--dataset", str(dataset), "--only-failed"]) == 2
    assert "nothing failed" in capsys.readouterr().err

    check_comparison(run, capsys)
    check_origin(run, dataset, capsys)
    monkeypatch.chdir("/")  # a run knows where its files are
    other = folder / "data" / "runs" / "last" / "samples" / "none" / "placement.json"
    before, untouched = stamps_of_records(), other.stat().st_mtime_ns
    assert main(["rerun", "last", "good", "--stage", "drop", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    written = {name for name, stamp in stamps_of_records().items() if before.get(name) != stamp}
    assert {name.rpartition("-")[0] for name in written} == {"drop"}  # what follows is cached: the bytes are equal
    assert other.stat().st_mtime_ns == untouched
    assert {**again, "timings": 0} == {**placement, "timings": 0}
    check_changed_rerun(folder, again, capsys)
    assert other.stat().st_mtime_ns == untouched
    assert main(["rerun", "last", "none", "--stage", "drop"]) == 3
    assert capsys.readouterr().out.splitlines() == [
        "infeasible: target_not_found; no piano; there is table",
        f"report: {(folder / 'data' / 'runs' / 'last').resolve() / 'report.html'}",
    ]
    assert main(["rerun", "last", "none", "--stage", "overview"]) == 3
    assert main(["rerun", "last", "nobody", "--stage", "drop"]) == 2
    assert main(["rerun", "last", "good", "--stage", "cook"]) == 2
    assert main(["cache", "verify"]) == 0
    capsys.readouterr()
    check_maps(run.parent / "last", folder, capsys)

    ref = next(ref for ref in Store.default().refs() if ref.kind == "Settled")
    next(Store.default().folder(ref).glob("*.ply")).unlink()
    assert main(["cache", "verify"]) == 4
    assert main(["report", "last"]) == 0


def test_a_plan_survives_what_nobody_expected(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A defect that one sample hits is that sample's: `plan` tells it, `benchmark` keeps its traceback, both go on."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    (tmp_path / "set.yaml").write_text("- {id: odd, scene: a, object: b, prompt: put it}")

    def broken(sample: Sample, config: PlaceConfig) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("flows.sample_run.place_by", broken)
    assert main(["plan", "--dataset", str(tmp_path / "set.yaml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["why"] == "ZeroDivisionError: on purpose"
    assert main(["benchmark", "--dataset", str(tmp_path / "set.yaml"), "--json"]) == 4
    said = (Path(json.loads(capsys.readouterr().out)["run"]) / "samples" / "odd" / "error.txt").read_text()
    assert said.startswith("ZeroDivisionError: on purpose\n\nTraceback")
    assert "in broken" in said


def test_a_run_that_cannot_be_written_leaves_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor does `runs/last` point to one."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("flows.benchmark.write_whole", full)
    with pytest.raises(OSError, match="No space left"):
        new_run_folder(tmp_path / "set.yaml", [], PlaceConfig(), LanguageOptions())
    assert list((tmp_path / "runs").iterdir()) == []


def test_a_disk_that_refuses_everything_is_no_sample_s_matter(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plan ends with a line then, as a benchmark does; where one sample can be planned it is shown."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    lines = [f"- {{id: s{number}, scene: nowhere, object: nothing, prompt: put it}}" for number in range(2)]
    (tmp_path / "set.yaml").write_text("\n".join(lines))
    command = ["plan", "--dataset", str(tmp_path / "set.yaml")]
    assert main(command) == 0
    assert "nowhere: no such file" in capsys.readouterr().out

    def read_only(*_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(tmp_path / "cache"))

    monkeypatch.setattr("flows.sample_run.place_by", read_only)
    assert main(command) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"dcap: {tmp_path / 'cache'}: Read-only file system; ")


def test_a_rerun_that_breaks_is_not_bad_input(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sample's failure is kept in the run and reaches the caller as what it is, so that its exit code stands."""
    from flows import watched

    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    sample = Sample("odd", "room", "ball", "put it")
    run = new_run_folder(tmp_path / "set.yaml", [sample], PlaceConfig(), LanguageOptions())
    monkeypatch.setattr("flows.benchmark.prefect_server", lambda: nullcontext("http://nowhere/api"))
    for error in (ZeroDivisionError("a defect"), LanguageError("what is a blorb?")):
        monkeypatch.setattr(watched, "place_in_flow", lambda *_, error=error: raise_error(error))
        with pytest.raises(type(error)):
            rerun_sample("last", "odd", "drop")
        assert str(error) in (run / "samples" / "odd" / "error.txt").read_text()
        assert (run / "report.html").is_file()


def raise_error(error: Exception) -> None:
    raise error


@pytest.mark.slow
def test_what_a_run_needs_is_kept(dataset: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """After everything that no run needs is deleted, the runs are still cached to the last stage; without their folders
    nothing is kept."""
    assert main(["cache", "verify", "--repair"]) in (0, 4)  # tests before this one break things
    assert main(["benchmark", "--dataset", str(dataset), "--limit", "2"]) == 0
    run = (dataset.parent / "data" / "runs" / "last").resolve()
    (run / "samples" / "none" / "records.json").unlink()  # it is looked up
    Store.default().save(Sample("nobody", "needs", "this", "at all", mass=None))
    capsys.readouterr()
    assert main(["cache", "gc", "--yes", "--older-than", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert str(run) in told["runs"]
    assert told["artifacts"] > 0
    assert main(["plan", "--dataset", str(dataset), "--limit", "2", "--json"]) == 0
    assert [row["runs"] for row in json.loads(capsys.readouterr().out)] == [None, None]
    assert main(["cache", "verify"]) == 0
    shutil.rmtree(dataset.parent / "data" / "runs")
    assert main(["cache", "gc", "--yes", "--older-than", "0"]) == 0
    capsys.readouterr()
    assert main(["cache", "ls", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kinds"] == {}


def test_samples_of_any_name_stay_in_the_run(
    server: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names lead nowhere else, however long they are, and show as text; each sample has its row."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    names = [
        "x" * 300,
        "../../out",
        "/tmp/out",
        "CON",
        "a/b",
        "<script>alert(1)</script>",
        "two\u202ewords",
        "é" * 200,
    ]
    rows = [{"id": name, "scene": "a", "object": "b", "prompt": "put it"} for name in names]
    (tmp_path / "set.yaml").write_text(json.dumps(rows))
    monkeypatch.setattr("flows.sample_run.place_by", lambda sample, config: 1 // 0)
    before = set(tmp_path.iterdir())
    assert main(["benchmark", "--dataset", str(tmp_path / "set.yaml"), "--json"]) == 4
    run = Path(json.loads(capsys.readouterr().out)["run"])
    assert pq.read_table(run / "results.parquet")["sample"].to_pylist() == names
    assert len({path.resolve().parent for path in (run / "samples").rglob("error.txt")}) == len(names)
    assert all(path.resolve().is_relative_to(run / "samples") for path in (run / "samples").rglob("*"))
    assert set(tmp_path.iterdir()) - before == {tmp_path / "data"}
    assert "<script>alert" not in (run / "report.html").read_text()


def test_what_is_refused_before_it_begins_leaves_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nor does `last` lead to it."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PREFECT_API_URL", "http://127.0.0.1:1/api")
    (tmp_path / "fake_pipeline.py").write_text(PIPELINE)
    (tmp_path / "fine.ply").write_text("fine")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "fake_pipeline", raising=False)
    monkeypatch.setattr("flows.sample_run.place_by", importlib.import_module("fake_pipeline").place)
    monkeypatch.delitem(sys.modules, "fake_pipeline")
    (tmp_path / "set.yaml").write_text("- {id: one, scene: fine.ply, object: fine.ply, prompt: on the table}")
    assert main(["benchmark", "--dataset", str(tmp_path / "set.yaml")]) == 2
    assert "no server of Prefect answers there" in capsys.readouterr().err
    assert not list((tmp_path / "data").glob("runs/*"))
