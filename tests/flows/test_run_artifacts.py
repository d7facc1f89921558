"""What is shown of a run is text as it is, whatever names others gave."""

from dcap.scene.types.sample import Sample
from flows.run_artifacts import plain_text
from flows.watching import SettledSample

HOSTILE = "<script>alert(1)</script> [x](javascript:alert(1)) **b** `c` | d"


def test_text_of_others_steers_no_page() -> None:
    """Neither HTML nor Markdown is left in it that a page would act on."""
    text = plain_text(HOSTILE)
    assert "<" not in text
    assert "](" not in text
    assert "**" not in text
    assert text.count("\\|") == 1


def test_a_row_says_how_a_sample_ended() -> None:
    """Why it is infeasible or failed is one line; nothing is said where it is at rest."""
    sample = Sample("paper/one", "room", "ball", "put it", method="paper")
    tree = {"verdict": "infeasible", "reason": "target_not_found", "message": "no\npiano", "timings": {"mesh": 1.5}}
    row = SettledSample(sample, tree, "", True).to_row()  # type: ignore[arg-type]
    assert row == {
        "sample": "one", "method": "paper", "verdict": "infeasible", "on": "", "seconds": 1.5, "cached": "cached",
        "why": "target_not_found: no piano",
    }  # fmt: skip
    failed = SettledSample(sample, None, "room: no such file", False).to_row()
    assert (failed["verdict"], failed["why"], failed["cached"]) == ("failed", "room: no such file", "")
    rest = {"verdict": "at_rest", "reason": None, "message": None, "base": {"id": "7", "label": "bed"}, "part": "top"}
    done = SettledSample(sample, rest, "", False).to_row()  # type: ignore[arg-type]
    assert (done["on"], done["why"]) == ("bed top", "")
