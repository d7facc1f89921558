"""Exchange of impulses between a rigid body and the nodes that touch it, from the laws that define it.

A node touches where the centroid of its material, seen along the body's normal, is no farther out than that of a
half-space whose surface is the body's. With u = v - G q' the node's velocity relative to the body after the exchange,
G = [I, -[r]x], its impulse J is Coulomb's:

    u.n >= 0: none;  else J.n = -m u.n and the tangential part is what stops u_t, or mu_d J.n against it where that
    needs more than mu_s J.n

and all of them act at once on the body: M (q' - q) = -sum G^T J [H18, Sec. 5].

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from solver.reference.mls import spline

Array = NDArray[np.float64]

KNOTS = (-1.5, -0.5, 0.5, 1.5)  # between which the quadratic B-spline is one polynomial
SETTLED = 1e-14  # relative change of q' at which shares are those of q'
MOST_SWEEPS = 500


@dataclass(frozen=True, eq=False, slots=True)
class ContactNode:
    """A node that touches the body."""

    mass: float
    """[kg]."""
    velocity: Array
    """Before the exchange [m/s], shape (3,)."""
    normal: Array
    """Out of the body, shape (3,)."""
    arm: Array
    """From the body's centre of mass [m], shape (3,)."""
    static_friction: float
    dynamic_friction: float

    @property
    def motion(self) -> Array:
        """G, shape (3, 6)."""
        x, y, z = self.arm
        return np.hstack([np.eye(3), [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]])


def touching_centroid(t: float) -> float:
    """Centroid, weighted by the spline, of the material beyond t, seen from a node at 0; all in cells."""
    ends = [max(t, KNOTS[0]), *[k for k in KNOTS[1:] if k > t]]
    at, weight = np.polynomial.legendre.leggauss(4)  # exact for the cubic z N(z)
    mass = moment = 0.0
    for a, b in pairwise(ends):
        for z, w in zip(0.5 * (a + b) + 0.5 * (b - a) * at, 0.5 * (b - a) * weight, strict=True):
            mass += w * spline(z)
            moment += w * z * spline(z)
    return moment / mass if mass > 0.0 else np.inf  # no material is felt from so deep: whatever is there touches


def touches(phi: float, normal: Array, centroid: Array, h: float) -> bool:
    """Whether material with its centroid at an offset [m] from a node, at signed distance phi, reaches the surface."""
    return bool(normal @ centroid <= h * touching_centroid(-phi / h))


def stopped_share(node: ContactNode, q: Array) -> float:
    """Share of the node's tangential motion that friction stops, 0 where it leaves the body."""
    u = node.velocity - node.motion @ q
    pressing = -node.mass * float(u @ node.normal)
    sticking = node.mass * float(np.linalg.norm(u - (u @ node.normal) * node.normal))
    if pressing <= 0.0:
        return 0.0
    return 1.0 if sticking <= node.static_friction * pressing else node.dynamic_friction * pressing / sticking


def impulse(node: ContactNode, q: Array) -> Array:
    """Coulomb's impulse on a node [N s], shape (3,)."""
    u, n = node.velocity - node.motion @ q, node.normal
    if u @ n >= 0.0:
        return np.zeros(3)
    return -node.mass * ((u @ n) * n + stopped_share(node, q) * (u - (u @ n) * n))


def velocity_after(nodes: Sequence[ContactNode], q: Array, mass: Array) -> Array:
    """q' (V, w) of a body with mass matrix (6, 6); ArithmeticError where the shares do not settle."""
    after = q
    for _ in range(MOST_SWEEPS):
        system, right = mass.copy(), mass @ q
        for node in nodes:
            if (node.velocity - node.motion @ after) @ node.normal < 0.0:
                along = np.outer(node.normal, node.normal)
                A = node.mass * (along + stopped_share(node, after) * (np.eye(3) - along))
                system += node.motion.T @ A @ node.motion
                right += node.motion.T @ A @ node.velocity
        before, after = after, np.asarray(np.linalg.solve(system, right), dtype=np.float64)
        if np.linalg.norm(after - before) <= SETTLED * np.linalg.norm(after):
            return np.asarray(after)
    raise ArithmeticError(f"the shares that friction stops have not settled in {MOST_SWEEPS} sweeps")
