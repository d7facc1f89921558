"""Holodeck's relations and its search of the floor, in centimetres."""

import numpy as np
import pytest
import shapely

from dcap.evaluation.baselines.holodeck.floor_search import (
    FloorObject,
    FloorRoom,
    all_places,
    candidates,
    moved_to_wall,
    search,
)
from dcap.evaluation.baselines.holodeck.scores import (
    GridPlace,
    Relation,
    RelationKind,
    aligned,
    distance_scores,
    edit_distance,
    faces,
    far_curve,
    is_on_side,
    near_curve,
    parsed_relations,
    satisfying,
)

NEAR_BED = Relation(RelationKind.DISTANCE, "near", "bed-0")
FACE_BED = Relation(RelationKind.DIRECTION, "face to", "bed-0")
EDGE = Relation(RelationKind.GLOBAL, "edge")
MIDDLE = Relation(RelationKind.GLOBAL, "middle")
ROOM = FloorRoom.of(shapely.box(0, 0, 400, 400))


def place(x: float, y: float, turn: int = 0, half: float = 20.0) -> GridPlace:
    """A square about a point."""
    return GridPlace((x, y), turn, shapely.box(x - half, y - half, x + half, y + half))


def relations(line: str) -> list[Relation] | None:
    """What a line says of the chair in a room with a bed and a desk."""
    return parsed_relations(line, "chair-0", ["Bed-0", "desk-0"])


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("chair-0 | edge | near, bed-0 | face to, bed-0", [EDGE, NEAR_BED, FACE_BED]),
        ("1. *chair-0* | Middle | NEAR, Bed-0.", [MIDDLE, NEAR_BED]),
        ("chair-0 | around, bed-0", [NEAR_BED, FACE_BED]),
        ("chair-0 | in front of, bed-0", [Relation(RelationKind.RELATIVE, "in front of", "bed-0"),
                                          Relation(RelationKind.ALIGNMENT, "center aligned", "bed-0")]),
        ("chair-0 | egde | nearr, bed-0", [EDGE, NEAR_BED]),
        ("chair-0 | n/a | near | near, piano-0 | edge", [EDGE]),
        ("stool-0 | edge", None),
        ("put it near the bed", None),
        ("", None),
        ("chair-0 |", []),
    ],
)  # fmt: skip
def test_a_line_is_read_as_the_source_reads_it(line: str, found: list[Relation] | None) -> None:
    """Aliases, misspellings, targets that are not there, lines about others, and prose."""
    assert relations(line) == found


def test_the_edit_distance_counts_letters() -> None:
    """Levenshtein's own kind of example: three changes make a sitting of a kitten."""
    assert edit_distance("kitten", "sitting") == 3
    assert edit_distance("", "near") == 4
    assert edit_distance("far", "far") == 0


def test_near_falls_to_nothing_at_80_cm_and_far_rises_to_the_greatest_distance() -> None:
    """Near: 1 at the least distance 20, half of it at 50, none from 80; far: a straight line from 20 to 120."""
    near, far = near_curve(20.0, 300.0), far_curve(20.0, 120.0)
    assert [near(away) for away in (20.0, 50.0, 80.0, 300.0)] == pytest.approx([1.0, 0.5, 0.0, 0.0])
    assert [far(away) for away in (20.0, 70.0, 120.0)] == pytest.approx([0.0, 0.5, 1.0])
    assert near_curve(80.0, 90.0)(80.0) == 0.0
    assert far_curve(50.0, 50.0)(50.0) == 0.0


def test_where_all_is_near_the_farthest_counts_nothing() -> None:
    """Distances from 20 to 60 cm: 1, half of it at 40, none at 60; where all are the same, all count."""
    near = near_curve(20.0, 60.0)
    assert [near(away) for away in (20.0, 40.0, 60.0)] == pytest.approx([1.0, 0.5, 0.0])
    assert near_curve(20.0, 20.0)(20.0) == 1.0


def test_distances_are_those_between_the_rectangles() -> None:
    """Squares of 40 cm whose middles are 100 and 140 cm from the target's: 60 and 100 cm between them."""
    target, others = place(0, 0), [place(100, 0), place(0, 140)]
    assert distance_scores("near", target, others) == pytest.approx([1.0, 0.0])
    assert distance_scores("far", target, others) == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize("turn", [0, 90, 180, 270])
def test_sides_turn_with_the_target(turn: int) -> None:
    """What is ahead of, behind, left and right of something that looks along +y stays so when both are turned."""
    angle = -np.radians(turn)  # turns run clockwise
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = {"in front of": (5, 60), "behind": (5, -60), "left of": (-60, 5), "right of": (60, 5)}
    for name, point in points.items():
        x, y = matrix @ point
        holds = {word for word in points if is_on_side(word, place(0, 0, turn), place(x, y), 20.0)}
        assert holds == {name}
        assert is_on_side("side of", place(0, 0, turn), place(x, y), 20.0) == (name in ("left of", "right of"))


def test_in_front_is_within_a_grid_step_of_the_middle_line() -> None:
    """At a spacing of 20 cm 19 cm off is in front, 21 cm is not."""
    target = place(0, 0, half=50.0)
    assert is_on_side("in front of", target, place(19, 80), 20.0)
    assert not is_on_side("in front of", target, place(21, 80), 20.0)


def test_facing_is_a_line_that_meets_the_target_and_aligned_are_middles_within_5_cm() -> None:
    """A place below the target looks at it along +y and not along -y; 4 cm off is aligned, 6 cm is not."""
    target = place(100, 200)
    assert faces(target, place(100, 0, 0))
    assert not faces(target, place(100, 0, 180))
    assert not faces(target, place(160, 0, 0))
    assert aligned(target, place(104, 0))
    assert not aligned(target, place(106, 0))
    same = Relation(RelationKind.DIRECTION, "face same as", "bed-0")
    assert satisfying(same, place(0, 0, 90), [place(50, 0, 90), place(50, 0, 0)], 20.0) == [True, False]


def test_the_grid_is_a_20th_of_the_room_in_whole_metres() -> None:
    """4.9 x 3.2 m counts as 4 x 3 m: a spacing of 20 cm; a room below a metre still has one."""
    assert FloorRoom.of(shapely.box(0, 0, 490, 320)).grid == 20
    assert FloorRoom.of(shapely.box(0, 0, 90, 90)).grid == 1


def test_rectangles_lie_in_the_room_and_points_under_things_are_left_out() -> None:
    """A 100 x 60 cm thing in 4 x 4 m, grid 20 cm: middles from 60 to 340 and 40 to 360; touching a wall is inside."""
    chair = FloorObject("chair-0", 100.0, 60.0, ())
    places = all_places(ROOM, chair, {})
    upright = [one for one in places if one.turn == 0]
    assert {one.center[0] for one in upright} == set(np.arange(60.0, 341.0, 20.0))
    assert {one.center[1] for one in upright} == set(np.arange(40.0, 361.0, 20.0))
    assert len(places) == 4 * 15 * 17
    held = all_places(ROOM, chair, {"bed-0": place(200, 200, half=50)})
    assert all(max(abs(one.center[0] - 200), abs(one.center[1] - 200)) >= 50 for one in held)


def test_what_is_near_a_wall_is_moved_to_it() -> None:
    """Looking along +y with its back 10 cm from the wall it is moved by 10 + 4.5 cm; a back 30 cm away is left out."""
    close, far = place(200, 30), place(200, 50)
    found = moved_to_wall(ROOM, [close, far], 40.0)
    assert [one.center for one in found] == [(200.0, 15.5)]
    assert found[0].rectangle.bounds == pytest.approx((180.0, -4.5, 220.0, 35.5))
    assert found[0].score == 2.0


@pytest.mark.parametrize(
    ("asked", "total"),
    [((EDGE,), 2.0), ((EDGE, FACE_BED), (2.0 + 0.5) / 2.0), ((EDGE, NEAR_BED), (2.0 + 1.8) / 2.0),
     ((MIDDLE, FACE_BED), (2.0 + 0.5) / 2.0), ((MIDDLE,), 1.0)],
)  # fmt: skip
def test_scores_add_up_and_are_divided(asked: tuple[Relation, ...], total: float) -> None:
    """A place counts 1, at a wall 1 more, facing 0.5, nearest 1.8; the sum is divided by the number of relations. With
    `middle` and a further relation places at walls are candidates too, as in the source."""
    bed = GridPlace((200, 200), 180, shapely.box(100, 100, 300, 300))
    chair = FloorObject("chair-0", 50.0, 50.0, asked)
    places = candidates(ROOM, chair, {"bed-0": bed}, np.random.default_rng(0))
    assert places[0].score == pytest.approx(total)
    assert all(one.score <= places[0].score for one in places)
    assert FACE_BED not in asked or faces(bed, places[0])


@pytest.mark.parametrize("relation", ["left of", "right of", "in front of"])
def test_the_search_finds_a_place_that_meets_the_relations(relation: str) -> None:
    """Beside a desk in the middle of the room a stool finds its place, in nothing's way, the same each time."""
    desk = GridPlace((200, 200), 180, shapely.box(140, 170, 260, 230))
    wanted = (MIDDLE, Relation(RelationKind.DISTANCE, "near", "desk-0"),
              Relation(RelationKind.RELATIVE, relation, "desk-0"))  # fmt: skip
    stool = FloorObject("stool-0", 50.0, 50.0, wanted)
    found, again = (
        search(ROOM, [stool], {"desk-0": desk}, np.random.default_rng(3), roots=30, steps=100)["stool-0"]
        for _ in range(2)
    )
    assert is_on_side(relation, desk, found, ROOM.grid)
    assert not found.rectangle.intersects(desk.rectangle)
    assert found == again


def test_later_things_depend_on_earlier_ones_and_a_full_room_takes_none() -> None:
    """Of two things in an empty room the second is placed near the first; where a thing fills the floor nothing is."""
    bed = FloorObject("bed-0", 160.0, 200.0, (EDGE,))
    stool = FloorObject("stool-0", 50.0, 50.0, (MIDDLE, NEAR_BED))
    found = search(ROOM, [bed, stool], {}, np.random.default_rng(0), roots=5, steps=1000)
    assert found["bed-0"].rectangle.distance(found["stool-0"].rectangle) < 80.0
    full = {"bed-0": place(200, 200, half=199)}
    assert "stool-0" not in search(ROOM, [stool], full, np.random.default_rng(0), roots=30, steps=1000)


def test_the_budget_of_steps_ends_the_search() -> None:
    """With one step only the first of two things is looked for."""
    things = [FloorObject(name, 50.0, 50.0, (EDGE,)) for name in ("a", "b")]
    found = search(ROOM, things, {}, np.random.default_rng(0), roots=1, steps=1)
    assert set(found) == {"a"}
