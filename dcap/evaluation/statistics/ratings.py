"""Ratings from comparisons: Elo by maximum likelihood, and Bradley-Terry with intervals and standard errors.

Elo follows the recipe of GPTEval3D [W24]: a tie counts as a win of *both*, one method is the anchor with a fixed
rating, and sum A_ij log(1 + 10^((R_j - R_i) / 400)) is smallest. Its published code runs 10,000 steps of Adam; the
problem is convex, so here Newton's method solves it to convergence (pairwise_fit.py). Bradley-Terry counts half of a
tie for each and has the mean rating fixed. Both are on the scale on which 400 points are odds of 10 to 1.

Intervals resample whole samples (cluster bootstrap), since comparisons on one sample are not independent. A resample
in which a method was not drawn has no information on it, and does not count for it: the ridge would put it at the mean.
The standard errors from the Hessian treat every comparison as independent.

Source: [W24] Wu et al., GPT-4V(ision) is a Human-Aligned Evaluator for Text-to-3D Generation, CVPR 2024.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.bootstrap import RESAMPLES, SEED, ConfidenceInterval, draws, interval_of, two_sided_p
from dcap.evaluation.statistics.comparisons import PairCounts
from dcap.evaluation.statistics.pairwise_fit import StrengthFit, fit_strengths
from dcap.scene.errors import InputError

POINTS = 400.0 / np.log(10.0)
"""Elo points of one unit of log-odds."""
ANCHOR_RATING = 1000.0
"""Rating of the anchor, as in [W24]."""
MEAN_RATING = 1500.0
"""Mean of Bradley-Terry ratings."""


@dataclass(frozen=True, slots=True)
class MethodRating:
    """One method's rating."""

    method: str
    rating: float
    """[Elo points]."""
    interval: ConfidenceInterval
    """95 %, cluster bootstrap over samples."""
    standard_error: float | None
    """From the Hessian [Elo points]; None for Elo, whose ties count twice, and where the ridge decided."""
    separable: bool
    """Whether some method won, or lost, everything against the rest, so that a ridge keeps ratings finite."""


def elo_ratings(
    counts: PairCounts, anchor: str, rating: float = ANCHOR_RATING, resamples: int = RESAMPLES, seed: int = SEED
) -> list[MethodRating]:
    """Elo of all methods, in the order of `counts`, with the anchor's rating fixed."""
    if anchor not in counts.methods:
        raise InputError(f"anchor {anchor!r} is not one of {', '.join(counts.methods)}")
    column = counts.methods.index(anchor)
    fit, resampled = fits(counts, counts.doubled_wins, resamples, seed)

    def anchored(theta: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(rating + POINTS * (theta - theta[:, [column]]))

    return rated(counts, anchored(fit.theta), anchored(resampled), None, bool(fit.separable[0]))


def bradley_terry(
    counts: PairCounts, mean: float = MEAN_RATING, resamples: int = RESAMPLES, seed: int = SEED
) -> list[MethodRating]:
    """Bradley-Terry ratings of all methods, in the order of `counts`, with this mean."""
    fit, resampled = fits(counts, counts.shared_wins, resamples, seed)
    separable = bool(fit.separable[0])
    errors = None if separable else POINTS * fit.standard_errors()[0]
    return rated(counts, mean + POINTS * fit.theta, mean + POINTS * resampled, errors, separable)


def rating_difference_p(
    counts: PairCounts, ours: str, theirs: str, resamples: int = RESAMPLES, seed: int = SEED
) -> float:
    """Two-sided p that two methods have the same Bradley-Terry rating, by bootstrap over samples; only samples on which
    both were compared limit it, however many others there are."""
    _, resampled = fits(counts, counts.shared_wins, resamples, seed)
    first, second = counts.methods.index(ours), counts.methods.index(theirs)
    gaps = resampled[:, first] - resampled[:, second]
    return two_sided_p(gaps[~np.isnan(gaps)], counts.samples_of_both(first, second))


def fits(
    counts: PairCounts, wins: NDArray[np.float64], resamples: int, seed: int
) -> tuple[StrengthFit, NDArray[np.float64]]:
    """Strengths from all samples, and those of each resample, shape (resamples, m); wins by sample, (k, m, m).

    A method that was not drawn is nan. The others then have the mean that they have with all samples: with mean 0 among
    themselves they would all move because one is missing."""
    fit, found = fit_strengths(wins.sum(axis=0)[None]), []
    for weights in draws(len(wins), resamples, seed):
        theta = fit_strengths((weights @ wins.reshape(len(wins), -1)).reshape(-1, *wins.shape[1:])).theta
        drawn = weights @ counts.met > 0
        shift = np.mean(np.broadcast_to(fit.theta, theta.shape) - theta, axis=1, keepdims=True, where=drawn)
        found.append(np.where(drawn, theta + shift, np.nan))
    return fit, np.concatenate(found)


def rated(
    counts: PairCounts,
    ratings: NDArray[np.float64],
    resampled: NDArray[np.float64],
    errors: NDArray[np.float64] | None,
    separable: bool,
) -> list[MethodRating]:
    """One row per method."""
    return [
        MethodRating(
            method,
            float(ratings[0, k]),
            interval_of(resampled[:, k][~np.isnan(resampled[:, k])]),
            None if errors is None else float(errors[k]),
            separable,
        )
        for k, method in enumerate(counts.methods)
    ]
