"""A stage that is computed again is named as a person knows it."""

from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from flows.benchmark import stages_to_refresh
from flows.place import PlaceConfig
from flows.sample_run import Plan, StagePlan, StageState

SAMPLE = Sample("one", "room.obj", "ball.obj", "put it there")


@pytest.fixture(autouse=True)
def planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample that is measured, too."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    plan = Plan(SAMPLE, (), "", "", stages=(StagePlan("measure", StageState.CACHED, None),))
    monkeypatch.setattr("flows.benchmark.plan_ahead", lambda sample, config: plan)


@pytest.mark.parametrize(
    ("stage", "refreshed"),
    [("mesh", {"mesh_scene", "mesh_object"}), ("drop", {"drop"}), ("overview", {"overview"}), ("measure", {"measure"})],
)
def test_a_word_for_stages(stage: str, refreshed: set[str]) -> None:
    """`mesh` is both meshes; what only this sample has (its measures) is known from its plan."""
    assert stages_to_refresh(stage, SAMPLE, PlaceConfig()) == refreshed


def test_a_stage_that_there_is_not() -> None:
    """The message lists what there is for this sample."""
    with pytest.raises(InputError, match=r"--stage 'cook' is not one of mesh, mesh_scene, .*, measure"):
        stages_to_refresh("cook", SAMPLE, PlaceConfig())
