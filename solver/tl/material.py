"""Displacement and stress of the material at a state, point by point.

What layers add to the isotropic stress is taken linearly, in the frame that the material has turned to:
R (C_added : (S - I)) R^T / J.
"""

import numpy as np
from numpy.typing import NDArray

from solver.model.layers import stiffness
from solver.model.soft import SoftSystem, shape_values
from solver.model.state import State
from solver.model.stress import corotated_stress, voigt
from solver.motion import MaterialState
from solver.tl.accuracy import strains

Array = NDArray[np.float64]


def material_states(soft: SoftSystem, state: State) -> dict[int, MaterialState]:
    """Every soft body's material by the body's index in the model; fictitious particles are left out."""
    if not len(soft.volume):
        return {}
    F, R, J = strains(soft, state)
    sigma = cauchy_stress(soft, F, R, J)
    nodes = np.repeat(soft.cell_node, np.diff(soft.cell_start), axis=0)
    weights = shape_values(soft.local)
    start = np.einsum("pk,pki->pi", weights, soft.rest[nodes])
    moved = np.einsum("pk,pki->pi", weights, (state.x - soft.rest)[nodes])
    found = {}
    for body in soft.bodies:
        mine = np.arange(len(soft.volume))[body.particles]
        mine = mine[soft.real[mine]]
        found[body.index] = MaterialState(start[mine], moved[mine], soft.volume[mine], J[mine], sigma[mine])
    return found


def cauchy_stress(soft: SoftSystem, F: Array, R: Array, J: Array) -> Array:
    """Stress of every particle at deformations F with rotations R (p, 3, 3) and volume ratios J (p,) [Pa], (p, 6)."""
    whole = corotated_stress(F, R, J, soft.mu, soft.lam)
    own = np.flatnonzero(soft.added.any(axis=1))
    if len(own):
        none = np.zeros(len(own))
        tensor = stiffness(none, none, soft.added[own], soft.frame[own].reshape(-1, 3, 3))
        stretch = np.einsum("pji,pjk->pik", R[own], F[own])
        strain = 0.5 * (stretch + stretch.transpose(0, 2, 1)) - np.eye(3)
        local = np.einsum("pijkl,pkl->pij", tensor, strain, optimize=True)
        whole[own] += np.einsum("pij,pjk,plk->pil", R[own], local, R[own], optimize=True) / J[own, None, None]
    return voigt(whole)
