"""Pairs with known answers, and who gets them right."""

import pytest
from judged import placement

from dcap.evaluation.judging.known_answers import (
    DENT,
    FLOATING,
    OFF,
    ON_THE_FLOOR,
    SETTLED,
    SUNK,
    VIEWS,
    BallOnBed,
    KnownAnswer,
    known_answers,
)
from dcap.evaluation.judging.questions import PairReply
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.judging.validation import judge_accuracy
from dcap.evaluation.statistics.comparisons import JudgedAxis, Winner
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.synthetic.rooms import build_room

AXIS = JudgedAxis.PHYSICS_NATURALNESS
ROOMS = ("bedroom_01", "bedroom_02", "bedroom_03", "kids_01", "kids_02")


class LeftClient:
    """Prefers what is on the left."""

    def ask(self, question, request):
        return PairReply(analysis="", right_place=Winner.LEFT, physics_naturalness=Winner.LEFT, overall=Winner.LEFT)

    def ask_all(self, question, requests):
        return [self.ask(question, one) for one in requests]


@pytest.fixture(scope="module")
def answers():
    return known_answers("bedroom_01")


def test_ties_and_preferences_are_not_right():
    """Of two pairs the rubric gets the plain one twice, and the one that it cannot tell apart not at all."""
    good, same, bad = placement("s", "good", 1), placement("s", "same", 2), placement("s", "hovering", 3, gap_m=0.05)
    found = judge_accuracy(OfflineClient(), [KnownAnswer(good, bad, AXIS), KnownAnswer(good, same, AXIS)], RUBRIC)
    assert found.by_flaw == {"hovering": (2, 2), "same": (0, 2)}
    assert (found.accuracy, found.sides.ties) == (0.5, 2)


@pytest.mark.slow
def test_metrics_are_those_that_the_pairs_were_made_with(answers):
    """5 cm over, 5 cm inside, beside the bed, in a dent of its own: measured on the meshes."""
    found = {one.worse.method: one.worse.metrics for one in answers} | {SETTLED: answers[0].better.metrics}
    # the mattress is not flat: its height under the middle of the ball is what is meant, within a few millimetres
    assert found[FLOATING]["gap_m"] == pytest.approx(OFF, abs=0.003)
    assert found[SUNK]["penetration_m"] == pytest.approx(OFF, abs=0.003)
    assert found[SETTLED]["penetration_m"] == pytest.approx(0.0, abs=1e-4)  # chords of the ball sag by 0.04 mm
    assert found[SETTLED]["gap_m"] == 0.0
    assert [found[name]["indentation_error_m"] for name in (SETTLED, FLOATING, SUNK)] == [0.0, DENT, DENT]
    assert [found[name]["support_hit"] for name in (SETTLED, ON_THE_FLOOR)] == [True, False]


@pytest.mark.slow
def test_a_side_is_right_half_of_the_time(answers):
    """Who always says left gets one of both orders, and is found out."""
    found = judge_accuracy(LeftClient(), answers, "left")
    assert (found.right, found.asked, found.accuracy) == (3, 6, 0.5)
    assert found.sides.left_share == 1.0
    assert found.sides.consistent == 0
    assert found.in_words.startswith("left: 3 of 6 known answers right (50 %".replace(" %", "%"))


@pytest.mark.slow
def test_the_metric_rubric_is_right(answers):
    """All three pairs, in both orders."""
    found = judge_accuracy(OfflineClient(), answers, RUBRIC)
    assert found.by_flaw == {FLOATING: (2, 2), SUNK: (2, 2), ON_THE_FLOOR: (2, 2)}
    assert found.accuracy == 1.0
    assert found.interval.low < 0.7  # six answers prove little


@pytest.mark.slow
def test_the_metric_rubric_is_right_in_every_bedroom():
    """All pairs of all embedded rooms with a bed."""
    found = judge_accuracy(OfflineClient(), [one for name in ROOMS for one in known_answers(name)], RUBRIC)
    assert (found.right, found.asked) == (30, 30)


@pytest.mark.slow
def test_a_room_without_a_bed_is_refused():
    """In one line."""
    with pytest.raises(InputError, match="room study_01 has no bed"):
        known_answers("study_01")
    with pytest.raises(InputError, match="no pairs with known answers"):
        judge_accuracy(OfflineClient(), [], RUBRIC)


@pytest.mark.slow
def test_pictures_differ_where_placements_do():
    """The ball is seen in every view of the bed, and on the floor in the view of the room alone."""
    room = BallOnBed("bedroom_01", build_room("bedroom_01", 0))
    empty = {view: room.seen(None, view) for view in VIEWS}
    for kind in (SETTLED, FLOATING, SUNK):
        assert all((room.seen(kind, view) != empty[view]).any(axis=2).mean() > 1e-3 for view in VIEWS)
    changed = {view for view in VIEWS if (room.seen(ON_THE_FLOOR, view) != empty[view]).any(axis=2).mean() > 1e-3}
    assert changed == {"room"}
