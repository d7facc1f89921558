"""Which comparisons each rater gets, in which order, and which placement stands on which side.

Guaranteed, for any number of raters: a rater compares every pair of methods equally often; where the samples of a pair
of methods are gone through once more, its sides are swapped; within a rater the sides of a pair of methods alternate.
All follows from the seed and the rater's number. Attention checks, of which the answer is known, lie between them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import combinations
from math import ceil
from random import Random

from dcap.evaluation.study.placements import StudyRun
from dcap.scene.errors import InputError

PER_RATER = 40
"""Comparisons that a rater gets unless another number is asked for [-]."""
BETWEEN_CHECKS = 10
"""Comparisons for each attention check [-]."""


class Side(StrEnum):
    """One of two placements side by side: what a rater chooses. There is no tie."""

    LEFT = "left"
    RIGHT = "right"

    @property
    def other(self) -> "Side":
        """The other one."""
        return Side.RIGHT if self is Side.LEFT else Side.LEFT


@dataclass(frozen=True, slots=True)
class StudyItem:
    """One comparison that a rater is asked for."""

    item: str
    """Its name among those of the rater, in order: 001, 002, ..."""
    sample: str
    left: str
    """Method of the placement on the left."""
    right: str
    lifted: Side | None = None
    """An attention check: both placements are the same, and the one on this side floats; None: a true comparison."""

    @property
    def expected(self) -> Side | None:
        """The known answer of an attention check to the question for physics."""
        return None if self.lifted is None else self.lifted.other


MethodPairs = Mapping[tuple[str, str], Sequence[str]]
"""Samples that both methods of a pair can show, by pair."""


def method_pairs(run: StudyRun) -> dict[tuple[str, str], tuple[str, ...]]:
    """The pairs of methods that can be compared, and the samples of each; InputError where there are none."""
    found = {}
    for one, two in combinations(run.methods, 2):
        both = [s for s in run.prompts if (one, s) in run.shown and (two, s) in run.shown and run.pair(one, two, s)[0]]
        if both:
            found[one, two] = tuple(both)
    if not found:
        raise InputError(
            f"{run.folder.name}: no sample has pictures of the same views by two methods; nothing to compare"
        )
    return found


def per_pair(pairs: MethodPairs, wanted: int | None) -> int:
    """How often a rater compares each pair of methods; `wanted` comparisons in all, as far as there are so many."""
    most = min(len(samples) for samples in pairs.values())
    asked = PER_RATER if wanted is None else wanted
    if asked < len(pairs):
        if wanted is None:
            return 1
        raise InputError(
            f"--pairs {wanted}: there are {len(pairs)} pairs of methods, and each rater compares every one"
        )
    return min(most, asked // len(pairs))


def comparisons(pairs: MethodPairs, count: int, rater: int, seed: int) -> list[tuple[str, str, str]]:
    """(sample, left, right) of the rater's comparisons, `count` of each pair of methods, one pair after the other."""
    found = []
    for number, ((one, two), samples) in enumerate(pairs.items()):
        order = list(samples)
        Random(f"{seed} samples {one} {two}").shuffle(order)
        offset = number * len(order) // len(pairs)  # pairs of methods begin with different samples
        for turn in range(rater * count, (rater + 1) * count):
            lap, place = divmod(offset + turn, len(order))
            swapped = (place + lap + number) % 2 == 1
            found.append((order[place], two, one) if swapped else (order[place], one, two))
    return found


def rater_items(
    pairs: MethodPairs, checks: Sequence[tuple[str, str]], count: int, rater: int, seed: int
) -> tuple[StudyItem, ...]:
    """What a rater is asked, in order; `checks` are (method, sample) of the placements that have a floating copy."""
    chance = Random(f"{seed} rater {rater}")
    rows: list[tuple[str, str, str, Side | None]] = [(*one, None) for one in comparisons(pairs, count, rater, seed)]
    chance.shuffle(rows)
    wanted = ceil(len(rows) / BETWEEN_CHECKS) if checks else 0
    places = [len(rows) * (2 * n + 1) // (2 * wanted) for n in range(wanted)]
    for number in reversed(range(wanted)):
        method, sample = checks[(rater * wanted + number) % len(checks)]
        near = max(1, min(len(rows), places[number] + chance.randint(-2, 2)))
        rows.insert(near, (sample, method, method, (Side.LEFT, Side.RIGHT)[(rater + number) % 2]))
    return tuple(
        StudyItem(f"{number:03d}", sample, left, right, lifted)
        for number, (sample, left, right, lifted) in enumerate(rows, 1)
    )
