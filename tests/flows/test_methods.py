"""What a method changes, setting by setting: each ablation is the whole program but for the one thing it is named
after."""

import pytest

from dcap.evaluation.methods import ABLATIONS, BASELINES, DCAP, METHODS
from dcap.scene.types.sample import Sample
from flows.methods import CHANGES, NO_DROP, OTHER_MATERIALS, PAPER_STEP_SECONDS, PICTURE, RIGID_DROP, config_of
from flows.place import PlaceConfig
from tasks.materials.stage import MaterialsConfig

SAMPLE = Sample("a", "room", "ball", "put the ball on the bed")
TABLE: dict[str, dict[str, object]] = {
    "rigid_drop": {"materials.rigid_above": 1e-3},
    "no_drop": {},
    "no_size_prior": {"intent.smallest_scale": 1.0, "intent.largest_scale": 1.0},
    "no_rotation": {"rotation.chosen": False},
    "no_subpart": {"anchor.subparts": False},
    "face_up": {"anchor.face_up": True},
    "views_12": {"rotation.views": 12},
    "pose_strip": {"rotation.pose_strip": True},
    "blended_materials": {"materials.blended": True},
    "uniform_fill": {"particles.uniform": True},
    "paper": {
        "materials.paper_limits": True,
        "drop.solver.method": "mls",
        "drop.solver.mls_step_seconds": PAPER_STEP_SECONDS,
    },
}
"""All that is not as in the whole program, by ablation; the pose before the drop needs no setting."""


def leaves(tree: object, path: str = "") -> dict[str, object]:
    """Every setting of a configuration by its dotted name."""
    if not isinstance(tree, dict):
        return {path: tree}
    return {name: one for key, value in tree.items() for name, one in leaves(value, f"{path}.{key}".strip(".")).items()}


def changes(method: str, config: PlaceConfig) -> dict[str, object]:
    """The settings that a method has otherwise, and to what."""
    before, after = leaves(config.model_dump()), leaves(config_of(method, config).model_dump())
    assert before.keys() == after.keys()
    return {name: value for name, value in after.items() if value != before[name]}


def given() -> PlaceConfig:
    """A configuration of which each stage that an ablation touches has another setting that is not the usual one."""
    config = PlaceConfig(measured=True, compared=True)
    return config.model_copy(update={
        "intent": config.intent.model_copy(update={"mass_factor": 2.0}),
        "rotation": config.rotation.model_copy(update={"picture_size": 64}),
        "anchor": config.anchor.model_copy(update={"clearance": 0.02}),
        "materials": MaterialsConfig(neighbour_distance=0.1),
        "particles": config.particles.model_copy(update={"cell": 0.01}),
        "render": config.render.model_copy(update={"size": PICTURE // 2}),
        "drop": config.drop.model_copy(update={"solver": config.drop.solver.model_copy(update={"seed": 3})}),
    })  # fmt: skip


@pytest.mark.parametrize("method", METHODS)
def test_a_method_changes_its_one_setting_and_nothing_else(method: str):
    """But for the size of pictures that are for people; ours and the baselines change nothing that decides a pose."""
    small = {} if method == DCAP else {"render.size": PICTURE}
    assert PlaceConfig().render.size > PICTURE
    assert changes(method, PlaceConfig()) == TABLE.get(method, {}) | small


@pytest.mark.parametrize("method", METHODS)
def test_whatever_else_was_asked_for_is_kept(method: str):
    """Also in the stage that the change is of; pictures that are small already stay as they are."""
    assert changes(method, given()) == TABLE.get(method, {})


def test_every_method_is_ours_a_baseline_or_changes_something():
    """But the pose before the drop, which is another path; nothing else is named."""
    assert set(METHODS) == {DCAP, NO_DROP, *BASELINES, *CHANGES}
    assert set(ABLATIONS) == {NO_DROP, *CHANGES} == set(TABLE)
    assert not (set(CHANGES) & {DCAP, NO_DROP, *BASELINES})


def test_a_changed_setting_is_checked_like_any_other():
    """A change goes through the stage's own model: what it makes can be written and read again, types and all."""
    for method in ABLATIONS:
        found = config_of(method, PlaceConfig())
        assert PlaceConfig.model_validate_json(found.model_dump_json()) == found


def test_measured_with_true_materials_is_what_other_materials_were_simulated_with():
    """The methods whose material rows or models differ from the whole program's, and no others."""
    other = {name for name, changed in TABLE.items() if any(key.startswith("materials.") for key in changed)}
    assert other == OTHER_MATERIALS
    assert RIGID_DROP in OTHER_MATERIALS
