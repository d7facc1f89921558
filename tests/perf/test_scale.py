"""What a run cost: every computation once, and what a larger data set takes."""

import json
from pathlib import Path

import pytest

from dcap.evaluation.methods import joined_id
from dcap.evaluation.run_folder import placement_folder
from dcap.scene.errors import InputError
from perf.scale import busy_share, computed, cost_of, forecast_table, placements, stage_table

SHARED = {"segment": 4.0, "segment_object": 0.5}


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Two samples in one scene, one in another; a second method has the first one's reading of each sentence."""
    asked = []
    for method, own in (("dcap", "drop"), ("holodeck", "holodeck")):
        for number, (name, scene) in enumerate((("a", "1"), ("b", "1"), ("c", "2"))):
            named = name if method == "dcap" else joined_id(method, name)
            asked.append({"id": named, "scene": scene, "object": "ball.glb"})
            folder = placement_folder(tmp_path, method, name)
            folder.mkdir(parents=True)
            timings = {**SHARED, "intent": 0.1, own: 10.0 + number if own == "drop" else 2.0}
            (folder / "placement.json").write_text(json.dumps({"timings": timings}))
    (tmp_path / "run.json").write_text(json.dumps({"samples": asked}))
    (tmp_path / "summary.json").write_text(json.dumps({"wall_s": 40.0}))
    return tmp_path


def test_a_stage_counts_once_for_all_that_share_it(run: Path) -> None:
    """Of a scene, an object, a sample; the first method pays for what both have."""
    stages = list(computed(placements(run)))
    count = {name: sum(one.stage == name for one in stages) for name in ("segment", "segment_object", "intent", "drop")}
    assert count == {"segment": 2, "segment_object": 1, "intent": 3, "drop": 3}
    cost = cost_of(placements(run), stages, 1.0)
    assert (cost.scene, cost.thing) == (4.0, 0.5)
    assert cost.placement == pytest.approx({"dcap": 11.1, "holodeck": 2.0})
    assert cost.seconds(scenes=10, objects=2, prompts=5) == pytest.approx(10 * (4.0 + 5 * 13.1) + 2 * 0.5)


def test_hours_fall_with_cores_but_not_below_what_one_program_takes(run: Path) -> None:
    """That of the program is of all placements, by each method."""
    found = placements(run)
    cost = cost_of(found, list(computed(found)), 0.5)
    shown = forecast_table(cost, scenes=1000, objects=1, prompts=1, cores=[1, 10], main=0.9)
    cells = [list(column.cells) for column in shown.columns]
    assert cells == [["1 cores", "10 cores"], ["9.5", "1.0"], ["0.5", "0.5"]]


def test_parts_of_a_run_are_in_the_order_of_its_samples(run: Path) -> None:
    """Drops of 10, 11 and 12 s: the first, second and third quarter."""
    shown = stage_table(list(computed(placements(run))))
    row = next(cells for cells in zip(*(column.cells for column in shown.columns), strict=True) if cells[0] == "drop")
    assert row[1:] == ("3", "11.00", "11.00", "11.90", "12.0", "33", "10.00", "11.00", "12.00", "-")


def test_a_run_that_did_not_compute_its_stages_is_refused(run: Path) -> None:
    """They took longer than its workers had; and a run that has not ended says nothing of their time."""
    stages = list(computed(placements(run)))
    assert busy_share(run, stages, workers=2) == pytest.approx(47.8 / 80.0)
    with pytest.raises(InputError, match="computed all of them"):
        busy_share(run, stages, workers=1)
    (run / "summary.json").unlink()
    with pytest.raises(InputError, match="has not ended"):
        busy_share(run, stages, workers=2)
