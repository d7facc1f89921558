"""The coarse preconditioner of a step: single-precision forces of a stiff core may not end it."""

import numpy as np
import pytest
from scipy import linalg

from solver.errors import UnstableStep
from solver.tl.coarse import factorised


def stiff_core(error: float) -> np.ndarray:
    """Soft lattice of 12 unknowns around a core 1e9 times as stiff, the two coupled; `error` of the coupling [-]."""
    random = np.random.default_rng(3)
    shape = random.normal(size=(12, 6))
    soft = np.eye(12)
    full = np.block([[soft, soft @ shape], [shape.T @ soft, shape.T @ shape + 1e-6 * np.eye(6)]])
    full[12:, :12] *= 1.0 + error
    return full


def test_what_is_definite_is_solved_exactly():
    full = stiff_core(0.0)
    right = np.arange(18.0)
    assert linalg.cho_solve(factorised(full.copy(), 1), right) == pytest.approx(np.linalg.solve(full, right), rel=1e-6)


def test_a_slightly_negative_motion_is_made_stiffer():
    """A coupling too large by 1e-5 has no Cholesky factor; the one that is found is close to it."""
    full = stiff_core(1e-5)
    with pytest.raises(linalg.LinAlgError):
        linalg.cho_factor(full.T, lower=False)
    factor, _ = factorised(full.copy(), 1)
    lower = np.triu(factor).T
    low, given = lower @ lower.T, np.tril(full) + np.tril(full, -1).T
    assert np.abs(low - given).max() < 2e-2 * np.abs(given).max()


def test_where_stiffer_motions_do_not_help_everything_is_made_stiffer():
    """A coupling too large by 0.7 %: stiffer motions alone do not make up for that; the factor is near all the same."""
    full = stiff_core(7e-3)
    factor, _ = factorised(full.copy(), 1)
    lower = np.triu(factor).T
    low, given = lower @ lower.T, np.tril(full) + np.tril(full, -1).T
    assert np.abs(low - given).max() < 4e-2 * np.abs(given).max()


def test_what_is_no_stiffness_at_all_breaks_the_step():
    """So that a drop is tried again on other cells, and told in a line."""
    with pytest.raises(UnstableStep, match="not positive definite"):
        factorised(-np.eye(18), 1)
