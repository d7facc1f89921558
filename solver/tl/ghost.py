"""Ghost penalty against folding of cells with a sliver of material, and relief of bending.

Where the cells around a node contain hardly any material below the surface, contact loads that node and hardly any
stiffness holds it. Each such node n is tied to the two nodes behind it, n' and n'', on the grid line that leads deepest
into the material. The energy of a tie is that of the jump at n' of the derivative of the displacement u along the line,
over the area A that the line represents [B10, B15]:

    E = gamma mu h A / 2 |[d u]|^2 ,   [d u] = (u_n - u_n') / a - (u_n' - u_n'') / b

with a and b the distances between the nodes, h their mean and mu the smaller shear modulus of the material around n and
n'; for layers, E_t / (2 (1 + nu_tp)): contact presses them together, and as they slip easily, G_t is far too soft to
keep a sliver from folding. The energy vanishes for every affine motion and does not change when a body turns. It is
therefore a constant matrix G on node positions: its forces -G x have no resultant and no moment, and its tangent is G.

A tie reaches over two cells, beyond the 27-point stencil of the elastic tangent, so G is kept apart from it.

[B10] Burman: Ghost penalty. Comptes Rendus Mathematique 348, 2010.
[B15] Burman, Claus, Hansbo, Larson, Massing: CutFEM: discretizing geometry and partial differential equations. Int. J.
Numer. Meth. Engng. 104, 2015.

Reduction of the relief of bending in cells of layers, so that they keep their stiffness.

The relief (solver/model/bending.py) is derived for one mode at a time and for layers along the cell. If they lie
obliquely or turn within the cell, modes couple, and the full relief would leave a mode with zero or negative energy:
such a cell buckles without load. So each cell applies the share of the relief that keeps LEFT of the energy of every
mode.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.arrays import Array
from solver.kernels import layers, tangents
from solver.model.layers import shear_modulus_across
from solver.model.soft import SoftSystem

# [cells] material around a node below which it is tied: a node at the corner of a full cell is left alone, and so is a
# node under a flat face with an eighth of its cells filled
WEAK = 0.5
# [-] gamma of a node without material, decreasing linearly with more material, so that depth is continuous in the
# position of the surface; a tenth does not keep slivers from folding, a half reduces the depth of a dent twice as much
GAMMA = 0.2
ALONG = (4, 10, 12, 14, 16, 22)  # slots of the 27-point stencil on the grid lines through a node
LEFT = 0.2  # of the energy of any motion at rest [-]: half of it may again be lost as layers shear
NO_STIFFNESS = 1e-6  # over a cell's largest stiffness: below it are rigid motions and rounding in single precision


def ghost_penalty(soft: SoftSystem) -> sparse.csr_matrix:
    """G [N/m], for each coordinate of the node positions: symmetric and never negative, shape (n, n)."""
    support, modulus = _material_around(soft)
    tie = _ties(soft, support)
    length = np.linalg.norm(np.diff(soft.rest[tie], axis=1), axis=2)
    a, b = length[:, 0], length[:, 1]
    volume, cells = _around(soft, soft.cell_size.prod(axis=1)), _around(soft, np.ones(len(soft.cell_node)))
    area = (volume / cells)[tie[:, 0]] / a
    strength = GAMMA * (1.0 - support[tie[:, 0]] / WEAK) * modulus[tie[:, :2]].min(axis=1) * 0.5 * (a + b) * area
    weight = np.sqrt(strength)[:, None] * np.stack([1.0 / a, -1.0 / a - 1.0 / b, 1.0 / b], axis=1)
    jump = sparse.csr_matrix(
        (weight.ravel(), tie.ravel(), 3 * np.arange(len(tie) + 1)), shape=(len(tie), len(soft.rest))
    )
    return (jump.T @ jump).tocsr()


def _material_around(soft: SoftSystem) -> tuple[Array, Array]:
    """Material in the cells around each node [cells] and its mean modulus [Pa], shape (n,) both."""
    cell = np.repeat(np.arange(len(soft.cell_node)), np.diff(soft.cell_start))
    volume = np.where(soft.real, soft.volume, 0.0)
    count = len(soft.cell_node)
    modulus = shear_modulus_across(soft.mu, soft.lam, soft.added)
    filled, stiff = (np.bincount(cell, one, count).astype(np.float64) for one in (volume, volume * modulus))
    support = _around(soft, filled / soft.cell_size.prod(axis=1))
    return support, _around(soft, stiff) / np.maximum(_around(soft, filled), 1e-300)


def _around(soft: SoftSystem, values: Array) -> Array:
    """Sum of the cells' values (c,) around each node, shape (n,)."""
    found = np.where(soft.node_cell >= 0, np.append(values, 0.0)[soft.node_cell], 0.0)
    return np.asarray(found.sum(axis=1))


def _ties(soft: SoftSystem, support: Array) -> NDArray[np.int32]:
    """Weak nodes with the two nodes behind them, shape (k, 3): on the grid line whose weaker node of the two has the
    most material, if that is more than that of the weak node itself."""
    weak = np.flatnonzero((support > 0.0) & (support < WEAK)).astype(np.int32)
    behind = soft.neighbour[weak][:, ALONG]
    beyond = np.where(behind >= 0, soft.neighbour[behind, ALONG], -1)
    carried = np.where(beyond >= 0, np.minimum(support[behind], support[beyond]), 0.0)
    best = carried.argmax(axis=1)[:, None]
    tie = np.column_stack([weak, np.take_along_axis(behind, best, 1), np.take_along_axis(beyond, best, 1)])
    return tie[np.take_along_axis(carried, best, 1)[:, 0] > support[weak]]


def with_definite_relief(soft: SoftSystem) -> SoftSystem:
    """The same system with reduced relief in the cells of layers that need it."""
    if not len(soft.layered):
        return soft
    whole = rest_stiffness(soft, np.zeros_like(soft.relief))
    taken = whole - rest_stiffness(soft, soft.relief)
    value, vector = np.linalg.eigh(whole)
    root = 1.0 / np.sqrt(np.maximum(value, NO_STIFFNESS * value[:, -1:]))
    seen = root[:, :, None] * (vector.swapaxes(1, 2) @ taken @ vector) * root[:, None, :]
    most = np.linalg.eigvalsh(seen)[:, -1]
    relief = soft.relief.copy()
    relief[soft.layered] *= np.minimum(1.0, (1.0 - LEFT) / np.maximum(most, 1.0 - LEFT))[:, None]
    return replace(soft, relief=relief)


def rest_stiffness(soft: SoftSystem, relief: NDArray[np.float64]) -> NDArray[np.float64]:
    """Stiffness of the cells of layers at rest [N/m], for given reliefs (c, 9), shape (k, 24, 24)."""
    cells = len(soft.cell_node)
    K = np.zeros((cells, 8, 8, 3, 3), dtype=np.float32)
    tangents.rest_tangents(
        soft.cell_size, soft.cell_start, soft.local, soft.volume, soft.mu, soft.lam, relief, np.zeros((cells, 8, 3)), K
    )  # fmt: skip
    undeformed = np.tile(np.eye(3).ravel(), (len(soft.volume), 1))
    layers.add_layer_tangents(
        soft.layered, soft.cell_size, soft.cell_start, soft.local, soft.volume, soft.added, soft.frame, undeformed, K
    )
    rows = K[soft.layered].transpose(0, 1, 3, 2, 4).reshape(-1, 24, 24).astype(np.float64)
    return np.asarray(0.5 * (rows + rows.swapaxes(1, 2)))
