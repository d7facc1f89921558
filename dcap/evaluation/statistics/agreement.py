"""How far raters agree on nominal choices: the share of pairs of raters, and Krippendorff's alpha.

In: what each rater chose for each item. None where nobody rated the same thing; alpha also where a single category was
ever used (then chance alone explains everything, 0 / 0). Kappas ask for the same raters, or as many, for every item:
raters of a study see some items together and others alone, and alpha takes them as they come.

Source: [K11] Krippendorff, Computing Krippendorff's Alpha-Reliability, 2011, section C (nominal data, any number of
raters, missing data).
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.comparisons import Comparison

Ratings = Sequence[Mapping[str, str]]
"""One mapping per item: rater to category."""
FIRST, SECOND, TIE = "first", "second", "tie"
"""Categories of comparisons."""


def ratings_of(comparisons: Iterable[Comparison]) -> list[Mapping[str, str]]:
    """Items are pairs of methods on a sample and axis, whichever side they were on; categories are FIRST and SECOND of
    the pair in alphabetical order, and TIE. Names of methods would be no categories: each item allows two of them only,
    and raters who toss coins would seem to agree more than by chance.

    What one judge said of the same pair more than once counts where it always said the same, else as a tie."""
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


def krippendorff_alpha(ratings: Ratings) -> float | None:
    """1 - D_o / D_e for nominal categories; lone raters are left out, missing ones allowed [K11, section C]."""
    counts = category_counts(ratings)
    counts = counts[counts.sum(axis=1) > 1]
    if len(counts) == 0:
        return None
    raters = counts.sum(axis=1)
    total, by_category = counts.sum(), counts.sum(axis=0)
    agreeing = float(((counts * (counts - 1)).sum(axis=1) / (raters - 1)).sum())  # diagonal of the coincidences
    expected = float((by_category * (by_category - 1)).sum()) / (total - 1)
    return None if expected == total else 1.0 - (total - agreeing) / (total - expected)
