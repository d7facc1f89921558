"""How much of the relief of bending a cell of layers can give away without losing its stiffness.

The relief (solver/model/bending.py) is derived for one mode at a time and for layers along the cell. Where they lie
obliquely or turn within it, modes couple, and the whole of it would leave a mode without energy, or with less than
none: such a cell buckles under nothing. So each cell gives the share that keeps LEFT of the energy of every mode.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.kernels import layers, tangents
from solver.model.soft import SoftSystem

LEFT = 0.2  # of the energy of any motion at rest [-]: half of it may be lost once more as layers shear
NO_STIFFNESS = 1e-6  # over a cell's largest: below it are its rigid motions, and single precision


def with_definite_relief(soft: SoftSystem) -> SoftSystem:
    """The same system, with less relief in those cells of layers that cannot do with it."""
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
    """Stiffness of the cells of layers at rest [N/m], with some relief (c, 9), shape (k, 24, 24)."""
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
