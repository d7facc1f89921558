"""A few samples of a data set are spread over scenes, objects, supports and verdicts."""

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.scene.types.sample import Sample
from flows.samples import EMBEDDED, load_samples
from flows.selection import spread_samples, truths_of

FEASIBLE = ExpectedOutcome(base="bed", part="", region="", feasible=True, reason="")
REFUSED = ExpectedOutcome(base="", part="", region="", feasible=False, reason="target_not_found")


def samples(count: int, scenes: int) -> list[Sample]:
    """The first ones all lie in the first scene."""
    return [Sample(f"s{k}", f"room_{k * scenes // count}", f"thing_{k}", "put it there") for k in range(count)]


def test_every_scene_once_before_any_twice() -> None:
    """Four of twelve samples in four scenes are one of each, in the order of the list."""
    found = spread_samples(samples(12, 4), [FEASIBLE] * 12, 4)
    assert [one.scene for one in found] == ["room_0", "room_1", "room_2", "room_3"]


def test_refused_ones_keep_their_share() -> None:
    """2 of 12 are to be refused: 1 of 6, of 4 and of 2, as it must be one, and none of 1."""
    truths = [FEASIBLE, FEASIBLE, REFUSED, *[FEASIBLE] * 8, REFUSED]
    every = samples(12, 12)
    refused = {one.id for one, truth in zip(every, truths, strict=True) if truth is REFUSED}
    counts = {limit: len(refused & {one.id for one in spread_samples(every, truths, limit)}) for limit in (1, 2, 4, 6)}
    assert counts == {1: 0, 2: 1, 4: 1, 6: 1}
    assert [len(spread_samples(every, truths, limit)) for limit in (1, 2, 4, 6)] == [1, 2, 4, 6]


def test_all_or_none_are_to_be_refused() -> None:
    """A data set of one kind, or without known outcomes, gives as many as are asked for; more than there are: all."""
    every = samples(5, 5)
    for truth in (FEASIBLE, REFUSED, None):
        assert len(spread_samples(every, [truth] * 5, 3)) == 3
    assert spread_samples(every, [None] * 5, 9) == spread_samples(every, [None] * 5, None) == every


def test_six_of_the_embedded_rooms() -> None:
    """Six rooms, six objects, and one sample that is to be refused."""
    every = load_samples(EMBEDDED)
    truths = truths_of(EMBEDDED, every)
    known = {one.id: truth for one, truth in zip(every, truths, strict=True)}
    found = spread_samples(every, truths, 6)
    assert len({one.scene for one in found}) == len({one.object for one in found}) == 6
    assert sum(truth is not None and not truth.feasible for truth in map(known.get, (one.id for one in found))) == 1
