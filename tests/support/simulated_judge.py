"""Comparisons by judges whose preferences are known."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, Winner

AXIS = JudgedAxis.OVERALL
JUDGE = "simulated"


def row(sample: str, left: str, right: str, winner: Winner, judge: str = JUDGE) -> Comparison:
    return Comparison(sample, AXIS, left, right, winner, judge)


def simulated(
    strengths: dict[str, float], samples: int, rounds: int, random: np.random.Generator, sample_spread: float = 0.0
) -> list[Comparison]:
    """All pairs on each sample, `rounds` times: the winner by Bradley-Terry with strengths in log-odds, which on each
    sample are moved by a normal deviation of `sample_spread`."""
    found = []
    for k in range(samples):
        moved = {name: theta + sample_spread * random.normal() for name, theta in strengths.items()}
        for first, second in combinations(strengths, 2):
            chance = 1.0 / (1.0 + np.exp(moved[second] - moved[first]))
            for one in random.random(rounds) < chance:
                found.append(row(f"s{k:04}", first, second, Winner.LEFT if one else Winner.RIGHT))
    return found


def table(wins: Sequence[Sequence[int]], names: Sequence[str]) -> list[Comparison]:
    """Comparisons with these counts of wins of i over j, each on a sample of its own."""
    found: list[Comparison] = []
    for i, line in enumerate(wins):
        for j, count in enumerate(line):
            found += [row(f"{i}-{j}-{k}", names[i], names[j], Winner.LEFT) for k in range(count)]
    return found
