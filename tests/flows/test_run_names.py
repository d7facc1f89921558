"""Runs have names that a person can read, and tags to look for."""

from uuid import UUID

from dcap.scene.types.sample import Sample
from flows.run_names import LONGEST, WatchedRun, benchmark_tags, repeated_titles, sample_tags, shown, title_of

BALL = Sample("one", "/data/rooms/bedroom_01", "/data/objects/ball.glb", "put it on the bed")
AGAIN = Sample("two", "/data/rooms/bedroom_01", "/data/objects/ball.glb", "put it on the desk")
TABLE = Sample("holodeck/three", "/data/table.v2.glb", "mug.obj", "put it there", method="holodeck")


def test_a_title_says_who_places_what_where() -> None:
    """Method, room and object, without what only says that a file is a mesh."""
    assert title_of(BALL) == "dcap / bedroom_01 / ball"
    assert title_of(TABLE) == "holodeck / table.v2 / mug"


def test_titles_of_a_run_are_told_apart() -> None:
    """Where two samples have the same method, room and object, their own names are added; else not."""
    run = WatchedRun("night", UUID(int=1), repeated_titles([BALL, AGAIN, TABLE]))
    assert [run.title(one) for one in (BALL, AGAIN, TABLE)] == [
        "dcap / bedroom_01 / ball / one",
        "dcap / bedroom_01 / ball / two",
        "holodeck / table.v2 / mug",
    ]


def test_tags_name_run_method_and_scene() -> None:
    """A sample has all three, one that is placed alone has no run; a benchmark has its methods."""
    assert sample_tags(TABLE, "night") == ("run:night", "method:holodeck", "scene:table.v2")
    assert sample_tags(BALL) == ("method:dcap", "scene:bedroom_01")
    assert benchmark_tags("night", ["dcap", "paper"]) == ("run:night", "method:dcap", "method:paper")


def test_a_hostile_name_stays_one_short_line() -> None:
    """Line breaks and control characters become spaces, long names end in an ellipsis."""
    assert shown("a\nb\x1b[2Jc\u202ed") == "a b [2Jc d"
    assert len(shown("x" * 1000)) == LONGEST
