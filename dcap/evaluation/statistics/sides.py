"""Habits of a judge in its comparisons: how often it ties, prefers a side, and contradicts itself.

Source: [C34] Clopper and Pearson, Biometrika 26, 1934, 404-413 (the exact interval of a share).
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

from dcap.evaluation.statistics.bootstrap import LEVEL, ConfidenceInterval
from dcap.evaluation.statistics.comparisons import Comparison, Winner


@dataclass(frozen=True, slots=True)
class SideReport:
    """A judge's habits over its comparisons."""

    comparisons: int
    ties: int
    left: int
    """Number of comparisons won by the left one."""
    p: float | None
    """Two-sided exact binomial test of "left and right are preferred alike"; None if all are ties."""
    interval: ConfidenceInterval | None
    """95 % of the share of the left side among decided comparisons, exact [C34]."""
    both_orders: int
    """Pairs that were judged with either method on the left."""
    consistent: int
    """Of these, pairs with the same winner (or a tie) both times."""

    @property
    def tie_rate(self) -> float:
        """Share of ties, 0..1; 0 without comparisons."""
        return self.ties / self.comparisons if self.comparisons else 0.0

    @property
    def left_share(self) -> float | None:
        """Share of the left side among decided comparisons; None if there are none."""
        decided = self.comparisons - self.ties
        return self.left / decided if decided else None


def side_report(comparisons: Iterable[Comparison]) -> SideReport:
    """Ties, preference of a side and consistency over all given comparisons, on any axis."""
    from scipy.stats import binomtest  # takes a second to import, and most commands do not need it

    there = list(comparisons)
    ties = sum(one.winner is Winner.TIE for one in there)
    left, decided = sum(one.winner is Winner.LEFT for one in there), len(there) - ties
    test = binomtest(left, decided, 0.5) if decided else None
    exact = test.proportion_ci(LEVEL, method="exact") if test else None
    asked, agreed = orders(there)
    return SideReport(
        len(there),
        ties,
        left,
        float(test.pvalue) if test else None,
        ConfidenceInterval(float(exact.low), float(exact.high)) if exact else None,
        asked,
        agreed,
    )


def orders(comparisons: Iterable[Comparison]) -> tuple[int, int]:
    """Pairs judged in both orders, and those among them with a consistent outcome."""
    lefts, winners = defaultdict(set), defaultdict(set)
    for one in comparisons:
        key = (one.sample, one.axis, one.pair, one.judge)
        lefts[key].add(one.left_method)
        winners[key].add(one.winning_method)
    both = [key for key, names in lefts.items() if len(names) == 2]
    return len(both), sum(len(winners[key]) == 1 for key in both)
