"""The rows of a comparison of methods: scores, Elo and win rates, with intervals and marks.

In: scores by method (rows in the same order of samples) and comparisons. Out: one row per method in the order given;
formatting is the report's. A mark is a dagger where a method is better than the best baseline *of that column* with
p < 0.01; a baseline is every other method that is named as one. Where `ours` is named, a baseline must beat that, too.

Win rates of methods over all their comparisons, with intervals, and whether one is significantly higher.

A tie counts half. The main interval resamples whole samples (cluster bootstrap), which has no width if all samples
agree, such as when a method won everything: then it is Wilson's score interval [W27] with samples as trials. Wilson's
interval with each comparison as an independent trial is given as well.

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
    PairedDifference,
    draws,
    interval_of,
    two_sided_p,
)
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, PairCounts, on_axis, pair_counts
from dcap.evaluation.statistics.ratings import MethodRating, bradley_terry, elo_ratings, rating_difference_p
from dcap.evaluation.statistics.score_summary import (
    DAGGER,
    SIGNIFICANT,
    ScoreSummary,
    Significance,
    against_best_baseline,
    composite,
    summary_of,
)
from dcap.scene.errors import InputError

SAME = 1e-9
"""Difference below which rates of resamples are equal up to rounding [-]."""


@dataclass(frozen=True, slots=True)
class WinRate:
    """One method's share of wins."""

    method: str
    rate: float
    """0..1, ties count half."""
    interval: ConfidenceInterval
    """95 %, cluster bootstrap over samples; Wilson's with samples as trials if all of them agree."""
    wilson: ConfidenceInterval
    """95 %, every comparison an independent trial."""
    comparisons: int


def win_rates(counts: PairCounts, resamples: int = RESAMPLES, seed: int = SEED) -> list[WinRate]:
    """Win rates of all methods that were compared, in the order of `counts`."""
    won, met = won_and_met(counts)
    resampled = resampled_rates(won, met, resamples, seed)
    found = []
    for k, method in enumerate(counts.methods):
        trials = float(met[:, k].sum())
        if trials == 0:
            continue
        wins = float(won[:, k].sum())
        clusters = int((met[:, k] > 0).sum())
        spread = interval_of(resampled[:, k][~np.isnan(resampled[:, k])])
        if spread.high - spread.low < SAME:  # all samples agree: resampling does not reflect how many there were
            spread = wilson_interval(clusters * wins / trials, clusters)
        found.append(WinRate(method, wins / trials, spread, wilson_interval(wins, trials), round(trials)))
    return found


def win_rate_significance(
    counts: PairCounts, method: str, baselines: Sequence[str], resamples: int = RESAMPLES, seed: int = SEED
) -> Significance | None:
    """The test of a method's win rate against the highest of a baseline, by resampling samples; None without one."""
    won, met = won_and_met(counts)
    trials = met.sum(axis=0)
    rates = {name: float(won[:, k].sum() / trials[k]) for k, name in enumerate(counts.methods) if trials[k]}
    there = [name for name in baselines if name in rates and name != method]
    if not there:
        return None
    if method not in rates:
        raise InputError(f"{method} has no comparison: its win rate is unknown")
    best = max(there, key=lambda name: rates[name])
    ours, theirs = counts.methods.index(method), counts.methods.index(best)
    resampled = resampled_rates(won, met, resamples, seed)
    gaps = resampled[:, ours] - resampled[:, theirs]
    gaps = gaps[~np.isnan(gaps)]
    both = counts.samples_of_both(ours, theirs)
    test = PairedDifference(
        rates[method] - rates[best], interval_of(gaps), two_sided_p(gaps, both), both, len(counts.samples) - both
    )
    return Significance(best, test)


def won_and_met(counts: PairCounts) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Wins (with half of the ties) and comparisons by sample and method, shapes (k, m)."""
    return counts.shared_wins.sum(axis=2), counts.met


def resampled_rates(
    won: NDArray[np.float64], met: NDArray[np.float64], resamples: int, seed: int
) -> NDArray[np.float64]:
    """Win rates over each resample, shape (resamples, m); nan where a method was not drawn at all."""
    found = []
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


@dataclass(frozen=True, slots=True)
class ScoreRow:
    """One method before a judge: a row of the table of scores."""

    method: str
    right_place: ScoreSummary | None
    """None if no sample has a score."""
    physics_naturalness: ScoreSummary | None
    """None if no sample has a score."""
    composite: float | None
    """Geometric mean of the two means; None if one is unknown."""
    samples: int
    """Number of samples with a score on at least one axis."""
    elo: MethodRating | None
    """None without comparisons."""
    marks: Mapping[str, str]
    """Dagger or empty for `right_place`, `physics_naturalness`, `composite` and `elo`."""
    p: Mapping[str, float]
    """Two-sided p of the same tests; none without a rival."""


@dataclass(frozen=True, slots=True)
class PreferenceRow:
    """One method in comparisons: a row of table 2."""

    method: str
    rates: Mapping[JudgedAxis, WinRate]
    """Win rates on the axes on which it was compared."""
    rating: MethodRating | None
    """Bradley-Terry over the overall comparisons; None without any."""
    marks: Mapping[JudgedAxis, str]
    """Dagger or empty."""
    p: Mapping[JudgedAxis, float]
    """Two-sided p of the same tests; none without a rival."""


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
    elo, elo_p = overall_elo(list(scores), comparisons, baselines, anchor, ours, resamples, seed)
    columns = {
        JudgedAxis.RIGHT_PLACE.value: {name: value[:, 0] for name, value in scores.items()},
        JudgedAxis.PHYSICS_NATURALNESS.value: {name: value[:, 1] for name, value in scores.items()},
        "composite": dict(scores),
    }
    rows = []
    for method in scores:
        known = ~np.isnan(scores[method])
        place, physics = (
            summary_of(scores[method][:, k], resamples, seed) if known[:, k].any() else None for k in (0, 1)
        )
        marks: dict[str, str] = {"elo": ""}
        p: dict[str, float] = {}
        for name, column in columns.items():
            test = against_best_baseline(column, method, rivals(method, baselines, ours), resamples, seed)
            marks[name] = test.mark if test else ""
            p |= {name: test.test.p} if test else {}
        if method in elo_p:
            p["elo"], above = elo_p[method]
            marks["elo"] = DAGGER if above and p["elo"] < SIGNIFICANT else ""
        both = composite([place.mean, physics.mean]) if place and physics else None
        there = int(known.any(axis=1).sum())
        rows.append(ScoreRow(method, place, physics, both, there, elo.get(method), marks, p))
    return rows


def rivals(method: str, baselines: Sequence[str], ours: str) -> Sequence[str]:
    """Methods to beat for a mark: the baselines, and for a baseline also `ours`."""
    return [*baselines, ours] if method in baselines and ours not in ("", *baselines) else baselines


def overall_elo(
    methods: Sequence[str],
    comparisons: Sequence[Comparison],
    baselines: Sequence[str],
    anchor: str,
    ours: str,
    resamples: int,
    seed: int,
) -> tuple[dict[str, MethodRating], dict[str, tuple[float, bool]]]:
    """Elo over the overall comparisons; and p of the test of each against its best rival, and whether it is above it:
    the test is that of Bradley-Terry ratings, in which a tie is not counted twice."""
    overall = on_axis(comparisons, JudgedAxis.OVERALL)
    if not overall:
        return {}, {}
    counts = pair_counts(overall)
    there = [name for name in methods if name in counts.methods]
    ratings = {one.method: one for one in elo_ratings(counts, anchor or (there or counts.methods)[-1],
                                                      resamples=resamples, seed=seed)}  # fmt: skip
    tests = {}
    for name in there:
        others = [one for one in rivals(name, baselines, ours) if one in ratings and one != name]
        if others:
            best = max(others, key=lambda one: ratings[one].rating)
            above = ratings[name].rating > ratings[best].rating
            tests[name] = rating_difference_p(counts, name, best, resamples, seed), above
    return ratings, tests


def preference_rows(
    methods: Sequence[str],
    comparisons: Sequence[Comparison],
    baselines: Sequence[str],
    ours: str = "",
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> list[PreferenceRow]:
    """Rows of table 2, for the methods that were compared on some axis."""
    p: dict[str, dict[JudgedAxis, float]] = {name: {} for name in methods}
    rates: dict[str, dict[JudgedAxis, WinRate]] = {name: {} for name in methods}
    marks: dict[str, dict[JudgedAxis, str]] = {name: {} for name in methods}
    ratings: dict[str, MethodRating] = {}
    for axis in JudgedAxis:
        there = on_axis(comparisons, axis)
        if not there:
            continue
        counts = pair_counts(there)
        for one in win_rates(counts, resamples, seed):
            if one.method in rates:
                against = rivals(one.method, baselines, ours)
                test = win_rate_significance(counts, one.method, against, resamples, seed)
                rates[one.method][axis], marks[one.method][axis] = one, test.mark if test else ""
                p[one.method] |= {axis: test.test.p} if test else {}
        if axis is JudgedAxis.OVERALL:
            ratings = {one.method: one for one in bradley_terry(counts, resamples=resamples, seed=seed)}
    return [
        PreferenceRow(name, rates[name], ratings.get(name), marks[name], p[name]) for name in methods if rates[name]
    ]
