"""Who compares what: every pair of methods equally often, sides swapped equally often, for any number of raters."""

from collections import Counter
from itertools import combinations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.study.design import GROUP, Showings, Side, StudyItem, per_pair, rater_items
from dcap.scene.errors import InputError

METHODS = ("a", "b", "c")


def some_pairs(samples: int) -> dict[tuple[str, str], tuple[str, ...]]:
    """Three pairs of methods on so many samples."""
    names = tuple(f"s{n}" for n in range(samples))
    return {("a", "b"): names, ("a", "c"): names, ("b", "c"): names}


def items_of(
    pairs: dict[tuple[str, str], tuple[str, ...]], count: int, raters: int, seed: int = 0,
    checks: tuple[tuple[str, str], ...] = (),
) -> list[tuple[StudyItem, ...]]:  # fmt: skip
    """What each of some raters gets."""
    before = Showings()
    return [rater_items(pairs, checks, count, rater, seed, before) for rater in range(raters)]


@given(samples=st.integers(2, 9), wanted=st.integers(3, 40), raters=st.integers(1, 6), seed=st.integers(0, 99))
def test_each_rater_compares_every_pair_of_methods_equally_often(
    samples: int, wanted: int, raters: int, seed: int
) -> None:
    """And no comparison twice; the sides of a pair of methods differ by at most one within a rater."""
    pairs = some_pairs(samples)
    count = per_pair(pairs, wanted)
    for given_items in items_of(pairs, count, raters, seed, (("a", "s0"),)):
        items = [one for one in given_items if one.lifted is None]
        met = Counter(tuple(sorted((one.left, one.right))) for one in items)
        assert met == dict.fromkeys(pairs, count)
        assert len({(one.sample, *sorted((one.left, one.right))) for one in items}) == len(items)
        for first, second in pairs:
            lefts = sum((one.left, one.right) == (first, second) for one in items)
            assert abs(2 * lefts - count) <= 1


@given(samples=st.integers(1, 9), seed=st.integers(0, 99))
def test_two_rounds_swap_every_comparison(samples: int, seed: int) -> None:
    """Of two raters who see everything each comparison has each method on each side once."""
    pairs = some_pairs(samples)
    seen = Counter((one.sample, one.left, one.right) for items in items_of(pairs, samples, 2, seed) for one in items)
    assert set(seen.values()) == {1}
    assert len(seen) == 2 * 3 * samples


def test_samples_are_gone_through_before_any_comes_again() -> None:
    """Of what is not shared nothing comes again before all of its pair of methods was shown: groups of four raters
    share two of nine comparisons; 13 samples of a pair last for four raters."""
    pairs = some_pairs(13)
    met = Counter(comparison(one) for items in items_of(pairs, 3, GROUP, seed=4) for one in items)
    assert Counter(met.values()) == {1: 4 * 9 - 2 * GROUP, GROUP: 2}


def comparison(one: StudyItem) -> tuple[str, ...]:
    """Sample and pair of methods, whichever is on the left."""
    return one.sample, *sorted((one.left, one.right))


def usual_study(raters: int = 12) -> list[tuple[StudyItem, ...]]:
    """Five methods on 57 samples, 40 comparisons each: four of each pair of methods."""
    names = tuple(f"s{n}" for n in range(57))
    return items_of(dict.fromkeys(combinations("abcde", 2), names), 4, raters)


def test_raters_of_a_usual_study_share_comparisons() -> None:
    """Each group of four a fifth of forty: 3 x 8 comparisons are seen by four raters, with either method on the left
    by two, and each rater sees eight of those."""
    raters = usual_study()
    seen_by: dict[tuple[str, ...], set[int]] = {}
    for number, items in enumerate(raters):
        for one in items:
            seen_by.setdefault(comparison(one), set()).add(number)
    shared = {key for key, who in seen_by.items() if len(who) >= GROUP}
    assert len(shared) == 24
    for items in raters:
        assert sum(comparison(one) in shared for one in items) >= 8
    lefts = Counter((one.sample, one.left, one.right) for items in raters for one in items if comparison(one) in shared)
    assert {lefts[sample, one, two] - lefts[sample, two, one] for sample, one, two in shared} <= {-1, 0, 1}
    met = Counter(key[1:] for key in shared)
    assert set(met.values()) <= {2, 3}  # 24 of ten pairs of methods


def test_sharing_does_not_cost_balance() -> None:
    """Each method as often on either side, for every rater and over all; no sample is shown much more than another:
    480 of 57 are 8.4 each, and what is shared of one adds three."""
    raters = usual_study()
    for items in [*raters, [one for mine in raters for one in mine]]:
        assert Counter(one.left for one in items) == Counter(one.right for one in items)
        assert len(set(Counter(tuple(sorted((one.left, one.right))) for one in items).values())) == 1
    shown = Counter(one.sample for items in raters for one in items)
    assert len(shown) == 57
    assert max(shown.values()) - min(shown.values()) <= 5


def test_few_comparisons_of_many_methods_share_too() -> None:
    """One of each pair of methods: still a fifth of all, of other pairs of methods in each group."""
    names = tuple(f"s{n}" for n in range(9))
    pairs = dict.fromkeys(combinations("abcdef", 2), names)
    groups = [items_of(pairs, 1, 3 * GROUP)[first : first + GROUP] for first in range(0, 3 * GROUP, GROUP)]
    found = [set.intersection(*({comparison(one) for one in items} for items in group)) for group in groups]
    assert [len(one) for one in found] == [3, 3, 3]
    assert len({key[1:] for one in found for key in one}) == 9


def test_order_follows_from_seed_and_rater() -> None:
    pairs = some_pairs(5)
    first, second = items_of(pairs, 5, 2, 1)
    assert [first, second] == items_of(pairs, 5, 2, 1)
    assert first != items_of(pairs, 5, 1, 2)[0]
    assert [one.sample for one in first] != [one.sample for one in second]
    assert [one.item for one in first] == [f"{n:03d}" for n in range(1, 16)]


def test_attention_checks_lie_between_and_change_sides() -> None:
    """One for every ten comparisons; never the first, the same placement on both sides, each side floating as often."""
    pairs, checks = some_pairs(10), (("a", "s1"), ("a", "s2"))
    sides: Counter[Side | None] = Counter()
    for items in items_of(pairs, 10, 4, checks=checks):
        found = [n for n, one in enumerate(items) if one.lifted is not None]
        assert len(found) == 3
        assert found[0] > 0
        assert all(items[n].left == items[n].right == "a" for n in found)
        assert all(items[n].expected is not items[n].lifted for n in found)
        sides.update(items[n].lifted for n in found)
    assert sides[Side.LEFT] == sides[Side.RIGHT] == 6


def test_fewer_comparisons_than_pairs_of_methods_are_refused() -> None:
    with pytest.raises(InputError, match=r"--pairs 2: there are 3 pairs of methods"):
        per_pair(some_pairs(4), 2)
    assert per_pair(some_pairs(4), 3) == 1
    assert per_pair(some_pairs(4), None) == 4
    uneven = {("a", "b"): ("s0", "s1", "s2"), ("a", "c"): ("s0",)}
    assert per_pair(uneven, None) == 1  # what one pair of methods has little of, all get little of
