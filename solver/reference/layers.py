"""Energy of layers from its definition, by singular values: solver/model/layers.py without the kernels' shortcuts."""

import numpy as np
from numpy.typing import NDArray

from solver.reference.elastic import energy

Matrix = NDArray[np.float64]


def layered_energy(F: Matrix, mu: float, lam: float, added: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
    """Energy density [J/m^3] at a deformation gradient (3, 3); `added` holds K_aa, K_aw, K_ww, k_d, k_s [Pa].

    The principal stretches of the layers are the singular values of F on their plane; w is the distance of neighbouring
    layers, 1 / |F^-T n|, and s what of F n lies in them.
    """
    plane = np.linalg.svd(normal[None])[2][1:].T
    first, second = np.linalg.svd(F @ plane)[1]
    across = np.linalg.inv(F).T @ normal
    thickness = 1.0 / np.linalg.norm(across)
    slip = F @ normal - thickness**2 * across
    a, w, d = first + second - 2.0, thickness - 1.0, first - second
    in_plane = added[0] * a**2 + 2.0 * added[1] * a * w + added[2] * w**2
    return energy(F, mu, lam) + float(0.5 * (in_plane + added[3] * d**2 + added[4] * slip @ slip))


def transverse_stiffness(across: float, poisson: float, along: float, in_plane: float, shear: float) -> Matrix:
    """Stiffness (6, 6) [Pa] on (e_11, e_22, e_33, 2 e_23, 2 e_13, 2 e_12), layers normal to axis 3, as the inverse of
    the compliance of E_t, nu_tp, E_p, nu_p, G_t."""
    c = poisson / across
    compliance = np.zeros((6, 6))
    compliance[:3, :3] = [[1 / along, -in_plane / along, -c], [-in_plane / along, 1 / along, -c], [-c, -c, 1 / across]]
    compliance[3, 3] = compliance[4, 4] = 1.0 / shear
    compliance[5, 5] = 2.0 * (1.0 + in_plane) / along
    return np.asarray(np.linalg.inv(compliance))
