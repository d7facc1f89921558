"""Columns of PlaceIt3D's rules: from the files of a sample and what the store still has."""

import json
from dataclasses import replace
from pathlib import Path

import dented_bed
import numpy as np
import pytest

from dcap.evaluation.outcome_table import ExpectedOutcome, SampleOutcome
from dcap.scene.types.choices import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject
from flows.scoring import scored_row
from tasks.artifact import Store

SAMPLE = Sample("a", "room", "ball", "put the ball on the bed near the lamp, facing the wall_back")
BALL = [[-0.1, -0.1, 0.47], [0.1, 0.1, 0.67]]
"""The ball in its dent: 3 cm below the bed's top."""
MEASURES: JsonObject = {
    "support_id": "bed", "support_label": "bed", "support_part": "body", "middle": [0.0, 0.0, 0.47],
    "front": [0.0, 1.0, 0.0], "penetration_m": 5e-5, "penetration_given_m": 0.03, "gap_m": 0.0,
    "contact_area_m2": 0.01, "com_margin_m": 0.05,
}  # fmt: skip


@pytest.fixture(scope="module")
def reading() -> Intent:
    """Near a lamp and towards the wall behind the bed; the base is another than the truth's."""
    return Intent(
        "floor", "floor", "ball", np.full(3, 0.2), 1.0, False, 1.0, OrientationRequest("any", "wall_back", ""),
        RegionRequest("", ("near",), ("lamp", "part:pillow"), ""), (), (),
    )  # fmt: skip


def tree_of() -> JsonObject:
    """placement.json of the ball."""
    pose: JsonObject = {"position": [0.0, 0.0, 0.57], "quaternion": [1.0, 0.0, 0.0, 0.0]}
    return {"verdict": "at_rest", "base": {"id": "bed", "label": "bed"}, "object_aabb": BALL, "pose": pose}


def row(
    folder: Path, reading: Intent | None, measures: JsonObject = MEASURES, *, lamp: float = 0.06,
    truth: ExpectedOutcome | None = None,
) -> SampleOutcome:  # fmt: skip
    """The row of the ball with a lamp that far beside it; without a reading in an older file."""
    store = Store.default()
    beside = dented_bed.box_mesh((0.1 + lamp, -0.1, 0.5), (0.3 + lamp, 0.1, 0.9))
    kept: JsonObject = {"scene": store.save(dented_bed.scene_of(lamp=beside)).to_json(), "measures": measures}
    if reading:
        kept["intent"] = store.save(reading).to_json()
    folder.mkdir(exist_ok=True)
    (folder / "measures.json").write_text(json.dumps(kept))
    return scored_row(SAMPLE, tree_of(), "", truth, folder)


def columns(row: SampleOutcome) -> tuple[int | bool | None, ...]:
    return (
        row.placeit3d_spatial_asked,
        row.placeit3d_spatial_met,
        row.placeit3d_rotational_met,
        row.placeit3d_physical,
        row.placeit3d_physical_given,
    )


TRUTH = ExpectedOutcome(base="bed", part="", region="", feasible=True, reason="", base_id="bed")


@pytest.fixture(autouse=True)
def own_store(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A store of these tests alone."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path_factory.getbasetemp() / "rules"))


def test_rules_on_a_ball_in_its_dent(tmp_path: Path, reading: Intent):
    """The room is 6 m by 6 m: near ends at 8.49 cm. The dent is an intersection with the bed as it was given only. The
    bed of the truth counts, not the floor of the reading, and without a truth it is the floor."""
    assert columns(row(tmp_path, reading, truth=TRUTH)) == (2, 2, True, True, False)
    assert columns(row(tmp_path, reading, lamp=0.09, truth=TRUTH)) == (2, 1, True, True, False)
    assert columns(row(tmp_path, reading, MEASURES | {"front": [0.0, -1.0, 0.0]}, truth=TRUTH)) == (
        2,
        2,
        False,
        True,
        False,
    )
    assert columns(row(tmp_path, reading)) == (2, 1, True, True, False)
    nowhere = replace(reading, orientation=OrientationRequest("any", "", ""))
    assert columns(row(tmp_path, nowhere, truth=TRUTH)) == (2, 2, None, True, False)


@pytest.mark.parametrize(
    ("changed", "met", "physical"),
    [
        ({"gap_m": 0.009}, 2, True),
        ({"gap_m": 0.011}, 1, False),
        ({"gap_m": None, "support_id": ""}, 1, False),
        ({"penetration_m": 0.005}, 2, False),
        ({"penetration_m": 0.011}, 1, False),
        ({"support_id": "lamp"}, 1, True),
    ],
)
def test_on_goes_by_the_surface_that_carries(tmp_path: Path, reading: Intent, changed, met, physical):
    """A gap or a penetration of more than a centimetre, or another thing that carries, is not on the bed."""
    found = row(tmp_path, reading, MEASURES | changed, truth=TRUTH)
    assert (found.placeit3d_spatial_met, found.placeit3d_physical) == (met, physical)


def test_without_the_reading_only_physics_is_known(tmp_path: Path, reading: Intent):
    """A file that does not name it, and a store that has lost it."""
    assert columns(row(tmp_path, None, truth=TRUTH)) == (None, None, None, True, False)
    lost = {"scene": {"kind": "Segmentation", "sha256": "0" * 64}, "intent": {"kind": "Intent", "sha256": "0" * 64}}
    (tmp_path / "measures.json").write_text(json.dumps(lost | {"measures": MEASURES}))
    assert columns(scored_row(SAMPLE, tree_of(), "", TRUTH, tmp_path)) == (None, None, None, True, False)


def test_what_was_not_placed_has_no_columns(tmp_path: Path):
    """Neither a refusal nor a failure."""
    refusal: JsonObject = {"verdict": "infeasible", "reason": "no_place"}
    for tree, error in ((refusal, ""), (None, "o: no such file")):
        assert columns(scored_row(SAMPLE, tree, error, TRUTH, tmp_path)) == (None,) * 5
