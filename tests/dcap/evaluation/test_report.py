"""The page of a run shows every sample, loads nothing from elsewhere, and counts honestly."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dcap.evaluation.outcome_table import ExpectedOutcome, SampleOutcome, read_truth, row_of
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import summary_of
from dcap.language.model.ledger import Spending
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import object_to_json

PROMPTS = ("put the ball at the centre of the bed", "balance the ball on the <lampshade> & stay", "put it on the piano")
LINK = re.compile(r'(?:src|href)="([^"]+)"')


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
        "pose": {"position": [0.0, 0.0, 0.5], "quaternion": [1.0, 0.0, 0.0, 0.0]},
        "mass": 0.4,
        "scale": 1.0,
        "visible_fraction": 0.9,
        "timings": {"mesh": 1.5, "drop": 6.0},
        "contacts": [{"area_m2": 1e-3, "normal_force_n": 3.9}],
        "materials": [{"body": "object", "part": "body", "material": "rubber", "reason": "usual for a <ball>"}],
        "warnings": ["mattress cropped to 0.8 m"],
    }


@pytest.fixture
def run(tmp_path: Path) -> tuple[Path, list[SampleOutcome]]:
    """A run of three samples and one that failed."""
    outcomes = (("at_rest", None), ("infeasible", "toppled"), ("infeasible", "target_not_found"))
    truths = (
        ExpectedOutcome("bed", "mattress", "center", True, ""),
        ExpectedOutcome("lamp", "shade", "", False, "left_target"),
        ExpectedOutcome("", "", "", False, "target_not_found"),
    )
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


def test_totals_count_what_is_there(run: tuple[Path, list[SampleOutcome]]) -> None:
    """A wrong reason is not a right one, and a failure is neither feasible nor infeasible."""
    counts = summary_of(run[1], run="", wall_s=0.0)
    assert counts.samples == 4
    assert (counts.at_rest, counts.infeasible, counts.failed) == (1, 2, 1)
    assert (counts.feasible_as_intended, counts.feasible_intended) == (1, 1)
    assert (counts.infeasible_with_right_reason, counts.infeasible_intended) == (1, 2)


SPENDING = Spending(("some-model",), 3, 2, 1, 1000, 200, 30, 4, None)


def test_the_keys_of_summary_json_stay(run: tuple[Path, list[SampleOutcome]]) -> None:
    """Other programs read them: the counts, the times, and what was spent, which is absent where nobody was asked."""
    summary = summary_of(run[1], run="runs/a", wall_s=3.04, language=SPENDING)
    spent = {
        "models": ["some-model"], "asked": 3, "batch": 2, "kept": 1,
        "input_tokens": 1000, "output_tokens": 200, "cache_write_tokens": 30, "cache_read_tokens": 4, "usd": None,
    }  # fmt: skip
    expected = {
        "run": "runs/a", "samples": 4, "at_rest": 1, "as_posed": 0, "infeasible": 2, "failed": 1, "region_missed": 0,
        "feasible_intended": 1, "feasible_as_intended": 1, "infeasible_intended": 2, "infeasible_with_right_reason": 1,
        "compute_s": 3 * (1.5 + 6.0), "wall_s": 3.0, "language": spent,
    }  # fmt: skip
    assert json.dumps(object_to_json(summary)) == json.dumps(expected)
    assert "language" not in object_to_json(replace(summary, language=None))


def test_intended_feasibility_is_not_read_from_words() -> None:
    """A support whose label begins with "infeasible" does not make its sample an infeasible one."""
    tree = placement("at_rest", None) | {"base": {"id": "4", "label": "infeasible table"}, "part": ""}
    truth = ExpectedOutcome("infeasible table", "", "", True, "")
    row = replace(row_of(Sample("a", "s", "o", "p"), tree, "", truth), expected="infeasible table")
    counts = summary_of([row], run="", wall_s=0.0)
    assert (counts.feasible_as_intended, counts.feasible_intended, counts.infeasible_intended) == (1, 1, 0)


def test_the_page_shows_every_sample(run: tuple[Path, list[SampleOutcome]]) -> None:
    """Each prompt, picture, reason and error is on the page, escaped, and every link leads to a file of the run."""
    folder, rows = run
    summary = summary_of(rows, run=str(folder), wall_s=3.0, language=SPENDING)
    page = write_report(folder, rows, summary).read_text()
    assert page.count('<article class="card') == 4
    assert "balance the ball on the &lt;lampshade&gt; &amp; stay" in page
    for words in (PROMPTS[0], "infeasible: toppled", "no piano; there are bed and sofa", "x: no such file", "1.50 s",
                  "some-model: 5 replies asked for, 1 kept from before; 1034 tokens in (4 from the cache), 200 out",
                  "object, body: <b>rubber</b> (usual for a &lt;ball&gt;)"):  # fmt: skip
        assert words in page
    links = LINK.findall(page)
    shown = [link for card in re.findall(r"<article.*?</article>", page, re.DOTALL) for link in LINK.findall(card)]
    assert sum(link.endswith(".png") for link in shown) == 2 * 2 * 3
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
    "row",
    [{"top": "left"}, {"feasible": "no"}, {"front": [0, 0]}, {"front": [1]}, {"front": ["a", 1]}, {"front": "left"}],
)
def test_truth_that_cannot_be_compared_is_refused(row: dict[str, object]) -> None:
    """A value that no outcome could ever match is an error that names it."""
    with pytest.raises(InputError, match=rf"truth.yaml: a: {next(iter(row))}"):
        read_truth({"a": row}, "truth.yaml")


def turned(degrees: float, axis: str) -> dict[str, object]:
    """The pose of an object that is turned about one world axis."""
    half = np.radians(degrees) / 2
    return {"pose": {"quaternion": [np.cos(half), *(np.sin(half) * (np.array(list("xyz")) == axis))]}}


BED = ExpectedOutcome("bed", "mattress", "center", True, "", base_id="4", top="up", front=(0.0, 2.0))


@pytest.mark.parametrize(
    ("truth", "change", "agreed"),
    [
        (BED, {}, True),
        (BED, {"region_missed": True}, False),
        (BED, {"part": "frame"}, False),
        (BED, {"verdict": "infeasible"}, False),
        (BED, {"base": {"id": "5", "label": "bed"}}, False),
        (BED, {"region": "middle"}, True),
        (BED, {"region": "left"}, False),
        (replace(BED, region="front edge"), {}, False),
        (replace(BED, region="front edge"), {"region": "edge front"}, True),
        (replace(BED, region=""), {"region": "left"}, True),
        (BED, {"pose": None}, False),
        (BED, turned(44.0, "z"), True),
        (BED, turned(46.0, "z"), False),
        (BED, turned(-46.0, "x"), False),
        (replace(BED, front=(-1.0, 0.0)), turned(90.0, "z"), True),
        (replace(BED, front=None, top="down"), turned(180.0, "y"), True),
        (replace(BED, front=None, top="sideways"), turned(90.0, "y"), True),
        (replace(BED, front=None, top="sideways"), {}, False),
        (replace(BED, feasible=False, reason="toppled"), {"verdict": "infeasible", "reason": "toppled"}, True),
        (replace(BED, feasible=False, reason="toppled"), {"verdict": "infeasible", "reason": "buried"}, False),
        (
            replace(BED, feasible=False, reason="toppled"),
            {"verdict": "infeasible", "reason": "toppled", "base": {"id": "5", "label": "bed"}},
            False,
        ),
    ],
)
def test_agreement(truth: ExpectedOutcome, change: dict[str, object], agreed: bool) -> None:
    """A sample agrees if the intended came of the intended thing: there, in the region asked for, turned as asked."""
    row = row_of(Sample("a", "s", "o", "p"), placement("at_rest", None) | change, "", truth)
    assert row.as_expected is agreed
