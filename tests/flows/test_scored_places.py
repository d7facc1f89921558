"""Columns of the right place, from a sample's files: each mistake by a known distance or angle is told as such."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import dented_bed
import numpy as np
import pytest

from dcap.evaluation.metrics.right_place import TOLERANCE_M
from dcap.evaluation.outcome_table import AS_POSED, AT_REST, ExpectedOutcome, SampleOutcome
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject
from flows.scoring import meant_regions, scored_row
from tasks.artifact import Store

SAMPLE = Sample("no_drop/a", "room", "ball", "put the ball at the center of the bed", method="no_drop")
TRUTH = ExpectedOutcome(base="bed", part="body", region="center", feasible=True, reason="", base_id="bed")
MEASURES: JsonObject = {
    "support_id": "bed", "support_label": "bed", "support_part": "body", "middle": [0.0, 0.0, 0.5],
    "front": [0.0, 1.0, 0.0], "penetration_m": 0.0, "penetration_given_m": 0.0, "gap_m": 0.0,
    "contact_area_m2": 0.01, "com_margin_m": 0.05,
}  # fmt: skip
STAYS: JsonObject = {"seconds": 1.0, "steps": 20, "distance_m": 0.0, "angle_rad": 0.0, "force_residual": 0.0,
                     "reason": "", "broken": False}  # fmt: skip


@pytest.fixture(autouse=True)
def own_store(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A store of these tests alone."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path_factory.getbasetemp() / "places"))


def tree_of(verdict: str = AS_POSED, turn_deg: float = 0.0) -> JsonObject:
    """placement.json of the ball on the bed, turned about the vertical."""
    half = 0.5 * np.radians(turn_deg)
    return {
        "verdict": verdict, "base": {"id": "bed", "label": "bed"}, "part": "body", "region": "center",
        "visible_fraction": 1.0, "object_aabb": [[-0.1, -0.1, 0.5], [0.1, 0.1, 0.7]],
        "pose": {"position": [0.0, 0.0, 0.6], "quaternion": [float(np.cos(half)), 0.0, 0.0, float(np.sin(half))]},
    }  # fmt: skip


BOX = np.asarray(tree_of()["object_aabb"], dtype=float)


def row(
    folder: Path, truth: ExpectedOutcome | None = TRUTH, *, verdict: str = AS_POSED, turn_deg: float = 0.0,
    drift: JsonObject = STAYS, referee: JsonObject | None = None, **measures: Any,
) -> SampleOutcome:  # fmt: skip
    """The row of what was measured so."""
    scene = Store.default().save(dented_bed.scene_of()).to_json()
    kept = {"scene": scene, "measures": MEASURES | measures, "drift": drift, "referee": referee}
    (folder / "measures.json").write_text(json.dumps(kept))
    return scored_row(SAMPLE, tree_of(verdict, turn_deg), "", truth, folder)


def test_what_is_right_is_told_so(tmp_path: Path):
    """Everything that was stated is met, and nobody could ask for more."""
    found = row(tmp_path)
    assert (found.method, found.sample, found.verdict) == ("no_drop", "a", AS_POSED)
    assert (found.support_hit, found.part_hit, found.region_distance_m, found.as_expected) == (True, True, 0.0, True)
    assert (found.com_supported, found.right_place, found.physics_naturalness) == (True, 10.0, 10.0)


@pytest.mark.parametrize(
    ("measures", "support", "part"),
    [
        ({"support_id": "floor", "support_label": "floor"}, False, False),
        ({"support_part": "pillow"}, True, False),
        ({"support_id": "bed_2"}, False, False),
        ({"support_id": "", "support_label": "", "support_part": ""}, False, False),
    ],
    ids=["another thing", "another part", "another bed", "nothing"],
)
def test_another_support_or_part_is_no_hit(tmp_path: Path, measures: dict[str, Any], support: bool, part: bool):
    """A part of another thing is never the one that was meant; either way it is not as expected and scores less."""
    found = row(tmp_path, **measures)
    assert (found.support_hit, found.part_hit, found.as_expected) == (support, part, False)
    assert found.right_place is not None
    assert found.right_place < 10.0


def test_what_is_at_rest_elsewhere_is_not_as_expected_whatever_it_says_of_itself(tmp_path: Path):
    """Its placement.json names the bed; under it is the floor."""
    assert row(tmp_path, verdict=AT_REST).as_expected is True
    found = row(tmp_path, verdict=AT_REST, support_id="floor", support_label="floor")
    assert (found.base, found.support_hit, found.as_expected) == ("bed", False, False)


def test_a_step_that_broke_leaves_drift_and_force_unknown(tmp_path: Path):
    """It says something of the cells: the score is that of what is known."""
    broke = STAYS | {"seconds": 0.0, "distance_m": None, "angle_rad": None, "force_residual": None, "broken": True}
    found = row(tmp_path, drift=broke)
    assert (found.drift_m, found.drift_deg, found.force_residual, found.drift_s) == (None, None, None, 0.0)
    assert found.physics_naturalness == 10.0


def outline() -> np.ndarray:
    """The region that was meant, shape (k, 2) [m]."""
    scene = Store.default().save(dented_bed.scene_of()).to_json()
    (polygon,) = meant_regions(scene, TRUTH, BOX)
    return polygon


@pytest.mark.parametrize("miss", [0.5 * TOLERANCE_M, 0.1, 0.3])
def test_a_region_is_missed_by_its_distance(tmp_path: Path, miss: float):
    """Off its +x side, in plan; up to a finger's breadth counts as in it."""
    edge = float(outline()[:, 0].max())
    found = row(tmp_path, middle=[edge + miss, 0.0, 0.1])
    assert found.region_distance_m == pytest.approx(miss, abs=1e-9)
    assert found.as_expected == (miss <= TOLERANCE_M)
    inside = row(tmp_path, middle=[edge - 1e-3, 0.0, 0.1])
    assert (inside.region_distance_m, inside.as_expected) == (0.0, True)
    assert found.right_place is not None
    assert inside.right_place is not None
    assert found.right_place <= inside.right_place


def test_a_farther_miss_never_scores_better(tmp_path: Path):
    edge = float(outline()[:, 0].max())
    scores = [row(tmp_path, middle=[edge + miss, 0.0, 0.5]).right_place or 0.0 for miss in (0.0, 0.05, 0.2, 0.5, 2.0)]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > scores[-1]


@pytest.mark.parametrize(("turn_deg", "right"), [(0.0, True), (30.0, True), (60.0, False), (180.0, False)])
def test_a_direction_is_off_by_its_angle(tmp_path: Path, turn_deg: float, right: bool):
    """A word for a direction holds half a right angle to either side."""
    truth = replace(TRUTH, front=(0.0, 1.0), top="up")
    found = row(tmp_path, truth, turn_deg=turn_deg)
    assert found.orientation_error_deg == pytest.approx(turn_deg, abs=1e-5)
    assert found.as_expected == right


def test_what_floats_has_its_gap_and_scores_less_of_physics_alone(tmp_path: Path):
    """The higher the worse, and right place is as before."""
    scores = []
    for gap in (0.0, 0.01, 0.1, 1.0):
        found = row(tmp_path, gap_m=gap, contact_area_m2=0.0 if gap else 0.01,
                    referee={"drift_m": gap, "drift_deg": 0.0, "supported": True})  # fmt: skip
        assert (found.gap_m, found.referee_drift_m, found.right_place) == (gap, gap, 10.0)
        scores.append(found.physics_naturalness or 0.0)
    assert scores == sorted(scores, reverse=True)
    assert scores[0] > scores[1] > scores[-1]


def test_over_nothing_is_the_worst_gap_and_not_unknown(tmp_path: Path):
    """JSON has no infinity: what is over nothing has null for its gap and its margin. It scores no better than what
    floats a metre up and is over nothing that carries it, and is supported by nothing."""
    nothing: dict[str, Any] = {
        "support_id": "",
        "support_label": "",
        "support_part": "",
        "com_margin_m": None,
        "contact_area_m2": 0.0,
    }
    falls = STAYS | {"distance_m": 4.9, "force_residual": 1.0}
    found = row(tmp_path, **nothing, gap_m=None, drift=falls)
    high = row(tmp_path, **nothing, gap_m=1.0, drift=falls)
    assert found.gap_m == np.inf
    assert (found.com_supported, found.support_hit, found.placeit3d_physical) == (False, False, False)
    assert found.physics_naturalness is not None
    assert found.physics_naturalness == high.physics_naturalness
    assert found.physics_naturalness < (row(tmp_path).physics_naturalness or 0.0)


def test_the_centre_of_mass_is_carried_up_to_the_rim(tmp_path: Path):
    """Its margin counts from 0; without a contact nothing is."""
    assert [row(tmp_path, com_margin_m=one).com_supported for one in (0.01, 0.0, -0.01, None)] == [
        True, True, False, False,
    ]  # fmt: skip


def test_what_nobody_stated_is_no_mistake(tmp_path: Path):
    """Without a truth there are no hits and no word on what was expected; physics is measured all the same."""
    found = row(tmp_path, None, support_id="floor", support_label="floor")
    assert (found.support_hit, found.part_hit, found.region_distance_m, found.as_expected) == (None,) * 4
    assert found.physics_naturalness == 10.0
    open_place = replace(TRUTH, part="", region="")
    found = row(tmp_path, open_place, middle=[5.0, 5.0, 0.0])
    assert (found.support_hit, found.part_hit, found.region_distance_m, found.as_expected) == (True, None, None, True)


def test_what_came_to_rest_is_as_expected_by_its_own_verdict(tmp_path: Path):
    """Hits are measured for it too, but region and part that it says of itself count."""
    edge = float(outline()[:, 0].max())
    found = row(tmp_path, verdict=AT_REST, middle=[edge + 0.3, 0.0, 0.5])
    assert found.region_distance_m == pytest.approx(0.3)
    assert found.as_expected


def test_a_damaged_placement_is_told(tmp_path: Path) -> None:
    """A key that is missing, or holds something else, is no error of ours."""
    row(tmp_path)  # writes what was measured
    no_turn: JsonObject = {"position": [0.0, 0.0, 0.6]}
    short: JsonObject = {**no_turn, "quaternion": [1.0]}
    poses: list[JsonObject] = [{"pose": one} for one in (None, no_turn, short, {**no_turn, "quaternion": [0.0] * 4})]
    damages: list[JsonObject] = [*poses, {"object_aabb": [[0.0]]}, {"base": {}}]
    for damage in damages:
        with pytest.raises(InputError, match="the file is damaged"):
            scored_row(SAMPLE, {**tree_of(), **damage}, "", TRUTH, tmp_path)


def test_a_meant_region_is_on_the_part_that_was_meant():
    """The middle third of the bed's top about its middle; other words are elsewhere; a place beside something, another
    scene's base and no words at all say nothing."""
    scene = Store.default().save(dented_bed.scene_of()).to_json()
    polygon = outline()
    np.testing.assert_allclose(polygon.mean(axis=0), [0.0, 0.0], atol=1e-9)
    assert (np.abs(polygon) < [0.8, 1.0]).all()
    (left,) = meant_regions(scene, replace(TRUTH, region="left"), BOX)
    (right,) = meant_regions(scene, replace(TRUTH, region="right"), BOX)
    # the bed looks to -y: who looks at it from there has +x on the right
    assert left.mean(axis=0)[0] < -0.1 < 0.1 < right.mean(axis=0)[0]
    for truth in (
        replace(TRUTH, region=""),
        replace(TRUTH, region="near"),
        replace(TRUTH, base_id="bed_7"),
        replace(TRUTH, base="sofa", base_id=""),
    ):
        assert meant_regions(scene, truth, BOX) == ()
    assert meant_regions(None, TRUTH, BOX) == ()
    # by its label, one region for each of that name
    assert len(meant_regions(scene, replace(TRUTH, base="wall", base_id="", part=""), BOX)) == 2
