"""Maximum likelihood of strengths from paired wins, for many tables of wins at once.

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

RIDGE = 0.1
"""Precision of the prior on a strength in log-odds: a deviation of 3.2, odds of 24 to 1 or 550 Elo points."""
ITERATIONS = 100
TOLERANCE = 1e-10
"""Largest component of the gradient over the number of comparisons."""
HALVINGS = 30

Batch = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class StrengthFit:
    """Strengths of m methods for b tables of wins."""

    theta: Batch
    """Log-odds, mean 0 in every table, shape (b, m)."""
    separable: NDArray[np.bool_]
    """Whether the likelihood has no finite maximum, so that the ridge decided; shape (b,)."""
    precision: Batch
    """Hessian of the negative log-likelihood, with the ridge where it was used, shape (b, m, m)."""

    def standard_errors(self) -> Batch:
        """Standard errors of theta with mean 0, from the inverse Hessian, shape (b, m); each comparison counts as
        independent."""
        return np.asarray(np.sqrt(np.diagonal(inverse_on_differences(self.precision), axis1=1, axis2=2)))


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
    return StrengthFit(theta, separable, derivatives(theta, counts, penalty)[1])


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
