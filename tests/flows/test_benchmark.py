"""A dataset run plans first, computes only what is missing, keeps going, and tells the truth."""

import importlib
import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import jsonschema
import pyarrow.parquet as pq
import pytest

from dcap.scene.errors import InputError, LanguageError
from dcap.scene.store.artifacts import Store
from dcap.scene.types.sample import Sample
from flows.benchmark import failed_before, new_run_folder, rerun_sample, write_failure
from flows.cli.app import main
from flows.language_options import LanguageOptions
from flows.place import PlaceConfig
from flows.sample_run import FailedSample

PIPELINE = """
import numpy as np
from pydantic import BaseModel
from flows.place import PlacementRefs
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.box import OrientedBox
from dcap.scene.errors import GeometryError
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import Material, BodyModel, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, NotInScene, Reason
from dcap.scene.types.particles import Particles
from dcap.scene.types.renders import Renders, Visibility
from dcap.scene.types.rotation import Rotation
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from solver.certificate import Verdict
from dcap.scene.store.artifacts import Source, Store
from rest_records import history, implicit_certificate
from tasks.overview import overview_task
from tasks.runner.stage import stage

MESH = Mesh.of(np.random.default_rng(0).random((30, 3)), np.arange(30).reshape(10, 3))
BOX = OrientedBox(np.zeros(3), np.eye(3), np.ones(3))
DOWN = np.array([[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 2.0], [0, 0, 0, 1.0]])

def mesh(source: Source) -> Scan:
    if source.path.read_text() == "broken":
        raise GeometryError(f"{source.path}: broken on purpose")
    return Scan(MESH, np.full(10, -1, np.int32), (), (), (), "", np.eye(4), "z", 1.0, "format", ("welded",))

def segment(scan: Scan) -> Segmentation:
    one = Instance("7", "table", BOX, (Part("top", BOX, 1.0),), None)
    return Segmentation(scan.mesh, (one,), np.zeros(10, np.int32), np.zeros(10, np.int32))

def intent(scene: Segmentation, prompt: str) -> Intent | Infeasible:
    if "piano" in prompt:
        return Infeasible(Reason.TARGET_NOT_FOUND, "no piano; there is table", NotInScene("piano", ("table",), "ball"))
    region = RegionRequest("", ("center",), (), "")
    return Intent("7", "table", "ball", np.ones(3), 0.5, False, 1.0, OrientationRequest("any", "", ""), region, (), ())

def anchor(intent: Intent) -> Anchor:
    square = np.array([[-5.0, -5], [5, -5], [5, 5], [-5, 5]])
    return Anchor("7", "top", 0, "center", np.zeros(2), np.zeros(3), DOWN, 0.01, square, "")

def drop(anchor: Anchor, seed: int) -> Settled:
    body = SettledBody("object", MESH, np.array([0, 0, -1.0]), np.array([1.0, 0, 0, 0]), np.zeros((30, 3)))
    return Settled(
        Verdict.AT_REST, (body,), (), np.zeros((0, 3)), implicit_certificate(), history(2), seed, 0.5, ()
    )

def render(settled: Settled) -> Renders:
    picture = np.full((8, 8, 3), 100, np.uint8)
    seen = Visibility(np.array([[0.0, 15.0, 0.5, 0.5]]), 0.4)
    return Renders(picture, picture, picture, 0.5, np.array([3.0, -2.0, 1.5]), np.zeros(3), *[picture] * 3, seen)

stages = [stage(one) for one in (mesh, segment, intent, anchor, drop, render)]

def place(sample, config):
    read, divide, understand, aim, settle, paint = stages
    scan = read(Store.default().add_source(sample.scene))
    scene = divide(scan)
    wish = understand(scene, sample.prompt)
    target = aim(wish)
    settled = settle(target, sample.seed)
    pictures = paint(settled)
    return PlacementRefs(
        scene_scan=scan, object_scan=scan, scene_surface=scan, object_surface=scan, scene=scene,
        item=scene, intent=wish, rotation=wish, anchor=target,
        materials=wish, particles=settled, settled=settled, renders=pictures,
        overview=overview_task(scene, scene, None, None) if pictures.infeasible else None,
    )
"""
DATASET = """
- {id: good, scene: fine.ply, object: fine.ply, prompt: put the ball on the table, seed: 1}
- {id: none, scene: fine.ply, object: fine.ply, prompt: put the ball on the piano}
- {id: bad, scene: broken.ply, object: fine.ply, prompt: put the ball on the table}
- {id: "gone: {x}", scene: gone.ply, object: fine.ply, prompt: put the ball on the table}
"""
TRUTH = """
good: {base: table, part: top, feasible: true}
none: {feasible: false, reason: target_not_found}
bad: {base: table, part: top, feasible: true}
"""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A dataset of four samples on a fake pipeline: feasible, infeasible, failing, and with a missing scene."""
    folder = tmp_path_factory.mktemp("benchmark")
    (folder / "fake_pipeline.py").write_text(PIPELINE)
    (folder / "fine.ply").write_text("fine")
    (folder / "broken.ply").write_text("broken")
    (folder / "truth.yaml").write_text(TRUTH)
    (folder / "set.yaml").write_text(DATASET)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder / "data"))
        patch.delenv("PREFECT_API_URL", raising=False)
        patch.syspath_prepend(str(folder))
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


@pytest.mark.slow
def test_a_benchmark_from_cold_to_warm(
    dataset: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cold: two samples get through, two fail and are kept as such. Warm: no server is needed for what is cached.
    After mending, only what failed runs. One stage can be computed again."""
    folder = dataset.parent
    assert main(["plan", "--dataset", str(dataset), "--json"]) == 0
    plan = json.loads(capsys.readouterr().out)
    assert [row["runs"] for row in plan] == ["mesh", "mesh", "mesh", None]
    assert "gone.ply: no such file" in plan[3]["why"]
    assert all(list(row) == ["sample", "cached", "runs", "why", "may_run"] for row in plan)

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
        "scene.json", "clean.png",
        "settled.png", "closeup.png", "before_after.png", "contact.png", "profile.png",
    }  # fmt: skip

    assert {path.name for path in (run / "samples" / "none").iterdir()} == {
        "placement.json", "placement.schema.json", "scene.glb", "scene.json", "clean.png", "candidates.png",
    }  # fmt: skip

    def refuse() -> None:
        raise AssertionError("a cached sample must not start a server")

    with monkeypatch.context() as patch:
        patch.setattr("flows.benchmark.prefect_server", refuse)
        assert main(["benchmark", "--dataset", str(dataset), "--limit", "2"]) == 0

    (folder / "gone.ply").write_text("fine")
    (folder / "broken.ply").write_text("mended")
    assert main(["benchmark", "--dataset", str(dataset)]) == 0
    capsys.readouterr()
    assert main(["benchmark", "--dataset", str(dataset), "--only-failed"]) == 2
    assert "nothing failed" in capsys.readouterr().err

    monkeypatch.chdir("/")  # a run knows where its files are
    assert main(["rerun", "last", "good", "--stage", "drop", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert {**again, "timings": 0} == {**placement, "timings": 0}
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


def test_what_the_last_run_did_not_ask_for_did_not_fail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After a run of two samples of three, one good and one failed, only the failed one is run again."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    good, bad, later = (Sample(name, "room", "ball", "put it") for name in ("good", "bad", "later"))
    run = new_run_folder(tmp_path / "set.yaml", [good, bad], PlaceConfig(), LanguageOptions())
    write_failure(run, FailedSample(bad, InputError("no such file")))
    (run / "samples" / "good").mkdir()
    (run / "samples" / "good" / "placement.json").write_text("{}")
    assert failed_before([good, bad, later]) == [bad]


def test_a_plan_survives_what_nobody_expected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
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


@pytest.mark.parametrize("error", [ZeroDivisionError("a defect"), LanguageError("what is a blorb?")])
def test_a_rerun_that_breaks_is_not_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    """The sample's failure is kept in the run and reaches the caller as what it is, so that its exit code stands."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    sample = Sample("odd", "room", "ball", "put it")
    run = new_run_folder(tmp_path / "set.yaml", [sample], PlaceConfig(), LanguageOptions())
    monkeypatch.setattr("flows.benchmark.prefect_server", lambda: nullcontext("http://nowhere/api"))
    monkeypatch.setattr("flows.benchmark.try_sample", lambda sample, config, **_: FailedSample(sample, error))
    with pytest.raises(type(error), match=str(error).rstrip("?")):
        rerun_sample("last", "odd", "drop")
    assert str(error) in (run / "samples" / "odd" / "error.txt").read_text()
    assert (run / "report.html").is_file()
