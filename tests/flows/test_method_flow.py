"""Whole placements without a drop, from files to the row of a table: what is proposed is measured as it stands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from direct_stages import run_directly
from tiny_rooms import solid, table, write_tiny_objects, write_tiny_rooms

from dcap.evaluation.baselines.floor_plan import proposed_anchor
from dcap.evaluation.methods import by_method
from dcap.evaluation.outcome_table import AS_POSED, ExpectedOutcome, SampleOutcome
from dcap.evaluation.run_folder import sample_folder
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Anchor
from dcap.scene.types.floor_plan import FloorPlans
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from dcap.scene.writers.glb import Node, glb_bytes
from dcap.scene.written_files import JsonObject
from flows.benchmark import keep_result
from flows.judge_views import VIEWS
from flows.methods import examples_of
from flows.output import write_geometry
from flows.place import PlaceConfig
from flows.placement_json import Values
from flows.sample_run import FinishedSample, plan_sample, run_sample
from flows.scoring import read_measures, scored_row
from flows.selection import Selection, dataset_samples
from tasks.artifact import Ref, Store
from tasks.run_context import RunContext

PROMPT = "put the mug at the center of the table"
TOP = 0.75
TRUTH = ExpectedOutcome(base="dining table", part="top", region="center", feasible=True, reason="", base_id="table_0")
CONFIG = PlaceConfig(measured=True, compared=True)


@pytest.fixture(autouse=True)
def own_store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A store of this test alone."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))


def room_file(folder: Path) -> Path:
    """A floor 4 m by 3 m, in its middle a table 1.6 m by 0.9 m."""
    corner = (1.2, 1.05, 0.0)
    pieces = [Node(name, solid(tuple(np.add(corner, low)), size)) for name, low, size in table(1.6, 0.9, TOP)]
    floor = Node("floor_0", label="floor", children=(Node("floor", solid((0, 0, -0.05), (4.0, 3.0, 0.05))),))
    path = folder / "toy.glb"
    path.write_bytes(glb_bytes([floor, Node("table_0", label="dining table", children=tuple(pieces))]))
    return path


def sample_in(folder: Path) -> Sample:
    """The mug for the middle of the table."""
    mug = next(one for one in write_tiny_objects(folder) if one.stem == "mug")
    return Sample("toy-mug", str(room_file(folder)), str(mug), PROMPT)


def placed(sample: Sample, folder: Path) -> tuple[SampleOutcome, JsonObject, FinishedSample]:
    """The row of a sample, its placement.json and what its stages returned."""
    finished = run_sample(sample, CONFIG, RunContext())
    tree, _ = keep_result(folder, sample, finished)
    assert tree is not None
    out = sample_folder(folder, sample.id)
    return scored_row(sample, tree, "", TRUTH, out), tree, finished


@pytest.mark.slow
@pytest.mark.long
def test_the_pose_before_the_drop_is_measured_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It is the anchor's: over the middle of the table's top, a centimetre above it. So the gap and the fall are that
    centimetre, nothing touches, and the place is right."""
    ran = run_directly(monkeypatch)
    sample = by_method(sample_in(tmp_path), "no_drop")
    row, tree, _ = placed(sample, tmp_path / "run")
    out = sample_folder(tmp_path / "run", sample.id)
    assert "drop" not in ran
    assert out == tmp_path / "run" / "methods" / "no_drop" / "samples" / "toy-mug"
    assert (row.sample, row.method, row.verdict, tree["verdict"]) == ("toy-mug", "no_drop", AS_POSED, AS_POSED)
    assert (row.support_hit, row.part_hit, row.region_distance_m, row.as_expected) == (True, True, 0.0, True)
    clearance = CONFIG.anchor.clearance
    assert tree["pose"]["position"] == pytest.approx([2.0, 1.5, TOP + clearance], abs=1e-5)  # type: ignore[call-overload,index]
    assert row.gap_m == pytest.approx(clearance, abs=1e-5)
    assert (row.penetration_m, row.penetration_given_m, row.contact_area_m2) == (0.0, 0.0, 0.0)
    # it comes down flat by the gap, and rests on the table within the solver's penetration
    assert row.drift_m == pytest.approx(clearance, abs=2.0 * CONFIG.drift.solver.penetration_target)
    assert (row.drift_s, row.indentation_m) == (CONFIG.drift.seconds, None)
    kept = read_measures(out)
    # and by the referee, which needs a step of 0.5 ms to stop it
    assert row.referee_drift_m == pytest.approx(clearance, abs=5e-4 * np.sqrt(2 * 9.81 * clearance) + 1e-5)
    assert (row.referee_supported, row.referee_penetration_m, row.referee_s) == (True, 0.0, 1.0)
    assert {"measures", "indentation", "drift", "referee", "scene", "intent"} == set(kept)
    assert not (out / VIEWS).exists()  # until somebody judges
    assert row.right_place == 10.0
    assert row.physics_naturalness is not None
    assert row.physics_naturalness < 10.0


@pytest.mark.slow
@pytest.mark.long
def test_meshes_of_a_placement_are_written_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A second run copies what the first has written, unless somebody has edited it there; another method's placement
    of the same sample has its own."""
    run_directly(monkeypatch)
    sample = by_method(sample_in(tmp_path), "no_drop")
    _, tree, finished = placed(sample, tmp_path / "run")
    first = sample_folder(tmp_path / "run", sample.id)
    files = {path.name: path.read_bytes() for path in first.iterdir() if path.is_file()}
    calls = []

    def counted(values: Values, folder: Path) -> dict[str, str]:
        calls.append(folder)
        return write_geometry(values, folder)

    monkeypatch.setattr("flows.output.write_geometry", counted)
    assert keep_result(tmp_path / "again", sample, finished) == (tree, "")
    again = sample_folder(tmp_path / "again", sample.id)
    assert {path.name: path.read_bytes() for path in again.iterdir() if path.is_file()} == files
    assert calls == []
    (again / "scene.glb").write_bytes(b"edited by a person")
    keep_result(tmp_path / "third", sample, finished)
    assert len(calls) == 1
    assert (sample_folder(tmp_path / "third", sample.id) / "scene.glb").read_bytes() == files["scene.glb"]
    placed(by_method(sample_in(tmp_path), "holodeck"), tmp_path / "run")
    assert len(calls) == 2


@pytest.mark.slow
@pytest.mark.long
def test_a_baseline_is_measured_as_it_proposes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """LayoutGPT answers in pixels: within half of one (8 mm in a room of 4 m) of the table's top, in the asked middle.
    It is shown the room that can be read, and what cannot be is told and no failure."""
    run_directly(monkeypatch)
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"no glTF")
    other = write_tiny_rooms(tmp_path / "rooms", 1)[0]
    sample = by_method(sample_in(tmp_path), "layoutgpt")
    sample = replace(sample, examples=(str(broken), str(other), str(tmp_path / "gone.glb")))
    row, tree, finished = placed(sample, tmp_path / "run")
    assert (row.method, row.verdict, row.error) == ("layoutgpt", AS_POSED, "")
    assert (row.support_hit, row.part_hit, row.region_distance_m, row.as_expected) == (True, True, 0.0, True)
    half_pixel = 0.5 * 4.0 / 256.0
    assert row.gap_m is not None
    assert row.penetration_m is not None
    assert max(row.gap_m, row.penetration_m) <= half_pixel + 1e-6
    assert row.drift_m is not None
    assert row.physics_naturalness is not None
    store, refs = Store.default(), finished.placement
    anchor, settled, item = (store.load(one) for one in (refs.anchor, refs.settled, refs.item))
    assert isinstance(anchor, Anchor)
    assert isinstance(settled, Settled)
    assert isinstance(item, Segmentation)
    assert "LayoutGPT with 1 exemplars" in anchor.reason
    # the final state is the pose that was proposed, and nothing has moved
    final, expected = settled.bodies[0], item.mesh.transformed(anchor.world_from_object)
    np.testing.assert_allclose(final.surface.vertices, expected.vertices, atol=1e-7)
    assert not final.displacement.any()
    warnings = tree["warnings"]
    assert isinstance(warnings, list)
    assert {
        "broken.glb is not used as an example: it cannot be read",
        "gone.glb is not used as an example: it cannot be read",
    } <= set(warnings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "verdict", "reason"),
    [((20.0, 1.5, 0.8), AS_POSED, ""), ((2.0, 1.5, -1.0), "infeasible", "buried")],
    ids=["beside everything", "unseen below the floor"],
)
def test_a_proposal_over_nothing_is_measured_and_no_failure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: tuple[float, float, float], verdict: str, reason: str
):  # fmt: skip
    """There is nothing to drop it onto: it hits nothing, its gap is without end, and it scores little of physics; what
    nobody can see is told to be buried."""
    run_directly(monkeypatch)
    pose = np.eye(4)
    pose[:3, 3] = place

    def astray(_: Sample, scene: Ref[Segmentation], item: Ref[Segmentation], *__: object) -> Ref[object]:
        store = Store.default()
        room, thing = store.load(scene), store.load(item)
        assert isinstance(room, Segmentation)
        assert isinstance(thing, Segmentation)
        return store.save(proposed_anchor(room, thing.mesh, pose, "as said", ""))

    monkeypatch.setattr("flows.methods.proposal", astray)
    row, tree, finished = placed(by_method(sample_in(tmp_path), "holodeck"), tmp_path / "run")
    assert finished.placement.particles.infeasible
    assert (row.verdict, tree["verdict"], row.reason, row.error) == (verdict, verdict, reason, "")
    if verdict == AS_POSED:
        assert (row.support_hit, row.as_expected, row.com_supported, row.drift_m) == (False, False, False, None)
        assert row.gap_m == np.inf
        assert row.physics_naturalness is not None
        assert row.physics_naturalness < 6.0


def test_what_is_wrong_with_an_example_is_no_failure_of_the_sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Missing and broken files are left out by name; what can be read stays, in order. A failed answer is told."""
    ran = run_directly(monkeypatch)
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"no glTF")
    first, second = write_tiny_rooms(tmp_path / "rooms", 2)
    examples = tuple(str(one) for one in (tmp_path / "gone.glb", first, broken, second))
    plans, left_out = examples_of(Sample("a", "room.glb", "mug.glb", PROMPT, examples=examples), CONFIG)
    assert plans is not None
    assert left_out == ("gone.glb", "broken.glb")
    found = Store.default().load(plans)
    assert isinstance(found, FloorPlans)
    assert ran.count("floor_plan") == len(found.plans) == 2
    assert examples_of(Sample("a", "room.glb", "mug.glb", PROMPT), CONFIG) == (None, ())

    def unanswered(*_: object, **__: object) -> None:
        raise LanguageError("no answer")

    monkeypatch.setattr("flows.methods.segment_task", unanswered)
    with pytest.raises(LanguageError):
        examples_of(Sample("a", "room.glb", "mug.glb", PROMPT, examples=(str(first),)), CONFIG)


def test_a_plan_of_layoutgpt_names_what_is_missing(tmp_path: Path):
    """Nothing is cached: the first stage would run, and a missing example is no failure."""
    sample = replace(by_method(sample_in(tmp_path), "layoutgpt"), examples=(str(tmp_path / "gone.glb"),))
    plan = plan_sample(sample, CONFIG)
    assert (plan.failed, plan.missing[0].stage) == (None, "mesh_scene")


def test_a_sample_has_the_same_examples_in_every_run(tmp_path: Path):
    """Whatever --limit and --scenes leave of the data set."""
    write_tiny_rooms(tmp_path / "rooms", 3)
    write_tiny_objects(tmp_path / "objects")
    rows = (f"- {{id: s{k}, room: room_00{k}, object: mug, prompt: put the mug on the floor}}" for k in range(3))
    dataset = tmp_path / "set.yaml"
    dataset.write_text("\n".join(rows))
    methods = ("dcap", "layoutgpt")
    _, whole = dataset_samples(dataset, methods, Selection())
    _, one = dataset_samples(dataset, methods, Selection(limit=1))
    _, named = dataset_samples(dataset, methods, Selection(scenes="room_000"))
    assert [sample.id for sample in whole] == ["s0", "layoutgpt/s0", "s1", "layoutgpt/s1", "s2", "layoutgpt/s2"]
    assert one == named == whole[:2]
    assert [Path(path).stem for path in one[1].examples] == ["room_001", "room_002"]
    assert one[0].examples == ()
