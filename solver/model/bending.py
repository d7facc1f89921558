"""Gives a bent trilinear cell the stiffness of the plate that it represents.

Bent along i with its deflection along j, a trilinear cell cannot curve: in addition to the normal strain, linear in
xi_j, it has a shear strain linear in xi_i that a plate does not have; with the mean dilatation its normal part has the
modulus 2 mu and no lateral strain; and the particles, at the middles of the octants, miss a quarter of the second
moments. Let q_ij = f_i . a_ij be the amplitude of that mode, f_i the mean deformation gradient along i and a_ij the
coefficient of xi_i xi_j in x, and e_ij = (2 / h_i) q_ij its strain. With m_j = sum_p V_p mu_p (xi_j - mean)^2 and n_j =
m_j + sum_p V_p mu_p / 12 (1/12: an octant's own second moment) a deflection along j, the other axes being i and k, has
the energies

    cell:  m_j (e_ij^2 + e_kj^2) + 1/2 (2 / h_j)^2 (m_i q_ij^2 + m_k q_kj^2)
    plate: n_j / (1 - nu) (e_ij^2 + e_kj^2 + 2 nu e_ij e_kj)

The difference is an energy of the cell's modes, E_relief = -1/2 sum c_ij q_ij^2 - sum_j d_j q_ij q_kj:

    c_ij = (2 / h_j)^2 m_i + 2 (2 / h_i)^2 (m_j - n_j / (1 - nu)) ,   d_j = -2 nu / (1 - nu) (2 / h_i) (2 / h_k) n_j

This is assumed-strain stabilisation for bending [BB93], for any nu and aspect ratio. It is a polynomial of the node
positions, so its forces are exact and turn with the cell.

With layers the same three moduli are those of the elasticity tensor C in the cell's axes: G = C_ijij for the shear; D =
C - lambda (mean dilatation) for the normal part, coupled between e_ij and e_kj where D_iikk is not zero; and Q, the
stiffness under plane stress (no stress on the faces normal to j), for the plate:

    c_ij = (2 / h_j)^2 G_ij v_i + (2 / h_i)^2 (D_ii v_j - Q_ii n'_j)
    d_j = (2 / h_i) (2 / h_k) (D_ik v_j - Q_ik n'_j)

with v_j = sum_p V_p (xi_j - mean)^2 and n'_j = v_j + sum_p V_p / 12. Layers oblique to the cell couple the modes with
each other, which is neglected here; where the relief would be too large, solver/tl/ghost.py reduces it.

Only cells full of one material take part. In a cut cell the same modes are not bending alone: the nodes on its empty
side are held by the shear that would be removed.

[BB93] Belytschko, Bindeman: Assumed strain stabilization of the eight node hexahedral element. CMAME 105, 1993.
"""

import numpy as np
from numpy.typing import NDArray

from solver.model.layers import stiffness

EVEN = 0.01  # of half a cell: tolerance of the particles' mean and second moments for a full, uniform cell
MODES = ((1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2))
"""(i, j) of the columns of c: bent along i, deflected along j; columns 2 j and 2 j + 1 are coupled by d_j."""


def bending_relief(
    cell_size: NDArray[np.float64],
    cell_start: NDArray[np.int32],
    local: NDArray[np.float64],
    volume: NDArray[np.float64],
    mu: NDArray[np.float64],
    lam: NDArray[np.float64],
) -> NDArray[np.float64]:
    """c_ij in the order of MODES, then d_j [N/m], per cell, shape (c, 9).

    cell_size (c, 3) [m], cell_start (c + 1,), particles in their cell (p, 3) in 0..1, V [m^3], mu and lambda [Pa] (p,).
    """
    cells = len(cell_size)
    if not cells:
        return np.zeros((0, 9))
    cell = np.repeat(np.arange(cells), np.diff(cell_start))
    weight = volume * mu
    xi = 2.0 * local - 1.0

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(cell, weights=values, minlength=cells).astype(np.float64)

    shear = total(weight)
    mean = np.stack([total(weight * xi[:, a]) / shear for a in range(3)])
    moment = np.stack([total(weight * (xi[:, a] - mean[a, cell]) ** 2) for a in range(3)])
    full = np.all(np.abs(np.concatenate([mean, moment / shear - 0.25])) < EVEN, axis=0)
    ratio = total(volume * lam) / shear
    poisson = ratio / (2.0 * (1.0 + ratio))
    slope = [2.0 / cell_size[:, a] for a in range(3)]
    plate = [(moment[a] + shear / 12.0) / (1.0 - poisson) for a in range(3)]
    out = np.zeros((cells, 9))
    for column, (i, j) in enumerate(MODES):
        out[:, column] = slope[j] ** 2 * moment[i] + 2.0 * slope[i] ** 2 * (moment[j] - plate[j])
    for j in range(3):
        (i, _), (k, _) = MODES[2 * j], MODES[2 * j + 1]
        out[:, 6 + j] = -2.0 * poisson * plate[j] * slope[i] * slope[k]
    return np.where(full[:, None], out, 0.0)


def layered_relief(
    cells: NDArray[np.int32],
    cell_size: NDArray[np.float64],
    cell_start: NDArray[np.int32],
    local: NDArray[np.float64],
    volume: NDArray[np.float64],
    mu: NDArray[np.float64],
    lam: NDArray[np.float64],
    added: NDArray[np.float64],
    frame: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The same nine columns for the listed cells (k,), whose material has layers (solver/model/layers.py); arguments as
    above, `added` (p, 5) [Pa], `frame` (p, 9). Shape (k, 9)."""
    number = np.full(len(cell_size), -1)
    number[cells] = np.arange(len(cells))
    owner = np.repeat(number, np.diff(cell_start))
    point = np.flatnonzero(owner >= 0)
    owner, xi, V = owner[point], 2.0 * local[point] - 1.0, volume[point]

    def total(values: NDArray[np.float64]) -> NDArray[np.float64]:
        flat = values.reshape(len(values), -1)
        sums = [np.bincount(owner, weights=column, minlength=len(cells)) for column in flat.T]
        return np.stack(sums, axis=-1).astype(np.float64).reshape(len(cells), *values.shape[1:])

    filled = total(V)
    mean = total(V[:, None] * xi) / filled[:, None]
    moment = total(V[:, None] * (xi - mean[owner]) ** 2)
    even = np.abs(np.concatenate([mean, moment / filled[:, None] - 0.25], axis=1)).max(axis=1) < EVEN
    tensor = stiffness(mu[point], lam[point], added[point], frame[point].reshape(-1, 3, 3))
    C = total(V[:, None, None, None, None] * tensor) / filled[:, None, None, None, None]
    dilation = total(V * lam[point]) / filled
    plate = moment + filled[:, None] / 12.0
    slope = 2.0 / cell_size[cells]
    out = np.zeros((len(cells), 9))
    for column, (i, j) in enumerate(MODES):
        k = 3 - i - j
        own = (C[:, i, i, i, i] - dilation) * moment[:, j] - plane_stress(C, i, k, j)[:, 0, 0] * plate[:, j]
        out[:, column] = slope[:, j] ** 2 * C[:, i, j, i, j] * moment[:, i] + slope[:, i] ** 2 * own
    for j in range(3):
        (i, _), (k, _) = MODES[2 * j], MODES[2 * j + 1]
        both = (C[:, i, i, k, k] - dilation) * moment[:, j] - plane_stress(C, i, k, j)[:, 0, 1] * plate[:, j]
        out[:, 6 + j] = slope[:, i] * slope[:, k] * both
    return np.where(even[:, None], out, 0.0)


def plane_stress(C: NDArray[np.float64], i: int, k: int, j: int) -> NDArray[np.float64]:
    """Stiffness (n, 2, 2) [Pa] on (e_ii, e_kk) of tensors (n, 3, 3, 3, 3) without stress on faces normal to j."""
    free = [(j, j), (i, j), (k, j)]
    kept = [(i, i), (k, k)]

    def block(rows: list[tuple[int, int]], columns: list[tuple[int, int]]) -> NDArray[np.float64]:
        return np.stack([np.stack([C[:, a, b, c, d] for c, d in columns], axis=-1) for a, b in rows], axis=-2)

    return np.asarray(block(kept, kept) - block(kept, free) @ np.linalg.solve(block(free, free), block(free, kept)))
