"""The page of a run shows every sample, loads nothing from elsewhere, and counts honestly."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evaluation.outcome_table import Row, Truth, read_truth, row_of, totals
from evaluation.report import write_report
from scene.errors import InputError
from scene.sample import Sample

PROMPTS = ("put the ball at the centre of the bed", "balance the ball on the <lampshade> & stay", "put it on the piano")


def placement(verdict: str, reason: str | None) -> dict[str, object]:
    """The keys of placement.json that the page uses."""
    return {
        "verdict": verdict,
        "reason": reason,
        "message": "no piano; there are bed and sofa" if reason == "target_not_found" else None,
        "base": {"id": "4", "label": "bed"},
        "part": "mattress",
        "region": "center",
        "region_missed": False,
        "mass": 0.4,
        "scale": 1.0,
        "visible_fraction": 0.9,
        "timings": {"mesh": 1.5, "drop": 6.0},
        "contacts": [{"area_m2": 1e-3, "normal_force_n": 3.9}],
        "materials": [{"body": "object", "part": "body", "material": "rubber"}],
        "warnings": ["mattress cropped to 0.8 m"],
    }


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, list[Row]]:
    """A run of three samples and one that failed."""
    outcomes = (("at_rest", None), ("infeasible", "toppled"), ("infeasible", "target_not_found"))
    truths = (Truth("bed", "mattress", "center", True, ""), Truth("lamp", "shade", "", False, "left_target"),
              Truth("", "", "", False, "target_not_found"))  # fmt: skip
    rows = []
    for index, (prompt, (verdict, reason), truth) in enumerate(zip(PROMPTS, outcomes, truths, strict=True)):
        sample = Sample(f"room-{index}", "room", "ball.glb", prompt)
        folder = tmp_path / "samples" / sample.id
        folder.mkdir(parents=True)
        tree = placement(verdict, reason)
        (folder / "placement.json").write_text(json.dumps(tree))
        if reason != "target_not_found":
            for name in ("clean", "settled", "closeup"):
                Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(folder / f"{name}.png")
        rows.append(row_of(sample, tree, "", truth))
    rows.append(row_of(Sample("room-3", "room", "x", "put"), None, "x: no such file", None))
    return tmp_path, rows


def test_totals_count_what_is_there(run: tuple[Path, list[Row]]) -> None:
    """A wrong reason is not a right one, and a failure is neither feasible nor infeasible."""
    counts = totals(run[1])
    assert counts["samples"] == 4
    assert (counts["at_rest"], counts["infeasible"], counts["failed"]) == (1, 2, 1)
    assert (counts["feasible_as_intended"], counts["feasible_intended"]) == (1, 1)
    assert (counts["infeasible_with_right_reason"], counts["infeasible_intended"]) == (1, 2)


def test_intended_feasibility_is_not_read_from_words() -> None:
    """A support whose label begins with "infeasible" does not make its sample an infeasible one."""
    tree = placement("at_rest", None) | {"base": {"id": "4", "label": "infeasible table"}, "part": ""}
    truth = Truth("infeasible table", "", "", True, "")
    row = replace(row_of(Sample("a", "s", "o", "p"), tree, "", truth), expected="infeasible table")
    counts = totals([row])
    assert (counts["feasible_as_intended"], counts["feasible_intended"], counts["infeasible_intended"]) == (1, 1, 0)


def test_the_page_shows_every_sample(run: tuple[Path, list[Row]]) -> None:
    """Each prompt, picture, reason and error is on the page, escaped, and every link leads to a file of the run."""
    folder, rows = run
    page = write_report(folder, rows, {**totals(rows), "wall_s": 3.0}).read_text()
    assert page.count('<article class="card') == 4
    assert "balance the ball on the &lt;lampshade&gt; &amp; stay" in page
    for words in (PROMPTS[0], "infeasible: toppled", "no piano; there are bed and sofa", "x: no such file", "1.50 s"):
        assert words in page
    links = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert sum(link.endswith(".png") for link in links) == 2 * 2 * 3
    for link in links:
        assert not re.match(r"(https?:)?//", link)
        if link.endswith(".png"):
            assert (folder / link).is_file()


def test_truth_is_read_strictly() -> None:
    """Truth comes as a list or by id, and a mistyped key is an error."""
    by_id = read_truth({"a": {"feasible": False, "reason": "toppled"}}, "truth.yaml")
    assert by_id == read_truth([{"id": "a", "feasible": False, "reason": "toppled"}], "truth.yaml")
    with pytest.raises(InputError, match="did you mean 'reason'"):
        read_truth({"a": {"reasons": "toppled"}}, "truth.yaml")


@pytest.mark.parametrize(
    ("change", "agreed"),
    [({}, True), ({"region_missed": True}, False), ({"part": "frame"}, False), ({"verdict": "infeasible"}, False)],
)
def test_agreement(change: dict[str, object], agreed: bool) -> None:
    """A feasible sample agrees if it is at rest on the intended part and in its region."""
    truth = Truth("bed", "mattress", "center", True, "")
    row = row_of(Sample("a", "s", "o", "p"), placement("at_rest", None) | change, "", truth)
    assert row.as_expected is agreed
