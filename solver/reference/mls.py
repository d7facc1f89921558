"""Transfers of the moving-least-squares material point method, as plain sums over particles and nodes.

Quadratic B-splines N in the plane index along each axis; for the weights of a particle the middle is Xm = sum_i N_i X_i
and the spread D = sum_i N_i (X_i - Xm)^2:

    m_i v_i = sum_p N_i [m_p u_p + (m_p C_p - dt V_p P_p F_p^T D^-1)(x_i - xm_p)]                    [H18]
    u_p = sum_i N_i v_i,  C_p = sum_i N_i v_i (x_i - xm_p)^T D^-1
    x_p += dt (u_p + C_p (x_p - xm_p)),  F_p += dt C_p F_p

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from solver.arrays import Array
from solver.reference.elastic import stress


@dataclass(frozen=True, eq=False, slots=True)
class GridFrame:
    """Node planes along three axes of a frame in the world: X = R^T (x - c) + c0."""

    planes: Sequence[Array]
    rotation: Array
    center: Array
    start_center: Array

    def world(self, place: Array) -> Array:
        """World position of a place in the frame."""
        return np.asarray(self.rotation @ (place - self.start_center) + self.center)


def spline(distance: float) -> float:
    """Quadratic B-spline at a distance in cells."""
    d = abs(distance)
    if d < 0.5:
        return 0.75 - d * d
    return 0.5 * (1.5 - d) ** 2 if d < 1.5 else 0.0


def near(x: Array, grid: GridFrame) -> tuple[list[tuple[int, float, Array]], Array, Array]:
    """Index, weight and position of every node within reach of a particle; middle of the weights; D^-1, all in the
    world."""
    here = grid.rotation.T @ (x - grid.center) + grid.start_center
    number = [float(np.interp(a, p, np.arange(len(p)))) for a, p in zip(here, grid.planes, strict=True)]
    chosen = [range(int(np.floor(q - 0.5)), int(np.floor(q - 0.5)) + 3) for q in number]
    weight = [[spline(i - q) for i in some] for some, q in zip(chosen, number, strict=True)]
    place = [p[list(some)] for p, some in zip(grid.planes, chosen, strict=True)]
    middle = np.array([np.dot(w, a) for w, a in zip(weight, place, strict=True)])
    spread = np.array([np.dot(w, (a - m) ** 2) for w, a, m in zip(weight, place, middle, strict=True)])
    shape = tuple(len(p) for p in grid.planes)
    nodes = [
        (
            int(np.ravel_multi_index(tuple(some[k] for some, k in zip(chosen, offset, strict=True)), shape)),
            float(np.prod([w[k] for w, k in zip(weight, offset, strict=True)])),
            grid.world(np.array([a[k] for a, k in zip(place, offset, strict=True)])),
        )
        for offset in product(range(3), repeat=3)
    ]
    return nodes, grid.world(middle), grid.rotation @ np.diag(1.0 / spread) @ grid.rotation.T


def particles_to_grid(particles: dict[str, Array], dt: float, grid: GridFrame, gravity: Array) -> Array:
    """Momentum and mass per node, shape (n, 4); constant holds m, V mu, V lambda, the share of gravity and V."""
    out = np.zeros((int(np.prod([len(p) for p in grid.planes])), 4))
    for p, x in enumerate(particles["x"]):
        m, mu, lam, share, _ = particles["constant"][p]
        F, (nodes, middle, inverse) = particles["F"][p], near(x, grid)
        A = m * particles["C"][p] - dt * stress(F, mu, lam) @ F.T @ inverse
        momentum = m * (particles["u"][p] + dt * share * gravity)
        for node, weight, place in nodes:
            out[node, :3] += weight * (momentum + A @ (place - middle))
            out[node, 3] += weight * m
    return out


def grid_to_particles(particles: dict[str, Array], velocity: Array, dt: float, grid: GridFrame) -> dict[str, Array]:
    """New x, u, C and F of the particles from node velocities (n, 3)."""
    out = {name: np.zeros_like(particles[name]) for name in ("x", "u", "C", "F")}
    for p, x in enumerate(particles["x"]):
        nodes, middle, inverse = near(x, grid)
        u = np.sum([weight * velocity[node] for node, weight, _ in nodes], axis=0)
        C = np.sum([weight * np.outer(velocity[node], place - middle) for node, weight, place in nodes], axis=0)
        C = C @ inverse
        F = particles["F"][p]
        out["x"][p], out["u"][p] = x + dt * (u + C @ (x - middle)), u
        out["C"][p], out["F"][p] = C, F + dt * C @ F
    return out
