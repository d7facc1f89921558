"""Rolling and torsional resistance: a torque against the relative rotation of two touching bodies, at most b * N.

Like friction it remembers: a damped elastic angle first, then the torque stays at its limit. Its stiffness is far
below what would hold up a body that is about to fall over (SHARE of N times the body's half size), so it brings a
ball on a plane to rest and cannot make a pencil stand. The rotation of a soft body is that of its mass-weighted best
fit, theta = I^-1 sum m r x u, and its torque is spread over its nodes so that both do the same work. Rolling
resistance length b: [J85, Sec. 9.3].

[J85] Johnson: Contact Mechanics. Cambridge University Press, 1985.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

SHARE = 0.2  # stiffness over N times half size: falling over has 1, rolling on a plane 0
LEAST_ANGLE = 1e-3  # rotation [rad] at which the spring yields where that makes it softer: below what a picture shows


@dataclass(eq=False, slots=True)
class Rolling:
    """Resistance between two bodies of which at least one is free."""

    a: int
    b: int
    torque: NDArray[np.float64]
    """On a [N m], shape (3,)."""
    tangent: NDArray[np.float64]
    """[N m/rad], shape (3, 3)."""
    anchor: NDArray[np.float64]
    """Elastic angle [rad], shape (3,)."""


@dataclass(eq=False, slots=True)
class Spin:
    """How the nodes of a free soft body turn and take a torque."""

    nodes: slice
    mass: NDArray[np.float64]
    """[kg], shape (n,)."""
    arm: NDArray[np.float64]
    """From the centre of mass [m], shape (n, 3)."""
    inverse_inertia: NDArray[np.float64]
    """[1 / (kg m^2)], shape (3, 3)."""

    @classmethod
    def of(cls, nodes: slice, mass: NDArray[np.float64], x: NDArray[np.float64]) -> "Spin":
        """Spin of nodes at positions x (n, 3)."""
        arm = x - mass @ x / mass.sum()
        square = (mass[:, None] * arm).T @ arm
        return cls(nodes, mass, arm, np.linalg.inv(np.trace(square) * np.eye(3) - square))

    def turn(self, displacement: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotation vector [rad] of node displacements (n, 3)."""
        return np.asarray(self.inverse_inertia @ np.cross(self.arm, self.mass[:, None] * displacement).sum(axis=0))

    def forces(self, torque: NDArray[np.float64]) -> NDArray[np.float64]:
        """Node forces (n, 3) that sum to the torque [N m] and do its work."""
        return np.asarray(self.mass[:, None] * np.cross(self.inverse_inertia @ torque, self.arm))


def resist(
    a: int,
    b: int,
    anchor: NDArray[np.float64],
    turn: NDArray[np.float64],
    *,
    seconds: float,
    length: float,
    normal_force: float,
    reach: float,
    mass: float,
) -> Rolling:
    """The law for one step: elastic angle at its start and turn since [rad], its length [s], b [m], N [N], half
    size [m], mass [kg].

    Torque k theta + c d theta / dt with c critical for a body of inertia mass * reach^2, clipped to b N.
    """
    limit = length * normal_force
    stiffness = max(min(limit / LEAST_ANGLE, SHARE * normal_force * reach), 1e-12)
    damping = 2.0 * reach * float(np.sqrt(stiffness * mass))
    trial = stiffness * (anchor + turn) + damping / seconds * turn
    size = float(np.linalg.norm(trial))
    slope = stiffness + damping / seconds
    if size <= limit:
        return Rolling(a, b, -trial, slope * np.eye(3), anchor + turn)
    direction = trial / size
    tangent = slope * limit / size * (np.eye(3) - np.outer(direction, direction))
    elastic = anchor + turn
    longest = limit / stiffness
    return Rolling(
        a, b, -limit * direction, tangent, elastic * min(1.0, longest / max(float(np.linalg.norm(elastic)), 1e-12))
    )
