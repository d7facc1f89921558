"""Batched selection finds the best of many however they are shuffled, and asks about few at a time."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.baselines.fireplace.solve import BATCH, batched_selection, farthest_points


@given(count=st.integers(1, 60), best=st.integers(0, 59), seed=st.integers(0, 5))
def test_the_best_wins_whatever_the_batches(count: int, best: int, seed: int) -> None:
    """Who always knows the best of a batch chooses the best of all, and never sees more than a batch."""
    best %= count
    sizes = []

    def decide(batch: Sequence[tuple[str, int]]) -> int:
        sizes.append(len(batch))
        numbers = [number for _, number in batch]
        return best if best in numbers else numbers[0]

    assert batched_selection(count, decide, np.random.default_rng(seed)) == best
    assert all(2 <= size <= BATCH for size in sizes)


def test_a_fixed_letter_wins_for_no_option() -> None:
    """Who always takes the first letter chooses different options with different seeds: letters are shuffled."""
    winners = {batched_selection(4, lambda batch: batch[0][1], np.random.default_rng(seed)) for seed in range(40)}
    assert winners == {0, 1, 2, 3}


def test_votes_that_differ_are_settled_by_one_more_question() -> None:
    """Two winners meet once more, and no third option is asked about."""
    asked: list[list[int]] = []

    def decide(batch: Sequence[tuple[str, int]]) -> int:
        numbers = sorted(number for _, number in batch)
        asked.append(numbers)
        return {1: 0, 2: 2, 3: 2}[len(asked)]

    assert batched_selection(3, decide, np.random.default_rng(0)) == 2
    assert asked == [[0, 1, 2], [0, 1, 2], [0, 2]]


def test_each_farthest_point_is_the_farthest() -> None:
    """From one end of a line the other end comes next, then the middle; equal points are taken once."""
    points = np.array([[0.0], [1.0], [2.0], [3.0], [4.0], [4.0]])
    assert farthest_points(points, 3) == [0, 4, 2]
    assert len(farthest_points(points, 10)) == 5
    assert farthest_points(np.zeros((3, 2)), 3) == [0]


@pytest.mark.parametrize("batch", [2, 3, 5])
def test_other_batch_sizes_are_kept(batch: int) -> None:
    """No question shows more."""
    sizes: list[int] = []

    def decide(options: Sequence[tuple[str, int]]) -> int:
        sizes.append(len(options))
        return max(number for _, number in options)

    assert batched_selection(17, decide, np.random.default_rng(1), batch=batch) == 16
    assert max(sizes) == batch
