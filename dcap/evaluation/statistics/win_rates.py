"""Win rates of methods over all their comparisons, with intervals, and whether one is significantly higher.

A tie counts half. The main interval resamples whole samples (cluster bootstrap), which has no width if all samples
agree, such as when a method won everything: then it is Wilson's score interval [W27] with samples as trials. Wilson's
interval with each comparison as an independent trial is given as well.

Source: [W27] Wilson, Journal of the American Statistical Association 22, 1927, 209-212.
"""

from collections.abc import Sequence
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
from dcap.evaluation.statistics.comparisons import PairCounts
from dcap.evaluation.statistics.score_summary import Significance
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
