"""What is shown of a run is text as it is, whatever names others gave."""

import json

from dcap.scene.types.sample import Sample
from flows.run_artifacts import plain_text, table_data
from flows.watching import SettledSample

HOSTILE = "<script>alert(1)</script> [x](javascript:alert(1)) **b** `c` | d"


def test_text_of_others_steers_no_page() -> None:
    """Neither HTML nor Markdown is left in it that a page would act on."""
    text = plain_text(HOSTILE)
    assert "<" not in text
    assert "](" not in text
    assert "**" not in text
    assert text.count("\\|") == 1
    assert "://" not in plain_text("see http://x")


def test_usual_names_are_readable_as_they_are() -> None:
    """Who reads a table through the API finds names and paths unchanged; foreign ones steer nothing there either."""
    usual = {"sample": "bedroom_01-ball-center", "why": "/data/room_2/fine.ply: no such file", "seconds": 1.5}
    assert json.loads(table_data([usual])) == [usual]
    assert "<" not in table_data([{"sample": HOSTILE}])


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
