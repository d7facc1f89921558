"""The rows of a comparison of methods: scores, Elo and win rates, with intervals and marks.

In: scores by method (rows in the same order of samples) and comparisons. Out: one row per method in the order given;
formatting is the report's. A mark is a dagger where a method is better than the best baseline *of that column* with
p < 0.01; a baseline is every other method that is named as one. Where `ours` is named, a baseline must beat that, too.

The composite is the geometric mean of the two axes' *means*: the published table 1 of the method follows from its own
means that way, to the last digit (8.61 and 8.94 give 8.77). In a win rate a tie counts half. Its interval resamples
whole samples (cluster bootstrap); this has no width if all samples agree, such as when a method won everything: then
it is Wilson's score interval [W27] with samples as trials.

Source: [W27] Wilson, Journal of the American Statistical Association 22, 1927, 209-212.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from dcap.evaluation.statistics.bootstrap import (
    LEVEL,
    RESAMPLES,
    SEED,
    ConfidenceInterval,
    draws,
    interval_of,
    mean_interval,
    paired_difference,
    two_sided_p,
)
from dcap.evaluation.statistics.comparisons import AXES, Comparison, JudgedAxis, PairCounts, on_axis, pair_counts
from dcap.evaluation.statistics.ratings import MethodRating, bradley_terry, elo_ratings, rating_difference_p
from dcap.scene.errors import InputError

SIGNIFICANT = 0.01
"""Largest p, excluded, at which a method is marked."""
DAGGER = "†"
SAME = 1e-9
"""Difference below which rates of resamples are equal up to rounding [-]."""
COMPOSITE, ELO = "composite", "elo"
"""Columns of the table of scores in addition to those of the two axes."""


@dataclass(frozen=True, slots=True)
class BestRivalTest:
    """A method against the best of its rivals in a column."""

    rival: str
    difference: float
    """Value of the method minus the rival's."""
    p: float
    """Two-sided, paired bootstrap over samples."""

    @property
    def mark(self) -> str:
        """Dagger if the method is better, with p below 0.01; else empty."""
        return DAGGER if self.difference > 0 and self.p < SIGNIFICANT else ""


@dataclass(frozen=True, slots=True)
class ComparedRow:
    """One method in a table, with the tests of its columns."""

    method: str
    tests: Mapping[str, BestRivalTest]
    """By column; none where there is no rival."""

    def mark(self, column: str) -> str:
        """Dagger or empty."""
        return self.tests[column].mark if column in self.tests else ""

    def p(self, column: str) -> float | None:
        """p of a column; None without a rival."""
        return self.tests[column].p if column in self.tests else None


@dataclass(frozen=True, slots=True)
class ScoreSummary:
    """One method's scores on one axis."""

    mean: float
    spread: float
    """Sample standard deviation over the samples; 0 for one."""
    interval: ConfidenceInterval
    """95 % of the mean, bootstrap over samples."""
    samples: int


@dataclass(frozen=True, slots=True)
class ScoreRow(ComparedRow):
    """One method before a judge: a row of the table of scores."""

    scores: Mapping[JudgedAxis, ScoreSummary]
    """On the axes on which some sample has a score."""
    composite: float | None
    """Geometric mean of the two means; None if one is unknown."""
    samples: int
    """Number of samples with a score on at least one axis."""
    elo: MethodRating | None
    """None without comparisons."""


@dataclass(frozen=True, slots=True)
class WinRate:
    """One method's share of wins."""

    method: str
    rate: float
    """0..1, ties count half."""
    interval: ConfidenceInterval
    """95 %, cluster bootstrap over samples; Wilson's with samples as trials if all of them agree."""
    comparisons: int


@dataclass(frozen=True, slots=True)
class PreferenceRow(ComparedRow):
    """One method in comparisons: a row of table 2."""

    rates: Mapping[JudgedAxis, WinRate]
    """Win rates on the axes on which it was compared."""
    rating: MethodRating | None
    """Bradley-Terry over the overall comparisons; None without any."""


def rivals_of(method: str, baselines: Sequence[str], ours: str) -> list[str]:
    """Methods to beat for a mark: the other baselines, and for a baseline also `ours`."""
    others = [name for name in baselines if name != method]
    return [*others, ours] if method in baselines and ours not in ("", *baselines) else others


def score_rows(
    scores: Mapping[str, NDArray[np.float64]],
    comparisons: Sequence[Comparison],
    baselines: Sequence[str],
    anchor: str = "",
    ours: str = "",
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> list[ScoreRow]:
    """Rows of the table of scores.

    Args:
        scores: by method, shape (n, 2): Right Place and Physics & Naturalness per sample, nan where there is none.
        comparisons: of all axes; Elo is that of the overall ones.
        baselines: which methods count as such.
        anchor: method with the fixed Elo rating; by default the last of those that were compared, in the order of
            `scores`.
        ours: what a baseline must beat, too, for a mark.
        resamples: of every bootstrap.
        seed: of every bootstrap.
    """
    if len({value.shape for value in scores.values()}) != 1 or any(v.shape[1:] != (2,) for v in scores.values()):
        raise InputError("scores of all methods must have one shape (samples, 2), in the same order of samples")
    overall = on_axis(comparisons, JudgedAxis.OVERALL)
    counts = pair_counts(overall) if overall else None
    elo: dict[str, MethodRating] = {}
    if counts:
        fixed = anchor or ([name for name in scores if name in counts.methods] or counts.methods)[-1]
        elo = {one.method: one for one in elo_ratings(counts, fixed, resamples=resamples, seed=seed)}
    columns = {axis.value: {name: value[:, k] for name, value in scores.items()} for k, axis in enumerate(AXES)}
    rows = []
    for method, own in scores.items():
        known = ~np.isnan(own)
        summaries = {axis: summary_of(own[:, k], resamples, seed) for k, axis in enumerate(AXES) if known[:, k].any()}
        rivals = rivals_of(method, baselines, ours)
        found = {name: score_test(column, method, rivals, resamples, seed)
                 for name, column in {**columns, COMPOSITE: scores}.items()}  # fmt: skip
        found[ELO] = elo_test(counts, elo, method, rivals, resamples, seed) if counts else None
        rows.append(
            ScoreRow(
                method=method,
                tests={name: test for name, test in found.items() if test},
                scores=summaries,
                composite=composite([one.mean for one in summaries.values()]) if len(summaries) == len(AXES) else None,
                samples=int(known.any(axis=1).sum()),
                elo=elo.get(method),
            )
        )
    return rows


def summary_of(scores: NDArray[np.float64], resamples: int = RESAMPLES, seed: int = SEED) -> ScoreSummary:
    """Mean and spread of scores, shape (n,), nan where missing; InputError without any."""
    known = scores[~np.isnan(scores)]
    if len(known) == 0:
        raise InputError("there are no scores: a method without any cannot be summarised")
    spread = float(known.std(ddof=1)) if len(known) > 1 else 0.0
    return ScoreSummary(float(known.mean()), spread, mean_interval(known, resamples, seed), len(known))


def composite(means: Sequence[float]) -> float:
    """Geometric mean of positive numbers."""
    if not means or not all(0.0 < one < np.inf for one in means):
        raise InputError(f"a geometric mean needs positive numbers, got {list(means)}")
    return float(np.exp(np.log(np.asarray(means, dtype=float)).mean()))


def score_test(
    scores: Mapping[str, NDArray[np.float64]],
    method: str,
    rivals: Sequence[str],
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> BestRivalTest | None:
    """The paired test of a method against the rival with the highest mean (or composite); None without one, and where
    no sample has all scores of both.

    `scores` by method: shape (n,) for one axis, (n, 2) for the composite; all in the same order of samples. The best
    rival is chosen on all samples that it has; of equals the first.
    """
    tables = {name: own.reshape(len(own), -1) for name, own in scores.items()}
    known = {name: ~np.isnan(own) for name, own in tables.items()}
    levels = {
        name: composite(np.nanmean(tables[name], axis=0).tolist())
        for name in rivals
        if name in tables and known[name].any(axis=0).all()
    }
    if not levels:
        return None
    best = max(levels, key=lambda name: levels[name])
    if not (known[method].all(axis=1) & known[best].all(axis=1)).any():
        return None
    found = paired_difference(scores[method], scores[best], resamples, seed)
    return BestRivalTest(best, found.difference, found.p)


def elo_test(
    counts: PairCounts,
    ratings: Mapping[str, MethodRating],
    method: str,
    rivals: Sequence[str],
    resamples: int,
    seed: int,
) -> BestRivalTest | None:
    """The test of a method's Elo against its best rival's; p is that of Bradley-Terry ratings, in which a tie is not
    counted twice."""
    others = [name for name in rivals if name in ratings]
    if not others or method not in ratings:
        return None
    best = max(others, key=lambda name: ratings[name].rating)
    difference = ratings[method].rating - ratings[best].rating
    return BestRivalTest(best, difference, rating_difference_p(counts, method, best, resamples, seed))


def preference_rows(
    methods: Sequence[str],
    comparisons: Sequence[Comparison],
    baselines: Sequence[str],
    ours: str = "",
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> list[PreferenceRow]:
    """Rows of table 2, for the methods that were compared on some axis."""
    rates: dict[str, dict[JudgedAxis, WinRate]] = {name: {} for name in methods}
    tests: dict[str, dict[str, BestRivalTest]] = {name: {} for name in methods}
    ratings: dict[str, MethodRating] = {}
    for axis in JudgedAxis:
        there = on_axis(comparisons, axis)
        if not there:
            continue
        counts = pair_counts(there)
        for one in win_rates(counts, resamples, seed):
            if one.method in rates:
                rates[one.method][axis] = one
                test = win_rate_test(counts, one.method, rivals_of(one.method, baselines, ours), resamples, seed)
                tests[one.method] |= {axis.value: test} if test else {}
        if axis is JudgedAxis.OVERALL:
            ratings = {one.method: one for one in bradley_terry(counts, resamples=resamples, seed=seed)}
    return [PreferenceRow(name, tests[name], rates[name], ratings.get(name)) for name in methods if rates[name]]


def win_rates(counts: PairCounts, resamples: int = RESAMPLES, seed: int = SEED) -> list[WinRate]:
    """Win rates of all methods that were compared, in the order of `counts`."""
    won, met = counts.won, counts.met
    resampled = resampled_rates(counts, resamples, seed)
    found = []
    for k, method in enumerate(counts.methods):
        trials = float(met[:, k].sum())
        if trials == 0:
            continue
        rate, clusters = float(won[:, k].sum()) / trials, int((met[:, k] > 0).sum())
        spread = interval_of(resampled[:, k][~np.isnan(resampled[:, k])])
        if spread.high - spread.low < SAME:  # all samples agree: resampling does not reflect how many there were
            spread = wilson_interval(clusters * rate, clusters)
        found.append(WinRate(method, rate, spread, round(trials)))
    return found


def win_rate_test(
    counts: PairCounts, method: str, rivals: Sequence[str], resamples: int = RESAMPLES, seed: int = SEED
) -> BestRivalTest | None:
    """The test of a method's win rate against its best rival's, by resampling samples; None without a rival."""
    won, trials = counts.won.sum(axis=0), counts.met.sum(axis=0)
    rates = {name: float(won[k] / trials[k]) for k, name in enumerate(counts.methods) if trials[k]}
    there = [name for name in rivals if name in rates]
    if not there:
        return None
    if method not in rates:
        raise InputError(f"{method} has no comparison: its win rate is unknown")
    best = max(there, key=lambda name: rates[name])
    mine, theirs = counts.methods.index(method), counts.methods.index(best)
    resampled = resampled_rates(counts, resamples, seed)
    gaps = resampled[:, mine] - resampled[:, theirs]
    p = two_sided_p(gaps[~np.isnan(gaps)], counts.samples_of_both(mine, theirs))
    return BestRivalTest(best, rates[method] - rates[best], p)


def resampled_rates(counts: PairCounts, resamples: int, seed: int) -> NDArray[np.float64]:
    """Win rates over each resample, shape (resamples, m); nan where a method was not drawn at all."""
    won, met, found = counts.won, counts.met, []
    for weights in draws(len(won), resamples, seed):
        trials = weights @ met
        found.append(np.divide(weights @ won, trials, out=np.full_like(trials, np.nan), where=trials > 0))
    return np.concatenate(found)


def wilson_interval(wins: float, trials: float, level: float = LEVEL) -> ConfidenceInterval:
    """Score interval of a share: the rates p for which |wins/n - p| <= z sqrt(p (1 - p) / n) [W27]."""
    z2 = float(ndtri(0.5 * (1.0 + level))) ** 2
    center = (wins + 0.5 * z2) / (trials + z2)
    half = np.sqrt(z2 * (wins * (trials - wins) / trials + 0.25 * z2)) / (trials + z2)
    return ConfidenceInterval(float(max(0.0, center - half)), float(min(1.0, center + half)))
