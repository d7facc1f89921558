"""Bootstrap over scene-prompt pairs: intervals and p values of means, differences and anything computed from counts.

A resample draws as many samples as there are, with replacement. Statistics weight each sample by how often it was
drawn. All columns and all methods of a resample share the same draw, which makes comparisons paired [E93, chapters 13
and 16]. Intervals are percentile intervals; the two-sided p inverts them: twice the smaller share of resamples on one
side of zero. Both counts get plus one, so that p is never 0, and `two_sided_p` bounds p for few samples.

Sources: [E93] Efron and Tibshirani, An Introduction to the Bootstrap, 1993; [D97] Davison and Hinkley, Bootstrap
Methods and their Application, 1997, section 4.2 (the plus one).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError

RESAMPLES = 10_000
SEED = 20_240_917
"""An arbitrary fixed seed: the same input gives the same interval."""
LEVEL = 0.95
CHUNK = 2_000_000
"""Most weights drawn at once: 16 MB."""


@dataclass(frozen=True, slots=True)
class ConfidenceInterval:
    """A confidence interval."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """Difference between two methods on the samples that both have."""

    difference: float
    """Difference of the means, or of their composites."""
    interval: ConfidenceInterval
    p: float
    """Two-sided."""
    samples: int
    """Number of samples on which both have a value."""


def draws(count: int, resamples: int = RESAMPLES, seed: int = SEED) -> Iterator[NDArray[np.float64]]:
    """How often each of `count` samples is drawn, in chunks of shape (b, count) that add up to `resamples` rows."""
    if count < 1 or resamples < 1:
        raise InputError(f"a bootstrap of {count} samples with {resamples} resamples: both must be positive")
    random = np.random.default_rng(seed)
    rows = max(1, CHUNK // count)
    for start in range(0, resamples, rows):
        yield random.multinomial(count, np.full(count, 1.0 / count), size=min(rows, resamples - start)).astype(float)


def resampled_means(values: NDArray[np.float64], resamples: int = RESAMPLES, seed: int = SEED) -> NDArray[np.float64]:
    """Means of each column over each resample: from shape (n, c) to (resamples, c); no value may be missing."""
    if values.ndim != 2 or not np.isfinite(values).all():
        raise InputError(f"values of shape {values.shape} must be a finite table of samples by columns")
    return np.concatenate([weights @ values for weights in draws(len(values), resamples, seed)]) / len(values)


def interval_of(resampled: NDArray[np.float64], level: float = LEVEL) -> ConfidenceInterval:
    """Percentile interval of a statistic over resamples, shape (b,)."""
    low, high = np.quantile(resampled, [0.5 * (1.0 - level), 0.5 * (1.0 + level)])
    return ConfidenceInterval(float(low), float(high))


def two_sided_p(resampled: NDArray[np.float64], samples: int) -> float:
    """p of the hypothesis that a difference is 0, from its values over resamples (b,): at most 1, at least 2 / (b + 1)
    and 2^(1 - samples).

    The latter is the p of the exact sign-flip test if all samples agree, because resampling adds no information.
    Eight samples are the fewest for p < 0.01.
    """
    below, above = int((resampled <= 0.0).sum()), int((resampled >= 0.0).sum())
    return min(1.0, max(2.0 * (min(below, above) + 1) / (len(resampled) + 1), 2.0 ** (1 - samples)))


def mean_interval(values: NDArray[np.float64], resamples: int = RESAMPLES, seed: int = SEED) -> ConfidenceInterval:
    """ConfidenceInterval of the mean of values, shape (n,); missing ones (nan) are left out."""
    known = values[~np.isnan(values)]
    return interval_of(resampled_means(known[:, None], resamples, seed)[:, 0])


def paired_difference(
    ours: NDArray[np.float64], theirs: NDArray[np.float64], resamples: int = RESAMPLES, seed: int = SEED
) -> PairedDifference:
    """Ours minus theirs, sample by sample.

    Shapes (n,): difference of means. Shapes (n, c): difference of composites, each the geometric mean of its c means.
    Samples on which a value of either is missing (nan) are left out.
    """
    if ours.shape != theirs.shape or ours.ndim not in (1, 2):
        raise InputError(f"paired values have shapes {ours.shape} and {theirs.shape}; both must be (n,) or (n, c)")
    first, second = ours.reshape(len(ours), -1), theirs.reshape(len(theirs), -1)
    both = np.hstack([first, second])
    known = both[~np.isnan(both).any(axis=1)]
    if len(known) == 0:
        raise InputError("no sample has a value of both methods: they cannot be compared")
    resampled = gap_of(resampled_means(known, resamples, seed))
    return PairedDifference(
        difference=float(gap_of(known.mean(axis=0)[None])[0]),
        interval=interval_of(resampled),
        p=two_sided_p(resampled, len(known)),
        samples=len(known),
    )


def gap_of(means: NDArray[np.float64]) -> NDArray[np.float64]:
    """Composite of the first half of the columns minus that of the second, shape (b, 2 c) to (b,)."""
    half = means.shape[1] // 2
    if half == 1:
        return np.asarray(means[:, 0] - means[:, 1])
    logs = np.log(means)
    return np.asarray(np.exp(logs[:, :half].mean(axis=1)) - np.exp(logs[:, half:].mean(axis=1)))
