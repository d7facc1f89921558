"""Elastic energy, layers and material damping from their definitions, by singular values: twins of the kernels.

Fixed-corotated elasticity of one deformation gradient, from its definition.

psi(F) = mu |F - R|^2 + lambda / 2 (J - 1)^2 with F = R S the polar decomposition [S12, Eq. 3.2].

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.

Material damping of one cell from its definition: the gradient of the elastic energy of a step's own strain.

Over a step of dt from stretches S0 to S (F = R S) the drag is -dD/dx at the end of the step, with

    D = beta / dt ( sum V mu |S - S0|^2 + K / 2 g^2 + E_relief(q - q0) ) ,  K = sum V lambda ,
    g = sum V lambda (J - J0) / K

which is Rayleigh's dissipation with the elastic energy of strain increments as potential. S is differentiated by
S dS + dS S = d(F^T F), from S^2 = F^T F. The relief of bending is that of solver/model/bending.py [BB93].

[BB93] Belytschko, Bindeman: Assumed strain stabilization of the eight node hexahedral element. CMAME 105, 1993.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from solver.arrays import Array

Matrix = NDArray[np.float64]

CORNERS = np.array(list(product((0.0, 1.0), repeat=3)))  # of a unit cell, local node 4 i + 2 j + k
AMBIGUOUS = 1e-3  # of |S|^3: det(tr(S) I - S) below which the rotation of F is undetermined, so it is kept constant
BENT = ((1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2))  # (i, j): bent along i, deflected along j


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


def layered_energy(F: Matrix, mu: float, lam: float, added: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
    """Energy density [J/m^3] at a deformation gradient (3, 3); `added` holds K_aa, K_aw, K_ww, k_d, k_s [Pa].

    The principal stretches of the layers are the singular values of F on their plane; w is the distance between
    neighbouring layers, 1 / |F^-T n|, and s the part of F n in their plane.
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


@dataclass(frozen=True, eq=False, slots=True)
class Cell:
    """A trilinear cell and the particles in it."""

    size: Array
    """Edge lengths [m], shape (3,)."""
    xi: Array
    """Positions of the particles in the cell, 0..1, shape (p, 3)."""
    volume: Array
    """Volumes V [m^3], shape (p,)."""
    mu: Array
    """Shear moduli [Pa], shape (p,)."""
    lam: Array
    """First Lame parameters [Pa], shape (p,)."""
    relief: Array
    """c_ij in the order of BENT, then d_j [N/m], shape (9,)."""

    def gradients(self, xi: Array) -> Array:
        """Gradients of the eight shape functions at a particle [1/m], shape (8, 3)."""
        factor = np.where(CORNERS == 1.0, xi, 1.0 - xi)
        slope = (2.0 * CORNERS - 1.0) / self.size
        columns = [slope[:, d] * np.delete(factor, d, axis=1).prod(axis=1) for d in range(3)]
        return np.stack(columns, axis=1)


def stretch(F: Array) -> Array:
    """S of F = R S with det R = 1, shape (3, 3)."""
    return np.asarray(polar_rotation(F).T @ F)


def amplitudes(x: Array, size: Array) -> Array:
    """Bending amplitudes q_ij = f_i . a_ij of a cell with its nodes at x (8, 3), shape (6,)."""
    side = 2.0 * CORNERS - 1.0
    slope = [side[:, i] @ x / (4.0 * size[i]) for i in range(3)]
    return np.array([slope[i] @ ((side[:, i] * side[:, j]) @ x) / 8.0 for i, j in BENT])


def potential(cell: Cell, x0: Array, x1: Array) -> float:
    """D dt / beta [J] of a step in which the nodes go from x0 to x1 (8, 3)."""
    shear = growth = 0.0
    for xi, V, mu, lam in zip(cell.xi, cell.volume, cell.mu, cell.lam, strict=True):
        F0, F1 = (x.T @ cell.gradients(xi) for x in (x0, x1))
        shear += V * mu * ((stretch(F1) - stretch(F0)) ** 2).sum()
        growth += V * lam * (np.linalg.det(F1) - np.linalg.det(F0))
    bulk = float(cell.volume @ cell.lam)
    q = amplitudes(x1, cell.size) - amplitudes(x0, cell.size)
    relief = -0.5 * cell.relief[:6] @ q**2 - cell.relief[6:] @ (q[0::2] * q[1::2])
    return float(shear + (0.5 * growth**2 / bulk if bulk > 0.0 else 0.0) + relief)


def drag(rate: float, cell: Cell, x0: Array, x1: Array) -> Array:
    """Drag [N] on the nodes (8, 3) at the end of a step from x0 to x1; rate is beta / dt."""
    slope = np.zeros((8, 3))
    bulk, growth = float(cell.volume @ cell.lam), 0.0
    change = np.zeros((8, 3))  # of sum V lambda J
    for xi, V, mu, lam in zip(cell.xi, cell.volume, cell.mu, cell.lam, strict=True):
        g = cell.gradients(xi)
        F0, F1 = x0.T @ g, x1.T @ g
        growth += V * lam * (np.linalg.det(F1) - np.linalg.det(F0))
        S, S0 = stretch(F1), stretch(F0)
        for node, axis in product(range(8), range(3)):
            dF = np.outer(np.eye(3)[axis], g[node])
            slope[node, axis] += 2.0 * V * mu * ((S - S0) * stretch_slope(F1, dF)).sum()
            change[node, axis] += V * lam * np.linalg.det(F1) * np.trace(np.linalg.solve(F1, dF))
    if bulk > 0.0:
        slope += growth / bulk * change
    return np.asarray(-rate * (slope + relief_slope(cell, x0, x1)))


def stretch_slope(F: Array, dF: Array) -> Array:
    """dS for a change dF of F: the solution of S dS + dS S = dF^T F + F^T dF, shape (3, 3)."""
    size, axes = np.linalg.eigh(stretch(F))
    if np.prod(size.sum() - size) <= AMBIGUOUS * np.linalg.norm(size) ** 3:  # of an inverted particle
        held = polar_rotation(F).T @ dF
        return np.asarray(0.5 * (held + held.T))
    right = axes.T @ (dF.T @ F + F.T @ dF) @ axes
    return np.asarray(axes @ (right / (size[:, None] + size)) @ axes.T)


def relief_slope(cell: Cell, x0: Array, x1: Array) -> Array:
    """dE_relief / dx [N], shape (8, 3)."""
    side, out = 2.0 * CORNERS - 1.0, np.zeros((8, 3))
    q = amplitudes(x1, cell.size) - amplitudes(x0, cell.size)
    for m, (i, j) in enumerate(BENT):
        twist = side[:, i] * side[:, j]
        f, a = side[:, i] @ x1 / (4.0 * cell.size[i]), twist @ x1 / 8.0
        dq = np.outer(side[:, i], a) / (4.0 * cell.size[i]) + np.outer(twist, f) / 8.0
        out -= (cell.relief[m] * q[m] + cell.relief[6 + m // 2] * q[m ^ 1]) * dq
    return out
