"""The rows of a comparison of methods: scores and Elo of a judge, win rates of comparisons, each with its mark.

In: scores by method (rows in the same order of samples) and comparisons. Out: one row per method in the order given;
formatting is the report's. A mark is a dagger where a method is better than the best baseline *of that column* with
p < 0.01; a baseline is every other method that is named as one. Where `ours` is named, a baseline must beat that, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.bootstrap import RESAMPLES, SEED
from dcap.evaluation.statistics.comparisons import Comparison, JudgedAxis, on_axis, pair_counts
from dcap.evaluation.statistics.ratings import MethodRating, bradley_terry, elo_ratings, rating_difference_p
from dcap.evaluation.statistics.score_summary import (
    DAGGER,
    SIGNIFICANT,
    ScoreSummary,
    against_best_baseline,
    composite,
    summary_of,
)
from dcap.evaluation.statistics.win_rates import WinRate, win_rate_significance, win_rates
from dcap.scene.errors import InputError


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
