"""Batched visual selection: chooses among many options in small batches, whose winners meet again.

In: the number of options, and a function that decides among a few of them. Out: the winner. From the source [H25]:
options in small batches, so that a model need not compare dozens of pictures. Ours: batches of four, ids shuffled anew
for each vote so that no position or letter is preferred, two votes, and where they differ a last question between the
two.

[H25] as in the package's docstring.
"""

from collections.abc import Callable, Sequence
from string import ascii_uppercase

import numpy as np

BATCH = 4
"""Options that are compared at once [-]."""
VOTES = 2
"""Selections, each with options in another order [-]."""

Decide = Callable[[Sequence[tuple[str, int]]], int]
"""Chooses among a few options, each a letter and its number; returns the number."""


def batched_selection(count: int, decide: Decide, rng: np.random.Generator, *, batch: int = BATCH) -> int:
    """The winner of `count` options by votes; the only option needs no question."""
    if count == 1:
        return 0
    winners = list(dict.fromkeys(one_vote(count, decide, rng, batch) for _ in range(VOTES)))
    return winners[0] if len(winners) == 1 else decide(lettered(winners, rng))


def one_vote(count: int, decide: Decide, rng: np.random.Generator, batch: int) -> int:
    """The winner of one tournament: in each round the winners of the batches of the last."""
    left = list(range(count))
    while len(left) > 1:
        shuffled = [left[k] for k in rng.permutation(len(left))]
        left = [winner(group, decide, rng) for group in batches(shuffled, batch)]
    return left[0]


def winner(group: Sequence[int], decide: Decide, rng: np.random.Generator) -> int:
    """The winner of one batch; an only option wins without a question."""
    return group[0] if len(group) == 1 else decide(lettered(group, rng))


def batches(numbers: Sequence[int], size: int) -> list[list[int]]:
    """Groups of nearly equal size, none larger than `size`."""
    return [list(group) for group in np.array_split(np.array(numbers), -(-len(numbers) // size))]


def lettered(numbers: Sequence[int], rng: np.random.Generator) -> list[tuple[str, int]]:
    """The options with letters in random order, listed by letter."""
    letters = rng.permutation(len(numbers))
    return sorted((ascii_uppercase[letter], int(number)) for letter, number in zip(letters, numbers, strict=True))


def farthest_points(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]], most: int) -> list[int]:
    """Up to `most` of points (n, d), each the farthest from those before it, the first one first."""
    chosen = [0]
    gap = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(most, len(points)):
        best = int(np.argmax(gap))
        if gap[best] <= 1e-9:
            break
        chosen.append(best)
        gap = np.minimum(gap, np.linalg.norm(points - points[best], axis=1))
    return chosen
