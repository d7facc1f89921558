"""Transfers of the moving-least-squares material point method, as plain sums over particles and nodes.

Quadratic B-splines N, D = h^2 / 4:

    m_i v_i = sum_p N_i(x_p) [m_p v_p + (m_p C_p - dt / D V_p P_p F_p^T)(x_i - x_p)]                [H18]
    v_p = sum_i N_i v_i,  C_p = 1 / D sum_i N_i v_i (x_i - x_p)^T,  x_p += dt v_p,  F_p += dt C_p F_p

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from solver.reference.elastic import stress

Array = NDArray[np.float64]


def spline(distance: float) -> float:
    """Quadratic B-spline at a distance in cells."""
    d = abs(distance)
    if d < 0.5:
        return 0.75 - d * d
    return 0.5 * (1.5 - d) ** 2 if d < 1.5 else 0.0


def near(x: Array, h: float, low: Array, shape: tuple[int, int, int]) -> list[tuple[int, float, Array]]:
    """Node number, weight and arm x_i - x_p of every node within reach of a particle."""
    middle = np.round((x - low) / h).astype(int)
    out = []
    for offset in product((-1, 0, 1), repeat=3):
        index = middle + offset
        arm = low + h * index - x
        weight = float(np.prod([spline(a / h) for a in arm]))
        out.append((int(np.ravel_multi_index(tuple(index), shape)), weight, arm))
    return out


def particles_to_grid(
    particles: dict[str, Array], dt: float, h: float, low: Array, shape: tuple[int, int, int], gravity: Array
) -> Array:
    """Momentum and mass per node, shape (n, 4); constant holds m, V mu, V lambda and the share of gravity."""
    grid = np.zeros((int(np.prod(shape)), 4))
    for p, x in enumerate(particles["x"]):
        m, mu, lam, share = particles["constant"][p]
        F = particles["F"][p].reshape(3, 3)
        A = m * particles["C"][p].reshape(3, 3) - dt * 4.0 / h**2 * stress(F, mu, lam) @ F.T
        momentum = m * (particles["v"][p] + dt * share * gravity)
        for node, weight, arm in near(x, h, low, shape):
            grid[node, :3] += weight * (momentum + A @ arm)
            grid[node, 3] += weight * m
    return grid


def grid_to_particles(
    particles: dict[str, Array], velocity: Array, dt: float, h: float, low: Array, shape: tuple[int, int, int]
) -> dict[str, Array]:
    """New x, v, C and F of the particles from node velocities (n, 3)."""
    out = {name: np.zeros_like(particles[name]) for name in ("x", "v", "C", "F")}
    for p, x in enumerate(particles["x"]):
        v, C = np.zeros(3), np.zeros((3, 3))
        for node, weight, arm in near(x, h, low, shape):
            v += weight * velocity[node]
            C += 4.0 / h**2 * weight * np.outer(velocity[node], arm)
        F = particles["F"][p].reshape(3, 3)
        out["x"][p], out["v"][p] = x + dt * v, v
        out["C"][p], out["F"][p] = C.ravel(), (F + dt * C @ F).ravel()
    return out
