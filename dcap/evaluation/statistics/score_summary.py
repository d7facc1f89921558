"""Means and spreads of 1 to 10 scores, their composite, and the marks of significance of a table.

The composite is the geometric mean of the two axes' *means*: the published table 1 of the method follows from its own
means that way, to the last digit (8.61 and 8.94 give 8.77). The spread is the sample standard deviation over samples.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.bootstrap import (
    RESAMPLES,
    SEED,
    ConfidenceInterval,
    PairedDifference,
    mean_interval,
    paired_difference,
)
from dcap.scene.errors import InputError

SIGNIFICANT = 0.01
"""Largest p, excluded, at which a method is marked."""
DAGGER = "†"


@dataclass(frozen=True, slots=True)
class ScoreSummary:
    """One method's scores on one axis."""

    mean: float
    spread: float
    """Sample standard deviation over the samples; 0 for one."""
    interval: ConfidenceInterval
    """95 % of the mean, bootstrap over samples."""
    samples: int
    missing: int
    """Samples without a score."""


def summary_of(scores: NDArray[np.float64], resamples: int = RESAMPLES, seed: int = SEED) -> ScoreSummary:
    """Mean and spread of scores, shape (n,), nan where missing; InputError without any."""
    known = scores[~np.isnan(scores)]
    if len(known) == 0:
        raise InputError("there are no scores: a method without any cannot be summarised")
    spread = float(known.std(ddof=1)) if len(known) > 1 else 0.0
    interval = mean_interval(known, resamples, seed)
    return ScoreSummary(float(known.mean()), spread, interval, len(known), len(scores) - len(known))


def composite(means: Sequence[float]) -> float:
    """Geometric mean of positive numbers."""
    if not means or not all(0.0 < one < np.inf for one in means):
        raise InputError(f"a geometric mean needs positive numbers, got {list(means)}")
    return float(np.exp(np.log(np.asarray(means, dtype=float)).mean()))


@dataclass(frozen=True, slots=True)
class Significance:
    """One method against the best baseline."""

    best_baseline: str
    test: PairedDifference

    @property
    def mark(self) -> str:
        """Dagger if it is better, with p below 0.01; else empty."""
        return DAGGER if self.test.difference > 0 and self.test.p < SIGNIFICANT else ""


def against_best_baseline(
    scores: Mapping[str, NDArray[np.float64]],
    method: str,
    baselines: Sequence[str],
    resamples: int = RESAMPLES,
    seed: int = SEED,
) -> Significance | None:
    """The paired test of a method against the baseline with the highest mean (or composite); None without a baseline,
    and where no sample has all scores of both.

    `scores` by method: shape (n,) for one axis, (n, 2) for the composite; all in the same order of samples. The
    best baseline is chosen on all samples that it has; of equals the first.
    """
    known = {name: ~np.isnan(own.reshape(len(own), -1)) for name, own in scores.items()}
    there = [name for name in baselines if name in scores and name != method and known[name].any(axis=0).all()]
    if not there:
        return None
    best = max(there, key=lambda name: level_of(scores[name]))
    if not (known[method].all(axis=1) & known[best].all(axis=1)).any():
        return None
    return Significance(best, paired_difference(scores[method], scores[best], resamples, seed))


def level_of(scores: NDArray[np.float64]) -> float:
    """Mean of one axis, composite of several."""
    return (
        composite([float(one) for one in np.nanmean(scores.reshape(len(scores), -1), axis=0)])
        if scores.ndim > 1
        else float(np.nanmean(scores))
    )
