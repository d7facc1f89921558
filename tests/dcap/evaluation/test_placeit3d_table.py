"""PlaceIt3D's measures by method, counted by hand on a few samples."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest

from dcap.evaluation.outcome_table import AS_POSED, SampleOutcome, row_of
from dcap.evaluation.run_page.placeit3d_table import placeit3d_table, shares_by_method
from dcap.scene.types.sample import Sample

NAMES = {"dcap": "DCAP", "fireplace": "Fire & Place_*"}


def outcome(
    sample: str, asked: int, met: int, facing: bool | None, left: bool, given: bool, method: str = "dcap"
) -> SampleOutcome:
    """A placement that was measured."""
    row = row_of(Sample(sample, "s", "o", "p"), {"verdict": AS_POSED}, "", None)
    return replace(
        row, method=method, placeit3d_spatial_asked=asked, placeit3d_spatial_met=met, feasible_intended=True,
        placeit3d_rotational_met=facing, placeit3d_physical=left, placeit3d_physical_given=given,
    )  # fmt: skip


def refused(sample: str, method: str, *, intended: bool | None = True) -> SampleOutcome:
    """One that was not placed."""
    row = row_of(Sample(sample, "s", "o", "p"), {"verdict": "infeasible", "reason": "no_place"}, "", None)
    return replace(row, method=method, feasible_intended=intended)


OURS = [
    outcome("soft", 1, 1, None, left=True, given=False),
    outcome("both", 2, 1, True, left=True, given=True),
    outcome("turned", 1, 1, False, left=False, given=False),
]
"""Four spatial constraints and two rotational ones; all but one of each hold."""


def test_shares_are_counts_over_counts():
    """Spatial 3 of 4, rotational 1 of 2, physical 2 and 1 of 3: 6 and 5 of 9; one sentence of three is met."""
    found = shares_by_method({"dcap": OURS})["dcap"]
    assert (found["samples"], found["not_placed"], found["constraints"]) == (3, 0, 9)
    assert (found["spatial"], found["rotational"]) == (3 / 4, 1 / 2)
    assert (found["physical"], found["physical_given"]) == (2 / 3, 1 / 3)
    assert (found["all_constraints"], found["all_constraints_given"]) == (6 / 9, 5 / 9)
    assert (found["language"], found["complete"], found["complete_given"]) == (1 / 3, 1 / 3, 0.0)


def test_what_was_not_placed_meets_nothing():
    """It has the constraints of the same sample by other methods, all failed; unknown to them the physical one alone;
    what nobody meant to be possible, or what failed without a stated intent, is left out."""
    theirs = [refused("both", "fireplace"), refused("unknown", "fireplace"),
              refused("impossible", "fireplace", intended=False), refused("unstated", "fireplace", intended=None),
              outcome("soft", 1, 1, None, left=True, given=True, method="fireplace")]  # fmt: skip
    found = shares_by_method({"dcap": OURS, "fireplace": theirs})["fireplace"]
    assert (found["samples"], found["not_placed"], found["constraints"]) == (3, 2, 4 + 1 + 2)
    assert found["all_constraints"] == 2 / 7
    assert (found["spatial"], found["rotational"], found["physical"]) == (1 / 3, 0.0, 1 / 3)
    assert (found["language"], found["complete"]) == (1 / 3, 1 / 3)


def test_what_was_not_measured_is_left_out():
    """Without the reading nothing is known of what was asked; without words nothing can be adhered to."""
    blind = replace(OURS[0], placeit3d_spatial_asked=None, placeit3d_spatial_met=None)
    silent = outcome("silent", 0, 0, None, left=True, given=True)
    found = shares_by_method({"dcap": [blind, silent]})["dcap"]
    assert (found["samples"], found["constraints"]) == (1, 1)
    assert (found["complete"], found["language"], found["spatial"]) == (1.0, None, None)


def test_the_tables_of_a_run(tmp_path: Path):
    """Shares in the CSV, percent elsewhere, both physical ones beside each other; names are escaped for TeX."""
    table = placeit3d_table(tmp_path, {"dcap": OURS, "fireplace": [refused("both", "fireplace")]}, NAMES)
    assert table is not None
    assert table.rows == (
        ("DCAP", "66.7 / 55.6", "33.3 / 0.0", "33.3", "66.7 / 33.3", "75.0", "50.0", "3", "0"),
        ("Fire & Place_*", "0.0 / 0.0", "0.0 / 0.0", "0.0", "0.0 / 0.0", "0.0", "0.0", "1", "1"),
    )
    assert all(len(row) == len(table.head) for row in table.rows)
    rows = list(csv.DictReader((tmp_path / "tables" / "placeit3d.csv").read_text().splitlines()))
    assert [one["method"] for one in rows] == ["dcap", "fireplace"]
    assert float(rows[0]["all_constraints"]) == pytest.approx(6 / 9, abs=1e-4)
    assert (rows[0]["constraints"], rows[0]["language"], rows[1]["spatial"]) == ("9", "0.3333", "0.0000")
    lines = (tmp_path / "tables" / "placeit3d.tex").read_text().splitlines()
    assert "Fire \\& Place\\_* & 0.0 / 0.0" in lines[-3]
    assert len({one.count(" & ") for one in lines if one.endswith("\\\\")}) == 1


def test_without_any_measured_placement_there_is_no_table(tmp_path: Path):
    """Refusals alone say nothing of rules."""
    assert placeit3d_table(tmp_path, {"dcap": [refused("a", "dcap")]}, NAMES) is None
    assert not (tmp_path / "tables").exists()
