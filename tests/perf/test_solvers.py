"""The table of how samples end by several solvers says what their files say."""

import json
import math
from pathlib import Path
from typing import Any

import pytest

from dcap.evaluation.run_folder import sample_folder
from perf import solvers
from perf.solvers import Ending, ending_of, endings, rows, summary

FIRST = {
    "ball": Ending("at_rest", "bed blanket", 2e-3, 10.0, 8e-4, 1e-4),
    "mug": Ending("at_rest", "desk", 2e-5, 5.0),
    "book": Ending("at_rest", "sofa", 1e-3, 10.0),
    "piano": Ending("target_not_found", "", 0.0, 0.0),
}
OTHER = {
    "ball": Ending("at_rest", "bed blanket", 2.1e-3, 30.0, 7e-4, 2e-4),
    "mug": Ending("at_rest", "rug", 2e-5, 5.0),
    "book": Ending("no_equilibrium", "sofa", 0.0, 20.0),
    "piano": Ending("target_not_found", "", 0.0, 0.0),
}


def test_a_row_tells_depth_and_time_or_what_else_it_came_to() -> None:
    """One row for each sample that rests by the first; the others are counted."""
    assert rows([FIRST, OTHER]) == [
        ["ball", "bed blanket", "2.00 mm, 8.0 cm2, 10 s", "2.10 mm, 7.0 cm2, x 3.0"],
        ["mug", "desk", "0.02 mm, 0.0 cm2, 5 s", "on rug"],
        ["book", "sofa", "1.00 mm, 0.0 cm2, 10 s", "no_equilibrium"],
    ]
    line = summary(FIRST, OTHER, "mls")
    assert line.startswith("mls: 2 of 3 at rest, 1 on the same support; 1 of 1 others with the same reason; ")
    assert "depth 5.0% over 1 samples" in line
    assert line.endswith("time 3.0; forces at most 0.20 mm from a surface")


def test_a_run_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """At rest, infeasible, and a sample without a result."""
    at_rest: dict[str, Any] = {
        "verdict": "at_rest", "reason": None, "base": {"label": "bed"}, "part": "blanket",
        "certificate": {"placement": {"indentation_m": 3e-3}, "proof": {"gap_m": {"value": 1e-4}}},
        "contacts": [{"area_m2": 2.5e-4}, {"area_m2": 0.5e-4}], "timings": {"drop": 12.0},
    }  # fmt: skip
    lost = {
        **at_rest,
        "verdict": "infeasible",
        "reason": "no_equilibrium",
        "certificate": None,
        "contacts": [],
        "timings": {},
    }
    assert ending_of(at_rest) == Ending("at_rest", "bed blanket", 3e-3, 12.0, 2.5e-4 + 0.5e-4, 1e-4)
    assert ending_of(lost) == Ending("no_equilibrium", "bed blanket", 0.0, 0.0, gap=math.inf)
    (tmp_path / "run.json").write_text(json.dumps({"samples": [{"id": one} for one in ("a", "b", "c")]}))
    for name, tree in (("a", at_rest), ("b", lost)):
        folder = sample_folder(tmp_path, name)
        folder.mkdir(parents=True)
        (folder / "placement.json").write_text(json.dumps(tree))
    assert [one.verdict for one in endings(tmp_path).values()] == ["at_rest", "no_equilibrium", "failed"]
    monkeypatch.setattr(solvers, "find_run", Path)
    monkeypatch.setattr("sys.argv", ["solvers", str(tmp_path), str(tmp_path), "--names", "tl,mls"])
    solvers.main()
    assert "| a | bed blanket | 3.00 mm, 3.0 cm2, 12 s | 3.00 mm, 3.0 cm2, x 1.0 |" in capsys.readouterr().out
