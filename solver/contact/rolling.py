"""Rolling and torsional resistance: a torque against the relative rotation of two touching bodies, at most b * N.

Like friction it remembers: an elastic angle first, then the torque stays at its limit. On the way to rest the spring
is stiff (`law_stiff`), so that a ball stops. While a rest state is tried with a kick it is compliant (`law_compliant`):
a damped spring far below what would hold up a body that is about to fall over (SHARE of N times the body's half size),
because resistance to rolling must not make a pencil stand. The rotation of a soft body is that of its mass-weighted
best fit, theta = I^-1 sum m r x u, and its torque is spread over its nodes so that both do the same work. Rolling
resistance length b: [J85, Sec. 9.3].

[J85] Johnson: Contact Mechanics. Cambridge University Press, 1985.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model.state import cross_matrix

SHARE = 0.1  # stiffness over N times half size: falling over has 1, rolling on a plane 0
GYRATION = 0.6  # radius of gyration about the contact over half the box diagonal: 0.68 for a rolling ball
LEAST_ANGLE = 1e-3  # rotation [rad] at which the spring yields where that makes it softer: below what a picture shows


@dataclass(frozen=True, eq=False, slots=True)
class RollingTorque:
    """Resistance between two bodies of which at least one is free."""

    a: int
    b: int
    torque: NDArray[np.float64]
    """On a [N m], shape (3,)."""
    tangent: NDArray[np.float64]
    """[N m/rad], shape (3, 3)."""
    elastic: NDArray[np.float64]
    """Elastic part of the resisted torque at the end of the step, what the next one starts from [N m], shape (3,)."""
    length: float
    """Lever of the normal force at which it gives way [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Spin:
    """How the nodes of a free soft body turn and take a torque."""

    nodes: slice
    arm: NDArray[np.float64]
    """From the centre of mass [m], shape (n, 3)."""
    map: NDArray[np.float64]
    """Rotation vector from node displacements, I^-1 m [r]x, shape (3, 3 n); its transpose spreads a torque."""

    @classmethod
    def of(cls, nodes: slice, mass: NDArray[np.float64], x: NDArray[np.float64]) -> "Spin":
        """Spin of nodes at positions x (n, 3)."""
        arm = x - mass @ x / mass.sum()
        square = (mass[:, None] * arm).T @ arm
        inverse = np.linalg.inv(np.trace(square) * np.eye(3) - square)
        rows = inverse @ (mass[:, None, None] * cross_matrix(arm))
        return cls(nodes, arm, np.ascontiguousarray(rows.transpose(1, 0, 2)).reshape(3, -1))

    def turn(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotation vector [rad] of node displacements (n, 3)."""
        return np.asarray(self.map @ displacement.ravel())

    def forces(self, torque: NDArray[np.float64]) -> NDArray[np.float64]:
        """Node forces (n, 3) that sum to the torque [N m] and do its work."""
        return (torque @ self.map).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class RollingCoefficients:
    """The numbers of one pair in one step."""

    limit: float
    """Largest torque b * N [N m]."""
    stiffness: float
    """[N m/rad]."""
    damping: float
    """[N m s/rad]."""


RollingLaw = Callable[[float, float, float, float], RollingCoefficients]
"""Resistance length b [m], normal force N [N], the moving body's half size [m] and mass [kg] -> the pair's numbers."""


def law_stiff(length: float, normal_force: float, half_size: float, mass: float) -> RollingCoefficients:
    """On the way to rest: stops what rolls."""
    limit = length * normal_force
    return RollingCoefficients(limit, limit / LEAST_ANGLE, 0.0)


def law_compliant(length: float, normal_force: float, half_size: float, mass: float) -> RollingCoefficients:
    """While a rest state is tried: gives way to what falls over."""
    limit = length * normal_force
    stiffness = min(limit / LEAST_ANGLE, SHARE * normal_force * half_size)
    return RollingCoefficients(limit, stiffness, 2.0 * GYRATION * half_size * float(np.sqrt(stiffness * mass)))


def resisting_torque(
    pair: tuple[int, int],
    length: float,
    law: RollingCoefficients,
    torque: NDArray[np.float64],
    turn: NDArray[np.float64],
    seconds: float,
) -> RollingTorque:
    """Torque between a pair in a step: the lever [m] and what follows from it, elastic torque at the start [N m], turn
    since [rad], the step's length [s]."""
    a, b = pair
    elastic = torque + law.stiffness * turn
    trial = elastic + law.damping / seconds * turn
    size = float(np.linalg.norm(trial))
    slope = law.stiffness + law.damping / seconds
    if size <= law.limit:
        return RollingTorque(a, b, -trial, slope * np.eye(3), elastic, length)
    direction = trial / size
    tangent = slope * law.limit / size * (np.eye(3) - np.outer(direction, direction))
    kept = min(1.0, law.limit / max(float(np.linalg.norm(elastic)), 1e-30))
    return RollingTorque(a, b, -law.limit * direction, tangent, kept * elastic, length)
