"""Runs have tags to look for."""

from dcap.scene.types.sample import Sample
from flows.sample_run import LONGEST, benchmark_tags, sample_tags, shorten

BALL = Sample("one", "/data/rooms/bedroom_01", "/data/objects/ball.glb", "put it on the bed")
TABLE = Sample("holodeck/three", "/data/table.v2.glb", "mug.obj", "put it there", method="holodeck")


def test_tags_name_run_method_and_scene() -> None:
    """A sample has all three, one that is placed alone has no run; a benchmark has its methods."""
    assert sample_tags(TABLE, "night") == ("run:night", "method:holodeck", "scene:table.v2")
    assert sample_tags(BALL) == ("method:dcap", "scene:bedroom_01")
    assert benchmark_tags("night", ["dcap", "paper"]) == ("run:night", "method:dcap", "method:paper")


def test_a_hostile_name_stays_one_short_line() -> None:
    """Line breaks and control characters become spaces, long names end in an ellipsis."""
    assert shorten("a\nb\x1b[2Jc\u202ed") == "a b [2Jc d"
    assert len(shorten("x" * 1000)) == LONGEST
