"""Fixed-corotated elasticity of one deformation gradient, from its definition.

psi(F) = mu |F - R|^2 + lambda / 2 (J - 1)^2 with F = R S the polar decomposition [S12, Eq. 3.2].

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.
"""

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def polar_rotation(F: Matrix) -> Matrix:
    """Rotation nearest to F (3, 3), det +1, by singular value decomposition."""
    u, _, vt = np.linalg.svd(F)
    flip = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    return np.asarray(u @ flip @ vt)


def energy(F: Matrix, mu: float, lam: float) -> float:
    """Energy density psi [J/m^3]."""
    distance = F - polar_rotation(F)
    return float(mu * (distance**2).sum() + 0.5 * lam * (np.linalg.det(F) - 1.0) ** 2)


def stress(F: Matrix, mu: float, lam: float) -> Matrix:
    """First Piola-Kirchhoff stress P = 2 mu (F - R) + lambda (J - 1) J F^-T [Pa], shape (3, 3)."""
    J = np.linalg.det(F)
    return np.asarray(2.0 * mu * (F - polar_rotation(F)) + lam * (J - 1.0) * J * np.linalg.inv(F).T)
