"""Ratings from comparisons: Elo and Bradley-Terry by maximum likelihood, with intervals.

Elo follows the recipe of GPTEval3D [W24]: a tie counts as a win of *both*, one method is the anchor with a fixed
rating, and sum A_ij log(1 + 10^((R_j - R_i) / 400)) is smallest. Its published code runs 10,000 steps of Adam; the
problem is convex, so here Newton's method solves it to convergence. Bradley-Terry counts half of a tie for each and has
the mean rating fixed. Both are on the scale on which 400 points are odds of 10 to 1.

Intervals resample whole samples (cluster bootstrap), since comparisons on one sample are not independent. A resample
in which a method was not drawn has no information on it, and does not count for it: the ridge would put it at the mean.

Source: [W24] Wu et al., GPT-4V(ision) is a Human-Aligned Evaluator for Text-to-3D Generation, CVPR 2024.

Maximum likelihood of strengths from paired wins, for many tables of wins at once.

The model is that of [B52]: i is preferred to j with probability 1 / (1 + exp(theta_j - theta_i)). With weights A_ij
(wins of i over j) the negative log-likelihood sum A_ij log(1 + exp(theta_j - theta_i)) is convex; it has a finite
minimum, unique up to a shift, if and only if every method can be reached from every other along wins [F57]. Where it
has none (somebody won, or lost, everything) a ridge keeps it finite: 0.5 RIDGE sum theta^2, a normal prior on
strengths, and the table is marked as separable. Newton's steps with halving, to a gradient of 1e-10 per comparison.

Sources: [B52] Bradley and Terry, Biometrika 39, 1952, 324-345; [F57] Ford, American Mathematical Monthly 64, 1957,
28-33; [H04] Hunter, Annals of Statistics 32, 2004, 384-406 (section 2).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.statistics.bootstrap import RESAMPLES, SEED, ConfidenceInterval, draws, interval_of, two_sided_p
from dcap.evaluation.statistics.comparisons import PairCounts
from dcap.scene.errors import InputError

RIDGE = 0.1
"""Precision of the prior on a strength in log-odds: a deviation of 3.2, odds of 24 to 1 or 550 Elo points."""
ITERATIONS = 100
TOLERANCE = 1e-10
"""Largest component of the gradient over the number of comparisons."""
HALVINGS = 30

Batch = NDArray[np.float64]
POINTS = 400.0 / np.log(10.0)
"""Elo points of one unit of log-odds."""
ANCHOR_RATING = 1000.0
"""Rating of the anchor, as in [W24]."""
MEAN_RATING = 1500.0
"""Mean of Bradley-Terry ratings."""


@dataclass(frozen=True, eq=False, slots=True)
class StrengthFit:
    """Strengths of m methods for b tables of wins."""

    theta: Batch
    """Log-odds, mean 0 in every table, shape (b, m)."""
    separable: NDArray[np.bool_]
    """Whether the likelihood has no finite maximum, so that the ridge decided; shape (b,)."""


def fit_strengths(wins: Batch, ridge: float = RIDGE) -> StrengthFit:
    """Strengths by maximum likelihood; wins has shape (b, m, m), not negative; its diagonal is ignored."""
    counts = wins * (1.0 - np.eye(wins.shape[1]))
    separable = ~strongly_connected(counts)
    penalty = np.where(separable, ridge, 0.0)
    total = np.maximum(counts.sum(axis=(1, 2)), 1.0)
    theta = np.zeros(counts.shape[:2])
    active = np.arange(len(counts))
    for _ in range(ITERATIONS):
        slope, curvature = derivatives(theta[active], counts[active], penalty[active])
        moving = np.abs(slope).max(axis=1) > TOLERANCE * total[active]
        active, slope, curvature = active[moving], slope[moving], curvature[moving]
        if len(active) == 0:
            break
        step = -np.einsum("bij,bj->bi", inverse_on_differences(curvature), slope)
        theta[active] = descended(theta[active], step, counts[active], penalty[active])
    else:
        raise ArithmeticError(f"strengths of {len(active)} tables did not converge within {ITERATIONS} Newton steps")
    return StrengthFit(theta, separable)


def descended(theta: Batch, step: Batch, counts: Batch, penalty: Batch) -> Batch:
    """Newton's step, halved where it does not reduce the cost beyond rounding; shape (b, m)."""
    before = cost(theta, counts, penalty)
    slack = 1e-12 * (1.0 + np.abs(before))
    scale = np.ones(len(theta))
    for _ in range(HALVINGS):
        worse = cost(theta + scale[:, None] * step, counts, penalty) > before + slack
        if not worse.any():
            break
        scale[worse] *= 0.5
    moved = theta + scale[:, None] * step
    return np.asarray(moved - moved.mean(axis=1, keepdims=True))


def cost(theta: Batch, counts: Batch, penalty: Batch) -> Batch:
    """Penalised negative log-likelihood, shape (b,)."""
    behind = theta[:, None, :] - theta[:, :, None]  # theta_j - theta_i
    return np.asarray((counts * np.logaddexp(0.0, behind)).sum(axis=(1, 2)) + 0.5 * penalty * (theta**2).sum(axis=1))


def derivatives(theta: Batch, counts: Batch, penalty: Batch) -> tuple[Batch, Batch]:
    """Gradient, shape (b, m), and Hessian, shape (b, m, m), of the cost."""
    behind = theta[:, None, :] - theta[:, :, None]
    lost = 1.0 / (1.0 + np.exp(-behind))  # probability that j is preferred to i
    pull = counts * lost
    slope = pull.sum(axis=1) - pull.sum(axis=2) + penalty[:, None] * theta
    met = (counts + counts.transpose(0, 2, 1)) * lost * (1.0 - lost)
    eye = np.eye(theta.shape[1])
    curvature = eye * met.sum(axis=2)[:, None, :] - met + eye * penalty[:, None, None]
    return slope, curvature


def inverse_on_differences(curvature: Batch) -> Batch:
    """Inverse on the strengths whose sum is 0, shape (b, m, m): a common shift costs nothing and is left out."""
    m = curvature.shape[1]
    center = np.eye(m) - 1.0 / m
    scale = np.maximum(np.trace(curvature, axis1=1, axis2=2) / m, np.finfo(float).tiny)[:, None, None]
    return np.asarray(center @ np.linalg.inv(center @ curvature @ center + scale / m) @ center)


def strongly_connected(counts: Batch) -> NDArray[np.bool_]:
    """Whether every method reaches every other along wins, shape (b,)."""
    reach = ((counts > 0) | np.eye(counts.shape[1], dtype=bool)).astype(float)
    for _ in range(max(1, int(np.ceil(np.log2(max(2, counts.shape[1])))))):
        reach = ((reach @ reach) > 0).astype(float)  # paths of twice the length
    return np.asarray(reach.all(axis=(1, 2)))


@dataclass(frozen=True, slots=True)
class MethodRating:
    """One method's rating."""

    method: str
    rating: float
    """[Elo points]."""
    interval: ConfidenceInterval
    """95 %, cluster bootstrap over samples."""
    separable: bool
    """Whether some method won, or lost, everything against the rest, so that a ridge keeps ratings finite."""


def elo_ratings(
    counts: PairCounts, anchor: str, rating: float = ANCHOR_RATING, resamples: int = RESAMPLES, seed: int = SEED
) -> list[MethodRating]:
    """Elo of all methods, in the order of `counts`, with the anchor's rating fixed."""
    if anchor not in counts.methods:
        raise InputError(f"anchor {anchor!r} is not one of {', '.join(counts.methods)}")
    column = counts.methods.index(anchor)
    fit, resampled = fits(counts, counts.wins + counts.ties, resamples, seed)
    own, others = (rating + POINTS * (theta - theta[:, [column]]) for theta in (fit.theta, resampled))
    return rated(counts, own[0], others, bool(fit.separable[0]))


def bradley_terry(
    counts: PairCounts, mean: float = MEAN_RATING, resamples: int = RESAMPLES, seed: int = SEED
) -> list[MethodRating]:
    """Bradley-Terry ratings of all methods, in the order of `counts`, with this mean."""
    fit, resampled = fits(counts, counts.shared_wins, resamples, seed)
    return rated(counts, mean + POINTS * fit.theta[0], mean + POINTS * resampled, bool(fit.separable[0]))


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


def rated(counts: PairCounts, ratings: Batch, resampled: Batch, separable: bool) -> list[MethodRating]:
    """One row per method."""
    return [
        MethodRating(method, float(own), interval_of(others[~np.isnan(others)]), separable)
        for method, own, others in zip(counts.methods, ratings, resampled.T, strict=True)
    ]
