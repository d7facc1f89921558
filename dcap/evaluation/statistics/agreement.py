"""Agreement of raters on nominal choices, and the habits of a judge in its comparisons.

In: each rater's choice for each item. None if no item has two raters; alpha also if chance alone explains everything (a
single category was ever used: 0 / 0). Kappas need the same raters, or as many, for every item. Raters of a study see
some items together and others alone, which alpha allows.

Names decide which method of a pair is FIRST. If chance agreement were computed from FIRST and SECOND directly, raters
who agree on nearly everything would seem to agree by chance when the better method is mostly FIRST. So each item counts
in both orientations: the two values have no meaning without their item.

Source: [K11] Krippendorff, Computing Krippendorff's Alpha-Reliability, 2011, section C (nominal data, any number of
raters, missing data).

Habits: how often a judge ties, prefers a side, and contradicts itself.

Source: [C34] Clopper and Pearson, Biometrika 26, 1934, 404-413 (the exact interval of a share).
"""

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.bootstrap import LEVEL, ConfidenceInterval
from dcap.evaluation.statistics.comparisons import Comparison, Winner

Ratings = Sequence[Mapping[str, str]]
"""One mapping per item: rater to category."""
FIRST, SECOND, TIE = "first", "second", "tie"
"""Categories of comparisons."""
SIDES = (FIRST, SECOND)
"""Categories that swap if the two methods of a pair swap."""


def ratings_of(comparisons: Iterable[Comparison]) -> list[Mapping[str, str]]:
    """Items are pairs of methods on a sample and axis, on either side; categories are FIRST and SECOND of the pair in
    alphabetical order, and TIE. Names of methods cannot be categories: each item allows only two of them, and raters
    who toss coins would seem to agree more than by chance.

    Repeated choices of one judge for the same pair count if they are all equal, else as a tie."""
    said: dict[tuple[str, str, tuple[str, str]], dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for one in comparisons:
        place = {"": TIE, one.pair[0]: FIRST, one.pair[1]: SECOND}[one.winning_method]
        said[one.sample, one.axis, one.pair][one.judge].add(place)
    return [
        {judge: next(iter(winners)) if len(winners) == 1 else TIE for judge, winners in sorted(by_judge.items())}
        for _, by_judge in sorted(said.items())
    ]


def category_counts(ratings: Ratings) -> NDArray[np.float64]:
    """How many raters chose each category, shape (items, categories)."""
    categories = sorted({category for item in ratings for category in item.values()})
    found = np.zeros((len(ratings), len(categories)))
    for k, item in enumerate(ratings):
        for category in item.values():
            found[k, categories.index(category)] += 1
    return found


def percent_agreement(ratings: Ratings) -> float | None:
    """Share of pairs of raters of an item that chose the same, averaged over items with two raters and more."""
    counts = category_counts(ratings)
    raters = counts.sum(axis=1)
    counts, raters = counts[raters > 1], raters[raters > 1]
    if len(counts) == 0:
        return None
    return float(((counts * (counts - 1)).sum(axis=1) / (raters * (raters - 1))).mean())


def krippendorff_alpha(ratings: Ratings, exchangeable: Collection[str] = ()) -> float | None:
    """1 - D_o / D_e for nominal categories; lone raters are left out, missing ones allowed [K11, section C].

    Of `exchangeable` categories each item counts in all orientations. That leaves D_o as it is, and in D_e two values
    of such categories, d of all n, are alike in one of so many cases: with two of them and t other values of one kind 1
    - D_e = (d (d - 1) / 2 + t (t - 1)) / (n (n - 1)). As in the plain formula no value is paired with itself, nor with
    itself in the other orientation: items written down twice would give 2 n - 1 for 2 (n - 1), as if orientations were
    further raters, and 1 / (2 n) instead of 0 to those who toss coins.
    """
    shared = [item for item in ratings if len(item) > 1]
    if not shared:
        return None
    counts = category_counts(shared)
    agreeing = float(((counts * (counts - 1)).sum(axis=1) / (counts.sum(axis=1) - 1)).sum())  # diagonal of coincidences
    chosen = Counter(category for item in shared for category in item.values())
    total, sided = chosen.total(), sum(chosen.pop(one, 0) for one in exchangeable)
    alike = sum(n * (n - 1) for n in chosen.values()) + sided * (sided - 1) / max(1, len(exchangeable))
    expected = alike / (total - 1)
    return None if expected == total else 1.0 - (total - agreeing) / (total - expected)


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
