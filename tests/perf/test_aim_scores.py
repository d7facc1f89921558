"""What was aimed at against what was meant."""

from perf.aim_scores import Aim, marks, shares


def test_what_the_truth_leaves_open_is_not_compared():
    """Only base and part are stated: region and reason do not count."""
    mark = marks(Aim(base="1", part="top"), Aim(base="1", part="leg", region="left"))
    assert (mark.base, mark.part, mark.region, mark.references, mark.reason) == (True, False, None, None, None)
    assert not mark.all_right


def test_regions_are_words_in_any_order():
    """Front left is left front, and the middle is the centre."""
    assert marks(Aim(region="front left"), Aim(region="left front")).region
    assert marks(Aim(region="center"), Aim(region="middle")).region
    assert marks(Aim(region="left"), Aim(region="left edge")).region is False


def test_a_refusal_is_wrong_where_a_place_was_meant_and_right_where_none_was():
    """The reason is compared as soon as either side has one."""
    refused = Aim(reason="target_not_found")
    assert marks(Aim(base="1"), refused).reason is False
    assert marks(refused, refused).all_right
    assert marks(refused, Aim(base="1")).reason is False


def test_shares_count_what_was_compared():
    """Two bases of which one is right, no part: a half, and 1 for what nobody asked for."""
    rows = [marks(Aim(base="1"), Aim(base="1")), marks(Aim(base="1"), Aim(base="2"))]
    assert shares(rows) == {"base": 0.5, "part": 1.0, "region": 1.0, "references": 1.0, "reason": 1.0, "all": 0.5}
