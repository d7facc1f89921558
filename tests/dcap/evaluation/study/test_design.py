"""Who compares what: every pair of methods equally often, sides swapped equally often, for any number of raters."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.study.design import Side, per_pair, rater_items
from dcap.scene.errors import InputError

METHODS = ("a", "b", "c")


def some_pairs(samples: int) -> dict[tuple[str, str], tuple[str, ...]]:
    """Three pairs of methods on so many samples."""
    names = tuple(f"s{n}" for n in range(samples))
    return {("a", "b"): names, ("a", "c"): names, ("b", "c"): names}


@given(samples=st.integers(2, 9), wanted=st.integers(3, 40), raters=st.integers(1, 6), seed=st.integers(0, 99))
def test_each_rater_compares_every_pair_of_methods_equally_often(
    samples: int, wanted: int, raters: int, seed: int
) -> None:
    """And no comparison twice; the sides of a pair of methods differ by at most two within a rater."""
    pairs = some_pairs(samples)
    count = per_pair(pairs, wanted)
    for rater in range(raters):
        items = [one for one in rater_items(pairs, (("a", "s0"),), count, rater, seed) if one.lifted is None]
        met = Counter(tuple(sorted((one.left, one.right))) for one in items)
        assert met == dict.fromkeys(pairs, count)
        assert len({(one.sample, *sorted((one.left, one.right))) for one in items}) == len(items)
        for first, second in pairs:
            lefts = sum((one.left, one.right) == (first, second) for one in items)
            assert abs(2 * lefts - count) <= 2


@given(samples=st.integers(1, 9), seed=st.integers(0, 99))
def test_two_rounds_swap_every_comparison(samples: int, seed: int) -> None:
    """Of two raters who see everything each comparison has each method on each side once."""
    pairs = some_pairs(samples)
    seen = Counter(
        (one.sample, one.left, one.right) for rater in range(2) for one in rater_items(pairs, (), samples, rater, seed)
    )
    assert set(seen.values()) == {1}
    assert len(seen) == 2 * 3 * samples


def test_samples_are_gone_through_before_any_comes_again() -> None:
    """Raters who see a part share the samples: after as many as it takes, each was compared equally often."""
    pairs = some_pairs(6)
    seen = Counter(
        (one.sample, *sorted((one.left, one.right)))
        for rater in range(3)
        for one in rater_items(pairs, (), 2, rater, seed=4)
    )
    assert set(seen.values()) == {1}
    assert len(seen) == 18


def test_order_follows_from_seed_and_rater() -> None:
    pairs = some_pairs(5)
    first = rater_items(pairs, (), 5, 0, 1)
    assert first == rater_items(pairs, (), 5, 0, 1)
    assert first != rater_items(pairs, (), 5, 0, 2)
    assert [one.sample for one in first] != [one.sample for one in rater_items(pairs, (), 5, 1, 1)]
    assert [one.item for one in first] == [f"{n:03d}" for n in range(1, 16)]


def test_attention_checks_lie_between_and_change_sides() -> None:
    """One for every ten comparisons; never the first, the same placement on both sides, each side floating as often."""
    pairs, checks = some_pairs(10), (("a", "s1"), ("a", "s2"))
    sides: Counter[Side | None] = Counter()
    for rater in range(4):
        items = rater_items(pairs, checks, 10, rater, 0)
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
