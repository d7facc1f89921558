"""A plan says of every stage whether its result is there, and goes on behind the first one whose is not."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import small_stages

from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import Sample
from flows.place import STAGES, PlaceConfig
from flows.plan import plan_row, print_plan
from flows.sample_run import Plan, StagePlan, plan_sample, run_sample
from tasks.artifact import Ref, Source, Store
from tasks.cache import stage
from tasks.run_context import RunContext


def read_one(source: Source) -> Mesh:
    return Mesh.of([[0, 0, 0], [1, 0, 0], [0, len(source.path.read_text()), 0]], [[0, 1, 2]])


def join(one: Mesh, other: Mesh, prompt: str) -> Mesh:
    return one


read_task, other_task, join_task = stage(read_one), stage(read_one, name="read_other"), stage(join)


@pytest.fixture
def sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sample:
    """A sample whose two branches meet in a last stage."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    for name in ("room", "ball"):
        (tmp_path / f"{name}.obj").write_text(f"# {name}\n")
    return Sample("one", str(tmp_path / "room.obj"), str(tmp_path / "ball.obj"), "put it there")


@pytest.fixture
def planned(monkeypatch: pytest.MonkeyPatch, sample: Sample) -> Callable[..., Plan]:
    """Plans the sample; with another factor its first branch is scaled otherwise."""

    def plan(factor: float = 2.0, *, run: bool = False) -> Plan:
        def place(sample: Sample, config: PlaceConfig) -> Ref[Any]:
            one = small_stages.double_task(read_task(Store.default().add_source(sample.scene)), factor)
            return join_task(one, other_task(Store.default().add_source(sample.object)), sample.prompt)

        monkeypatch.setattr("flows.sample_run.place_by", place)
        if run:
            run_sample(sample, PlaceConfig(), RunContext())
        return plan_sample(sample, PlaceConfig())

    return plan


NAMES = ("read_one", "double", "read_other", "join")


def test_nothing_is_there_and_all_is_there(planned: Callable[..., Plan]) -> None:
    """Before a run the readers would run and the others may; after it nothing would, and there is no reason to tell."""
    row = plan_row(planned())
    assert (row.cached, row.runs, row.may_run) == ((), "read_one", ("double", "read_other", "join"))
    assert [one.state for one in row.stages] == ["runs", "may_run", "runs", "may_run"]
    assert row.stages[3].why == "depends on double, read_other"
    assert small_stages.computed() == []
    plan = planned(run=True)
    row = plan_row(plan)
    assert (row.cached, row.runs, row.why, row.may_run) == (NAMES, None, None, ())
    assert plan.finished is not None
    assert [one.stage for one in plan.finished.results] == list(NAMES)


def test_a_change_is_named_and_leaves_the_other_branch_alone(
    planned: Callable[..., Plan], sample: Sample, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stage whose input changed runs and says so; what takes its result may run; the others are cached."""
    planned(run=True)
    plan = planned(3.0)
    assert plan.stages == (
        StagePlan("read_one", "cached", None),
        StagePlan("double", "runs", "input factor 2.0 -> 3.0"),
        StagePlan("read_other", "cached", None),
        StagePlan("join", "may_run", "depends on double"),
    )
    print_plan([plan], stages=True)
    said = capsys.readouterr().out
    assert "2 of 4" in said
    assert "may run join" in said
    for path in (sample.scene, sample.object):
        Path(path).write_text("# another\n")
    runs = [(one.stage, one.why) for one in planned().stages if one.state == "runs"]
    assert runs == [("read_one", "input source differs"), ("read_other", "input source differs")]


def test_a_real_sample_is_planned_to_its_end(sample: Sample) -> None:
    """Where a result decides how it goes on, the way of a feasible placement is foreseen; nothing is computed."""
    names = [one.stage for one in plan_sample(sample, PlaceConfig(measured=True, compared=True)).stages]
    assert names[: len(STAGES)] == [one.name for one in STAGES]
    assert set(names[len(STAGES) :]) == {"measure", "indentation", "drift", "referee"}


def test_a_sample_that_cannot_run_says_why(planned: Callable[..., Plan], sample: Sample) -> None:
    """A file that is not there is told with the user's path."""
    Path(sample.object).unlink()
    plan = planned()
    assert plan.failed is not None
    assert isinstance(plan.failed.error, InputError)
    assert sample.object in plan.why
