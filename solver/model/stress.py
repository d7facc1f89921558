"""Cauchy stress of the fixed-corotated energy [S12], sigma = P F^T / J:

    sigma = 2 mu / J (F - R) F^T + lambda (J - 1) I

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.
"""

import numpy as np

from solver.arrays import Array

VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
"""Components of a symmetric tensor in their order."""


def corotated_stress(F: Array, R: Array, J: Array, mu: Array, lam: Array) -> Array:
    """Stress at deformations F with rotations R (p, 3, 3) and volume ratios J (p,) of materials with Lame parameters
    mu and lam (p,) [Pa], shape (p, 3, 3)."""
    whole = 2.0 * (mu / J)[:, None, None] * np.einsum("pij,pkj->pik", F - R, F)
    return np.asarray(whole + (lam * (J - 1.0))[:, None, None] * np.eye(3))


def voigt(tensor: Array) -> Array:
    """Symmetric tensors (p, 3, 3) as xx, yy, zz, yz, xz, xy, shape (p, 6)."""
    return np.stack([tensor[:, i, j] for i, j in VOIGT], axis=1)


def rotations(F: Array) -> Array:
    """The rotation R of F = R S, S symmetric, det R = 1, shape (p, 3, 3)."""
    left, _, right = np.linalg.svd(F)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    return np.asarray(left @ right)
