"""Pairs with known answers, and who gets them right."""

import numpy as np
import pytest
from judged import placement

from dcap.evaluation.judging.cameras import SIZE, camera_of
from dcap.evaluation.judging.known_answers import KnownAnswer, judge_accuracy, known_answers
from dcap.evaluation.judging.known_room import (
    BED,
    FLOOR,
    RADIUS,
    SETTLED,
    BallPlace,
    RoomWithBall,
)
from dcap.evaluation.judging.questions import PairReply
from dcap.evaluation.judging.rubric import RUBRIC, SCALES
from dcap.evaluation.statistics.comparisons import JudgedAxis
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.types.pictures import PLACED
from dcap.synthetic.rooms import build_room
from flows.judge_run import ROOMS

AXIS = JudgedAxis.PHYSICS_NATURALNESS


class LeftClient:
    """Prefers what is on the left."""

    def ask(self, question, request):
        return PairReply(analysis="", right_place="A", physics_naturalness="A", overall="A")  # type: ignore[arg-type]

    def ask_all(self, question, requests):
        return [self.ask(question, one) for one in requests]


@pytest.fixture(scope="module")
def answers():
    return known_answers("bedroom_01")


@pytest.fixture(scope="module")
def room():
    return RoomWithBall("bedroom_01", build_room("bedroom_01", 0))


def test_ties_and_preferences_are_not_right():
    """Of three pairs the rubric gets the plain one twice, and the one that it cannot tell apart, and the one of which
    it knows nothing on the axis, not at all; flaws are counted by their names, whoever made the placements."""
    good, same, bad = placement("s", "a", 1), placement("s", "b", 2), placement("s", "b", 3, gap_m=0.05)
    nowhere = placement("s", "b", 4, **dict.fromkeys(SCALES[JudgedAxis.RIGHT_PLACE]))
    pairs = [
        KnownAnswer(good, bad, AXIS, "hovering"),
        KnownAnswer(good, same, AXIS, "none"),
        KnownAnswer(good, nowhere, JudgedAxis.RIGHT_PLACE, "nowhere"),
    ]
    found = judge_accuracy(OfflineClient(), pairs, RUBRIC)
    assert found.by_flaw == {"hovering": (2, 2), "none": (0, 2), "nowhere": (0, 2)}
    assert (found.accuracy, found.sides.ties) == (pytest.approx(1 / 3), 4)


@pytest.mark.slow
@pytest.mark.parametrize("on", [BED, FLOOR])
@pytest.mark.parametrize("offset", [0.05, 0.005, 0.002, 0.001])
def test_metrics_are_measured_on_the_meshes(room: RoomWithBall, on: str, offset: float):
    """What is measured follows where the ball is put, within a twentieth; what a simulation would tell is null."""
    over, inside = (room.metrics(BallPlace(on, sign * offset), on) for sign in (1.0, -1.0))
    assert over["gap_m"] == pytest.approx(offset, rel=0.05)
    assert over["penetration_m"] == 0.0
    assert inside["penetration_m"] == pytest.approx(offset, rel=0.05)
    assert inside["gap_m"] == 0.0
    unknown = ("part_hit", "orientation_error_deg", "referee_drift_m", "referee_drift_deg", "visible_fraction")
    assert {over[name] for name in unknown} == {None}


@pytest.mark.slow
def test_the_settled_ball_lies_in_its_dent(room: RoomWithBall):
    """Neither over nor inside what gave way to it."""
    found = room.metrics(SETTLED, BED)
    assert found["penetration_m"] == pytest.approx(0.0, abs=1e-4)  # chords of the ball sag by 0.04 mm
    assert found["gap_m"] == 0.0
    assert room.metrics(SETTLED, FLOOR)["support_hit"] is False


@pytest.mark.slow
@pytest.mark.long
def test_a_side_is_right_half_of_the_time(answers):
    """Who always says left gets one of both orders, and is found out."""
    found = judge_accuracy(LeftClient(), answers, "left")
    assert (found.right, found.asked, found.accuracy) == (20, 40, 0.5)
    assert found.sides.left_share == 1.0
    assert (found.sides.both_orders, found.sides.consistent) == (20, 0)
    assert found.in_words.startswith("left: 20 of 40 known answers right (50%")


@pytest.mark.long
@pytest.mark.slow
def test_the_rubric_misses_only_a_mattress_that_does_not_give_way(answers):
    """How deep a dent ought to be only our own contact model could say, and that is in no score."""
    found = judge_accuracy(OfflineClient(), answers, RUBRIC)
    assert {flaw for flaw, counts in found.by_flaw.items() if counts != (2, 2)} == {"no dent"}
    assert found.by_flaw["no dent"] == (0, 2)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", [one for one in ROOMS if one != "bedroom_01"])
def test_the_rubric_is_right_in_the_other_bedrooms(name: str):
    """All pairs but the mattress that stays flat, in both orders."""
    found = judge_accuracy(OfflineClient(), known_answers(name), RUBRIC)
    assert (found.right, found.asked) == (38, 40)


@pytest.mark.slow
def test_a_room_without_a_bed_is_refused():
    """In one line."""
    with pytest.raises(InputError, match="room study_01 has no bed"):
        known_answers("study_01")
    with pytest.raises(InputError, match="no pairs with known answers"):
        judge_accuracy(OfflineClient(), [], RUBRIC)


@pytest.mark.slow
@pytest.mark.long
def test_pictures_differ_where_placements_do(room: RoomWithBall):
    """The overview is from one camera for both, the close-up follows the ball; a ball that hovers by 2 mm shows it."""
    compared = (BallPlace(BED), BallPlace(FLOOR), BallPlace(BED, 0.002))
    empty = room.seen(None, BED, compared, "overview")
    bed, floor, over = ({view: room.seen(one, BED, compared, view) for view in PLACED} for one in compared)
    for one in (bed, floor):
        assert 1e-3 < (one["overview"] != empty).any(axis=2).mean() < 0.1
        rows, columns = np.nonzero(one["closeup"][..., 2] > 1.5 * one["closeup"][..., 0])  # the ball is blue
        assert 0.4 < columns.mean() / SIZE < 0.6
        assert rows.max() < SIZE - 1
    camera = camera_of(room.viewpoint(compared[0], BED, compared, "closeup"))
    low = room.center(compared[0]) - np.array([0.0, 0.0, RADIUS])
    rise = camera.project(np.array([low, low + np.array([0.0, 0.0, 0.002])]))[:, 1]
    assert rise[0] - rise[1] > 4.0  # pixels
    assert (over["closeup"] != bed["closeup"]).any(axis=2).mean() > 1e-3
