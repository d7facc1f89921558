"""The wiring of flows/place.py: what mypy refuses, and that its list of stages is the path that it takes."""

import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from box_rooms import block, thing
from mypy import api

from dcap.scene.errors import GeometryError
from dcap.scene.settings import PROJECT_ROOT
from dcap.scene.types.choices import Anchor
from dcap.scene.types.measures import Drift
from dcap.scene.types.sample import GivenPlace, Sample
from dcap.scene.types.segmentation import SegmentedObject
from dcap.scene.types.settled import EndPose
from flows.methods import place_by
from flows.place import STAGES, PlaceConfig, place
from flows.repeats import COARSER
from tasks.artifact import Ref, Store
from tasks.cache import Stage, plain_input
from tasks.drop.stage import drop_task
from tasks.particles.config import ParticlesConfig
from tasks.posed.stage import posed

FLOWS = PROJECT_ROOT / "flows"
MISTAKES = {
    "swapped": ("rotation, sample.prompt, config=config.anchor", "anchor, sample.prompt, config=config.anchor"),
    "another_kind": (
        "scene, item, intent, anchor, materials, sample.seed",
        "scene, item, anchor, intent, materials, sample.seed",
    ),
    "left_out": (
        "materials_task(scene, item, intent, anchor, sample.prompt",
        "materials_task(scene, item, intent, anchor",
    ),
    "text_for_a_reference": ("rotation_task(scene, item, intent", 'rotation_task(scene, item, "intent"'),
    "earlier_result": ("render_task(scene, item, anchor, settled", "render_task(scene, item, anchor, particles"),
    "config_of_another": ("object_surface, config=config.render", "settled, config=config.drop"),
    "unknown_setting": ("freed=freed, cells=config.particles", "freed=freed, settings=config.particles"),
    "object_for_scene": ("render_task(scene, item", "render_task(item, scene"),
    "wrong_field": ("        intent=intent,\n", "        intent=anchor,\n"),
}
"""Names and edits of mistakes that a person could make in the flow."""
REPEATS = {
    "first_drop": ("settled = drop_task(particles, anchor", "settled = drop_task(particles, intent"),
    "no_end": ("ended=elsewhere, freed", "ended=settled, freed"),
}
"""And where a drop is repeated."""


@pytest.mark.long
@pytest.mark.slow
def test_wrong_wiring_is_a_type_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each mistake in the flow is an error of mypy in its own file; the flow as it is has none."""
    for file, mistakes in (("place.py", MISTAKES), ("repeats.py", REPEATS)):
        text = (FLOWS / file).read_text()
        for name, (right, wrong) in mistakes.items():
            assert text.count(right) == 1, name
            (tmp_path / f"{name}.py").write_text(text.replace(right, wrong))
        shutil.copy(FLOWS / file, tmp_path / f"as_it_is_{file}")
    monkeypatch.chdir(PROJECT_ROOT)  # where the settings lie, and what mypy remembers of the last check
    found, trouble, _ = api.run([str(path) for path in sorted(tmp_path.glob("*.py"))])
    assert not trouble
    wrong_files = {Path(line.partition(":")[0]).stem for line in found.splitlines() if ": error:" in line}
    assert wrong_files == {*MISTAKES, *REPEATS}


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Names of the stages that are called, none of which computes anything."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    called: list[str] = []

    def note(stage: Stage[..., object], *_: object, **named: object) -> Ref[object]:
        called.append(stage.name)
        for name in named.keys() - {"config"}:
            plain_input(name, named[name])  # a value that no record can keep is an error
        return Ref("Nothing", "0" * 64)

    monkeypatch.setattr(Stage, "__call__", note)
    return called


@pytest.fixture
def sample(tmp_path: Path) -> Sample:
    """A triangle that is put on a triangle."""
    mesh = tmp_path / "triangle.obj"
    mesh.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    return Sample("one", str(mesh), str(mesh), "put it there")


@pytest.mark.parametrize(("elsewhere", "broke", "goes"), [(0, False, 1), (1, False, 2), (9, False, 3), (0, True, 2)])
def test_the_list_of_stages_is_the_path_of_a_placement(
    monkeypatch: pytest.MonkeyPatch, called: list[str], sample: Sample, *, elsewhere: int, broke: bool, goes: int
) -> None:
    """`place` calls exactly the stages of STAGES, in that order; where the object ended elsewhere than was
    foreseen, so many times, it is dropped up to twice more, and once more where the drop broke down."""
    answers = iter([EndPose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))] * elsewhere + [None])
    monkeypatch.setattr("flows.repeats.ended_elsewhere", lambda _: next(answers))
    monkeypatch.setattr("flows.repeats.broke_down", lambda _: broke)
    place(sample, PlaceConfig())
    names = [stage.name for stage in STAGES]
    dropped = names.index("drop") + 1
    assert called == [*names[:dropped], *["particles", "drop"] * (goes - 1), *names[dropped:]]


@pytest.mark.parametrize(("elsewhere", "broke"), [(1, False), (0, True)])
def test_a_repeat_that_is_refused_leaves_the_first_drop(
    monkeypatch: pytest.MonkeyPatch, called: list[str], sample: Sample, *, elsewhere: int, broke: bool
) -> None:
    """Its cells may be too coarse, or too many."""
    answers = iter([EndPose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))] * elsewhere + [None])
    monkeypatch.setattr("flows.repeats.ended_elsewhere", lambda _: next(answers))
    monkeypatch.setattr("flows.repeats.broke_down", lambda _: broke)
    calls: list[object] = []

    def drop_once(*given: Any, **options: Any) -> Any:
        calls.append(given)
        if len(calls) > 1:
            raise GeometryError("too few particles")
        return drop_task(*given, **options)

    monkeypatch.setattr("flows.repeats.drop_task", drop_once)
    place(sample, PlaceConfig())
    assert len(calls) == 2
    assert called[-1] == [stage.name for stage in STAGES][-1]


@pytest.mark.parametrize(("method", "ways"), [("no_drop", ["rotation", "anchor"]), ("holodeck", ["holodeck"])])
def test_a_method_that_drops_nothing_poses_what_it_proposes(
    called: list[str], sample: Sample, method: str, ways: list[str]
) -> None:
    """It reads both files by the stages of `place`, and the proposal takes the place of the drop."""
    place_by(replace(sample, method=method), PlaceConfig())
    names = [stage.name for stage in STAGES]
    read = names[: names.index("intent") + 1]
    assert called == [*read, *ways, "materials", "particles", "posed", "render"]


@pytest.mark.parametrize(("method", "pointed"), [("no_drop", True), ("rigid_drop", True), ("holodeck", False)])
def test_a_given_place_is_taken_by_ours_and_what_is_left_of_it(
    monkeypatch: pytest.MonkeyPatch, called: list[str], sample: Sample, method: str, *, pointed: bool
) -> None:
    """Ablations leave one idea out, and not the place with it; baselines find their own."""
    monkeypatch.setattr("flows.repeats.ended_elsewhere", lambda _: None)
    place_by(replace(sample, method=method, place=GivenPlace(at=(0.2, 0.2, 0.0))), PlaceConfig())
    assert ("point" in called) is ("point_out" in called) is pointed


@pytest.mark.parametrize(
    ("broke", "nodes", "again"), [(False, False, False), (True, False, True), (True, True, False)],
    ids=["holds", "a pose", "a dent"],
)  # fmt: skip
def test_a_pose_that_breaks_is_simulated_on_once_more_on_larger_cells(
    monkeypatch: pytest.MonkeyPatch, called: list[str], sample: Sample, *, broke: bool, nodes: bool, again: bool
) -> None:
    """As a drop that breaks is; a dent is known on its own cells alone."""
    drift = Store.default().save(Drift(0.0, 0, np.inf, np.inf, np.inf, "a step broke" if broke else "", broken=broke))
    kept = (np.zeros((1, 3), dtype=np.float32),) if nodes else ()
    state = replace(posed(SegmentedObject(thing("ball", block((0, 0, 0), (1, 1, 1)))), upright()), nodes=kept)
    values = {"drift": drift, "posed": Store.default().save(state)}
    note = Stage.__call__

    def noted(stage: Stage[..., object], *given: object, **named: object) -> Ref[object]:
        if stage.name == "particles":
            assert isinstance(named["config"], ParticlesConfig)
            cells.append(named["config"].coarser)
        return values.get(stage.name) or note(stage, *given, **named)

    cells: list[float] = []
    monkeypatch.setattr(Stage, "__call__", noted)
    place_by(replace(sample, method="no_drop"), PlaceConfig(measured=True, compared=True))
    assert cells == [1.0, *([COARSER] * again)]


def upright() -> Anchor:
    """An anchor that leaves the object where it is."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    return Anchor("bed", "mattress", 1, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.0, square, "test")


@pytest.mark.slow
def test_whoever_plans_and_writes_does_not_load_the_solver() -> None:
    """Taichi takes seconds."""
    code = "import sys, flows.benchmark, flows.place_one, flows.plan; sys.exit('taichi' in sys.modules)"
    assert subprocess.run([sys.executable, "-P", "-c", code], check=False).returncode == 0
