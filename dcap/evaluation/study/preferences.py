"""Win rates, Bradley-Terry ratings and agreement of votes, with intervals over scene-prompt pairs.

In: how often each method beat each other one, by scene-prompt pair. Intervals are percentiles of a cluster bootstrap:
whole scene-prompt pairs are drawn with replacement, since the votes on one of them are not independent.
Sources: [B52] Bradley, Terry, Biometrika 39 (1952) 324; [H04] Hunter, Ann. Statist. 32 (2004) 384, the iteration (3);
[K70] Krippendorff, Educ. Psychol. Meas. 30 (1970) 61.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESAMPLES = 10_000
RATING_RESAMPLES = 2_000
"""Of the ratings, each of which is an iteration [-]."""
LEVEL = 95.0
"""Of the intervals [percent]."""
PSEUDO = 0.1
"""Wins that are added on both sides of each pair of methods that was compared: ratings stay finite where one method
won every time [-]."""
STEPS, TOLERANCE = 2_000, 1e-10
MEAN_RATING, ELO = 1500.0, 400.0 / log(10.0)


@dataclass(frozen=True, slots=True)
class Interval:
    """A value and its interval."""

    value: float
    low: float
    high: float

    @property
    def all(self) -> tuple[float, float, float]:
        """Value, low, high."""
        return self.value, self.low, self.high


@dataclass(frozen=True, eq=False, slots=True)
class PreferenceCounts:
    """Who beat whom."""

    wins: Array
    """wins[s, i, j]: how often method i beat method j in scene-prompt pair s [-], shape (s, m, m)."""

    @property
    def totals(self) -> Array:
        """Over all pairs, shape (m, m)."""
        return np.asarray(self.wins.sum(axis=0))

    def resampled(self, count: int, seed: int) -> Array:
        """Totals of `count` draws of as many scene-prompt pairs with replacement, shape (count, m, m)."""
        clusters = len(self.wins)
        drawn = np.random.default_rng(seed).multinomial(clusters, np.full(clusters, 1.0 / clusters), size=count)
        return np.asarray(np.einsum("bs,sij->bij", drawn.astype(np.float64), self.wins))


def rates(totals: Array) -> Array:
    """Share of its comparisons that each method won, NaN without any; (..., m, m) to (..., m)."""
    won, lost = totals.sum(axis=-1), totals.sum(axis=-2)
    share = np.full(won.shape, np.nan)
    np.divide(won, won + lost, out=share, where=won + lost > 0)
    return share


def interval(value: float, drawn: Array) -> Interval:
    """The central LEVEL percent of what was drawn."""
    known = drawn[np.isfinite(drawn)]
    if not len(known):
        return Interval(value, np.nan, np.nan)
    low, high = np.percentile(known, [50 - LEVEL / 2, 50 + LEVEL / 2])
    return Interval(value, float(low), float(high))


def win_rates(counts: PreferenceCounts, seed: int) -> list[Interval]:
    """The win rate of each method."""
    drawn = rates(counts.resampled(RESAMPLES, seed))
    return [interval(float(value), drawn[:, i]) for i, value in enumerate(rates(counts.totals))]


def p_against_best(counts: PreferenceCounts, seed: int) -> list[float]:
    """For each method the share of draws in which it does not beat the best of the others; one draw is added to both,
    so that no p is zero."""
    value, drawn = rates(counts.totals), rates(counts.resampled(RESAMPLES, seed))
    found: list[float] = []
    for i in range(len(value)):
        others = np.delete(value, i)
        best = int(np.nanargmax(np.where(np.arange(len(value)) == i, np.nan, value))) if len(others) else i
        worse = np.count_nonzero(~(drawn[:, i] > drawn[:, best]))
        found.append(float(1 + worse) / (1 + len(drawn)))
    return found


def bradley_terry_ratings(counts: PreferenceCounts, seed: int) -> list[Interval]:
    """Maximum-likelihood strengths [B52] on Elo's scale with mean 1500."""
    value = ratings(counts.totals[None])[0]
    drawn = ratings(counts.resampled(RATING_RESAMPLES, seed))
    return [interval(float(one), drawn[:, i]) for i, one in enumerate(value)]


def ratings(totals: Array) -> Array:
    """Ratings of several tables (b, m, m) at once by the iteration of [H04], shape (b, m)."""
    compared = (totals + totals.transpose(0, 2, 1)) > 0
    wins = totals + PSEUDO * compared
    won, games = wins.sum(axis=2), wins + wins.transpose(0, 2, 1)
    strength = np.ones(won.shape)
    for _ in range(STEPS):
        weight = (games / (strength[:, :, None] + strength[:, None, :])).sum(axis=2)
        new = np.divide(won, weight, out=strength.copy(), where=weight > 0)
        new /= np.exp(np.log(new).mean(axis=1, keepdims=True))
        moved = float(np.abs(np.log(new / strength)).max())
        strength = new
        if moved < TOLERANCE:
            break
    return np.asarray(MEAN_RATING + ELO * np.log(strength))


def krippendorff_alpha(units: Sequence[Sequence[bool]]) -> float | None:
    """Agreement of several raters on yes or no [K70]: 1 where all agree, 0 as by chance; None where no unit has two
    answers, or all answers are the same."""
    pairable = [unit for unit in units if len(unit) > 1]
    ones, total = sum(sum(unit) for unit in pairable), sum(len(unit) for unit in pairable)
    by_chance = 2.0 * ones * (total - ones)
    if not total or not by_chance:
        return None
    observed = sum(2.0 * sum(unit) * (len(unit) - sum(unit)) / (len(unit) - 1) for unit in pairable)
    return 1.0 - (total - 1) * observed / by_chance
