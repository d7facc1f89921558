"""A plan says of every stage whether its result is there, and goes on behind the first one whose is not."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pydantic import BaseModel
from written_records import write_record

from dcap.scene.errors import InputError
from dcap.scene.json_tree import to_json
from dcap.scene.store.artifacts import Source, Store
from dcap.scene.store.ref import Ref
from dcap.scene.types.materials import Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import Sample
from flows.display import print_plan
from flows.look_ahead import plan_ahead
from flows.place import PlaceConfig
from flows.plan import plan_row
from flows.sample_run import plan_sample
from tasks.runner.stage import Stage, stage

FOAM = Material("foam", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "test")


class StretchConfig(BaseModel, frozen=True, extra="forbid"):
    """A setting."""

    factor: float = 1.0


def read_one(source: Source) -> Mesh:
    raise NotImplementedError


def read_other(source: Source) -> Mesh:
    raise NotImplementedError


def stretch(mesh: Mesh, config: StretchConfig) -> Mesh:
    raise NotImplementedError


def join(one: Mesh, other: Mesh, prompt: str) -> Mesh:
    raise NotImplementedError


TASKS: list[Stage[..., Mesh]] = [stage(one) for one in (read_one, read_other, stretch, join)]


@pytest.fixture
def sample(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Sample:
    """A sample whose two branches meet in a last stage, after which the result itself is looked at."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    for name in ("room", "ball"):
        (tmp_path / f"{name}.obj").write_text(f"# {name}\n")
    return Sample("one", str(tmp_path / "room.obj"), str(tmp_path / "ball.obj"), "put it there")


def pipeline(factor: float = 1.0, *, look: bool = False) -> Callable[[Sample, PlaceConfig], object]:
    """Reads both files, stretches the first, joins the two; may look at what came of it."""

    def place(sample: Sample, config: PlaceConfig) -> object:
        one, other = (
            TASKS[0](Store.default().add_source(sample.scene)),
            TASKS[1](Store.default().add_source(sample.object)),
        )
        long = TASKS[2](one, config=StretchConfig(factor=factor))
        joined = TASKS[3](long, other, sample.prompt)
        return Store.default().load(joined) if look else joined

    return place


def computed(sample: Sample) -> None:
    """Records of all stages, as a run leaves them."""
    store = Store.default()
    found = Store.default().save(FOAM)
    sources = [store.add_source(one) for one in (sample.scene, sample.object)]
    joined: dict[str, object] = {"one": found, "other": found, "prompt": sample.prompt}
    inputs: list[dict[str, object]] = [{"source": sources[0]}, {"source": sources[1]}, {"mesh": found}, joined]
    for task, given in zip(TASKS, inputs, strict=True):
        config = StretchConfig() if task.name == "stretch" else None
        write_record(task.deciders(given, config), Ref("Material", found.sha256))


def test_all_is_there(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing would run, and nothing is told as a reason."""
    monkeypatch.setattr("flows.sample_run.place_by", pipeline())
    computed(sample)
    row = plan_row(plan_ahead(sample, PlaceConfig()))
    assert (row.runs, row.why, row.may_run) == (None, None, ())
    assert to_json(row.stages) == [
        {"stage": name, "state": "cached", "why": None} for name in ("read_one", "read_other", "stretch", "join")
    ]


def test_a_changed_setting_leaves_the_other_branch_alone(
    sample: Sample, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The stage whose setting changed runs and says so; what takes its result may run; the others are cached."""
    computed(sample)
    monkeypatch.setattr("flows.sample_run.place_by", pipeline(2.0))
    plan = plan_ahead(sample, PlaceConfig())
    told = [(one.stage, str(one.state), one.why) for one in plan.stages]
    assert told == [
        ("read_one", "cached", None),
        ("read_other", "cached", None),
        ("stretch", "runs", "settings changed: stretch.factor (1.0 -> 2.0)"),
        ("join", "may_run", "depends on stretch"),
    ]
    row = plan_row(plan)
    assert (row.cached, row.runs, row.may_run) == (("read_one", "read_other"), "stretch", ("join",))
    print_plan([plan], stages=True)
    said = capsys.readouterr().out
    assert "2 of 4" in said
    assert "may run join" in said


def test_two_files_have_two_reasons(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both readers would run: the second is not hidden by the first."""
    computed(sample)
    monkeypatch.setattr("flows.sample_run.place_by", pipeline())
    for path in (sample.scene, sample.object):
        Path(path).write_text("# another\n")
    stages = plan_ahead(sample, PlaceConfig()).stages
    assert [(one.stage, one.why) for one in stages if one.state == "runs"] == [
        ("read_one", "input source: new or changed file room.obj"),
        ("read_other", "input source: new or changed file ball.obj"),
    ]


def test_what_is_pending_cannot_be_looked_at(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a result decides how it goes on, the stages of a placement that are left may run."""
    monkeypatch.setattr("flows.sample_run.place_by", pipeline(look=True))
    plan = plan_ahead(sample, PlaceConfig())
    assert plan.failed is None
    assert plan.missing == "read_one"
    assert (plan.stages[-1].stage, plan.stages[-1].why) == ("render", "depends on join")
    plan = plan_sample(sample, PlaceConfig(measured=True))
    assert plan.whole[-2:] == ("measure", "indentation")
    measured = PlaceConfig(measured=True, compared=True)
    names = [one.stage for one in plan_ahead(sample, measured).stages]
    assert names[-5:] == ["render", "measure", "judged_views", "indentation", "drift"]


def test_a_sample_that_cannot_run_says_why(sample: Sample, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that is not there is told with the user's path."""
    monkeypatch.setattr("flows.sample_run.place_by", pipeline())
    Path(sample.object).unlink()
    plan = plan_ahead(sample, PlaceConfig())
    assert plan.failed is not None
    assert isinstance(plan.failed.error, InputError)
    assert "ball.obj: no such file" in plan.failed.message
