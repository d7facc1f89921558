"""Measurements of a state: after each step, of the material, and of the depth that the grid takes away.

Estimate of the missing depth of bodies caused by the stiffness of the grid, from the jumps of strain between cells.

A field of nodal averages of the cells' strains is closer to the true one than the cells' own strains; the energy of the
difference estimates that of the discretisation error e [Z87]. Equilibrium minimises the potential, so a grid that
restrains the displacement leaves too much of it: Pi_h - Pi = |e|^2 / 2 in the energy norm [B96, Sec. 4.3.4]. With the
depth d under a load F that gives dPi / dF = -d, thus for d ~ F^n, and likewise for the error,

    d - d_h = (1 + n) / 2 |e|^2 / F ,   n between 2/3 (a sphere) and 1 (a layer, a flat punch).

[B96] Bathe: Finite Element Procedures, Prentice Hall 1996.
[Z87] Zienkiewicz, Zhu: A simple error estimator and adaptive procedure for practical engineering analysis. Int. J.
Numer. Methods Eng. 24, 1987.

Displacement and stress of the material in a state, point by point.

The stress that layers add to the isotropic stress is linear, in the rotated frame of the material: R (C_added : (S -
I)) R^T / J.
"""

import numpy as np
from numpy.typing import NDArray

from solver.arrays import Array
from solver.box import bounds
from solver.certificate import RollingRow
from solver.contact.active import Contacts
from solver.contact.query import ContactQuery
from solver.kernels import elastic
from solver.kernels.query import largest_particle_speed
from solver.model.bodies import Model, free_motions
from solver.model.layers import stiffness
from solver.model.soft import SoftSystem, shape_values
from solver.model.state import State
from solver.model.stress import corotated_stress, voigt
from solver.motion import MaterialState
from solver.rest import Signals
from solver.tl.step import StepReport, carried_weights

LOAD_EXPONENT = 1.0  # n: the value that gives the larger error
COMPONENTS = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
SAME_MATERIAL = 1.05  # shear moduli within this factor share averages: strain jumps where the material changes


def measure(
    model: Model,
    soft: SoftSystem,
    query: ContactQuery,
    watched: list[int],
    mass: dict[int, float],
    weights: NDArray[np.float64],
    state: State,
    report: StepReport,
) -> Signals:
    """All signals of one accepted step; `watched` are the free bodies, or the soft ones if nothing is free."""
    gravity = model.gravity
    soft_of = query.soft_of
    linear = angular = force_worst = torque_worst = 0.0
    scale = carried_weights(weights, report.contacts)
    centers, surfaces = [], []
    for i in watched:
        if i in soft_of:
            nodes = soft_of[i].nodes
            m = soft.mass[nodes]
            center, velocity = m @ state.x[nodes] / m.sum(), m @ state.v[nodes] / m.sum()
        else:
            center, velocity = state.center[i], state.velocity[i]
            angular = max(angular, float(np.linalg.norm(state.angular_velocity[i])))
        linear = max(linear, float(np.linalg.norm(velocity)))
        centers.append(mass[i] * center)
        surfaces.append(query.surface(state, i))
        if model.bodies[i].fixed:
            continue
        force, torque = total_wrench(report.contacts, i, center)
        movable = free_motions(model.bodies[i])  # held degrees of freedom are in balance with their supports
        force, torque = (force + mass[i] * gravity) * movable[:3], torque * movable[3:]
        force_worst = max(force_worst, float(np.linalg.norm(force)) / scale[i])
        torque_worst = max(torque_worst, float(np.linalg.norm(torque)) / (scale[i] * 0.5 * model.bodies[i].size))
    points = np.concatenate(surfaces) if surfaces else np.zeros((1, 3))
    return Signals(
        state.time,
        linear,
        angular,
        particle_speed(soft, state),
        np.sum(centers, axis=0) / sum(mass.values()) if centers else np.zeros(3),
        np.concatenate(bounds(points)),
        force_worst,
        torque_worst,
        report.newton,
        report.linear,
    )


def particle_speed(soft: SoftSystem, state: State) -> float:
    """Largest speed of a material particle [m/s], 0 without soft bodies."""
    if not len(soft.cell_node):
        return 0.0
    real = soft.real.astype(np.int32)
    return float(largest_particle_speed(soft.cell_node, soft.cell_start, soft.local, real, state.v))


def total_wrench(
    contacts: Contacts, index: int, center: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sum of the contact forces [N] and torques about `center` [N m] on a body."""
    force, torque = np.zeros(3), np.zeros(3)
    for which, sign in ((contacts.a, 1.0), (contacts.b, -1.0)):
        points = which == index
        f = sign * contacts.force[points]
        force += f.sum(axis=0)
        torque += np.cross(contacts.position[points] - center, f).sum(axis=0)
    for r in contacts.rolling:
        torque += r.torque if r.a == index else (-r.torque if r.b == index else 0.0)
    return force, torque


def rolling_table(model: Model, contacts: Contacts) -> tuple[RollingRow, ...]:
    """One row per pair of bodies with rolling resistance."""
    rows = []
    for r in contacts.rolling:
        a, b = model.bodies[r.a], model.bodies[r.b]
        rows.append(RollingRow(a.name, b.name, float(np.linalg.norm(r.torque)), r.length))
    return tuple(rows)


def depth_error(soft: SoftSystem, state: State, load: float) -> float:
    """Estimate of the additional depth at which a body that weighs `load` [N] would rest without discretisation error
    [m]."""
    return 0.5 * (1.0 + LOAD_EXPONENT) * float(squared_error(soft, state).sum()) / load


def squared_error(soft: SoftSystem, state: State) -> NDArray[np.float64]:
    """Squared energy norm of the estimated error in each particle's volume [J], shape (p,)."""
    F, R, J = strains(soft, state)
    stretch = np.einsum("pji,pjk->pik", R, F)
    strain = 0.5 * (stretch + stretch.transpose(0, 2, 1)) - np.eye(3)
    cell = np.repeat(np.arange(len(soft.cell_node)), np.diff(soft.cell_start))
    weight = np.where(soft.real, soft.volume, 0.0)
    total = np.maximum(np.bincount(cell, weight, len(soft.cell_node)), 1e-300)
    dilation = np.bincount(cell, weight * (J - 1.0), len(total)) / total
    own = deviator(strain)
    mean = np.stack([np.bincount(cell, weight * own[:, k], len(total)) / total for k in range(6)], axis=1)
    smooth = recovered(soft, cell, weight, np.column_stack([mean, dilation]))
    off = np.column_stack([own, dilation[cell]]) - smooth
    return weight * twice_energy(soft, off)


def twice_energy(soft: SoftSystem, strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """e : C : e of small strains per volume [Pa], given as deviator and mean volume change (p, 7), shape (p,)."""
    shear = (strain[:, :3] ** 2).sum(axis=1) + 2.0 * (strain[:, 3:6] ** 2).sum(axis=1)
    bulk = soft.lam + 2.0 / 3.0 * soft.mu
    out = np.asarray(2.0 * soft.mu * shear + bulk * strain[:, 6] ** 2)
    own = np.flatnonzero(soft.added.any(axis=1))
    if len(own):
        tensor = stiffness(soft.mu[own], soft.lam[own], soft.added[own], soft.frame[own].reshape(-1, 3, 3))
        e = np.zeros((len(own), 3, 3))
        for k, (i, j) in enumerate(COMPONENTS):
            e[:, i, j] = e[:, j, i] = strain[own, k]
        e += strain[own, 6, None, None] / 3.0 * np.eye(3)
        out[own] = np.einsum("pij,pijkl,pkl->p", e, tensor, e, optimize=True)
    return out


def strains(soft: SoftSystem, state: State) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Deformation gradients and rotations (p, 3, 3) and volume ratios (p,) in a state."""
    F, R, J = np.zeros((len(soft.volume), 9)), state.polar.copy(), np.ones(len(soft.volume))
    force = np.zeros((len(soft.cell_node), 8, 3))
    elastic.cell_forces(
        state.x, soft.cell_node, soft.cell_size, soft.cell_start, soft.local, soft.volume, soft.mu, soft.lam,
        soft.relief, R, F, J, np.zeros(len(J)), force,
    )  # fmt: skip
    return F.reshape(-1, 3, 3), R.reshape(-1, 3, 3), J


def deviator(strain: NDArray[np.float64]) -> NDArray[np.float64]:
    """xx, yy, zz, yz, xz, xy of symmetric tensors (p, 3, 3) without their mean, shape (p, 6)."""
    diagonal = np.einsum("pii->pi", strain)
    shear = np.stack([strain[:, 1, 2], strain[:, 0, 2], strain[:, 0, 1]], axis=1)
    return np.concatenate([diagonal - diagonal.mean(axis=1, keepdims=True), shear], axis=1)


def recovered(
    soft: SoftSystem, cell: NDArray[np.int64], weight: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Cell values (c, k) averaged to the nodes by volume, within each material, and interpolated to the particles,
    shape (p, k)."""
    volume = np.bincount(cell, weight, len(values))
    shear = np.bincount(cell, weight * soft.mu, len(values)) / np.maximum(volume, 1e-300)
    material = np.unique(np.round(np.log(np.maximum(shear, 1e-300)) / np.log(SAME_MATERIAL)), return_inverse=True)[1]
    place = (soft.cell_node + len(soft.rest) * material[:, None]).ravel()
    size = len(soft.rest) * int(material.max(initial=0) + 1)
    share = np.repeat(volume, 8)
    total = np.maximum(np.bincount(place, share, size), 1e-300)
    nodal = [np.bincount(place, share * np.repeat(values[:, k], 8), size) / total for k in range(values.shape[1])]
    at = place.reshape(-1, 8)[cell]
    shape = shape_values(soft.local)
    return np.stack([(shape * one[at]).sum(axis=1) for one in nodal], axis=1)


def material_states(soft: SoftSystem, state: State) -> dict[int, MaterialState]:
    """Material of every soft body, by the body's index in the model; without fictitious particles."""
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
