"""Contact forces: a normal spring, Coulomb friction by a return map [W06, Ch. 5], rolling resistance.

Coefficients of friction and rolling resistance are the geometric means of the values of both surfaces at the contact.

Rolling and torsional resistance is a torque of at most b * N against the relative rotation of two touching bodies; b is
the resistance length [J85, Sec. 9.3]. Like friction it has memory: the torque grows elastically to its limit and stays
there. On the way to rest the spring is stiff (`law_stiff`), so that a ball stops. While a kick tests a rest state, the
spring is damped and compliant (`law_compliant`). At SHARE of N times the body's half size it is far too weak to hold up
a falling body: rolling resistance must not make a pencil stand. The rotation of a soft body is that of its
mass-weighted best fit, theta = I^-1 sum m r x u, and its torque is spread over its nodes so that both do the same work.

[W06] Wriggers: Computational Contact Mechanics, 2nd ed., Springer 2006.

[J85] Johnson: Contact Mechanics. Cambridge University Press, 1985.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.arrays import Array
from solver.contact.nearest_face import NearestFace
from solver.model.bodies import Body, Model
from solver.model.state import PointMemory, cross_matrix

# tangential over normal stiffness: Mindlin's ratio 2 (1 - nu) / (2 - nu) lies between 0.67 and 1; softer is safe
TANGENTIAL_SHARE = 0.5
SHARE = 0.1  # stiffness over (N times half size): it is 1 for falling over, 0 for rolling on a plane
GYRATION = 0.6  # radius of gyration about the contact over half the box diagonal: 0.68 for a rolling ball
LEAST_ANGLE = 1e-3  # least rotation [rad] at which the spring yields: too small to see in a picture


def point_forces(
    friction: NDArray[np.float64],
    memory: PointMemory,
    index: NDArray[np.int64],
    gap: NDArray[np.float64],
    normal: NDArray[np.float64],
    slip: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Force on a (k, 3), its negative derivative at constant friction limits (k, 3, 3), new anchors (k, 3) and sliding
    flags (k,) of penetrating points; `friction` (k, 3) begins with their static and dynamic coefficients.

    A point that slid at the end of the last step has mu_d, any other point mu_s; the choice is fixed within a step, so
    that the force is a continuous function of the step's motion and Newton can converge.
    """
    stiffness = memory.stiffness[index]
    load = -stiffness * gap
    outer = normal[:, :, None] * normal[:, None, :]
    plane = np.eye(3) - outer
    trial = np.einsum("kij,kj->ki", plane, memory.anchor[index] + slip)
    size = np.linalg.norm(trial, axis=1)
    tangential = TANGENTIAL_SHARE * stiffness
    coefficient = np.where(memory.sliding[index], friction[:, 1], friction[:, 0])
    limit = coefficient * load
    slides = tangential * size > limit
    direction = np.divide(trial, size[:, None], out=np.zeros_like(trial), where=size[:, None] > 0.0)
    stretch = np.where(slides, limit / tangential, size)
    force = load[:, None] * normal - (tangential * stretch)[:, None] * direction
    ratio = np.where(slides, np.divide(stretch, size, out=np.ones_like(size), where=size > 0.0), 1.0)
    stuck = plane - np.where(slides, 1.0, 0.0)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    tangent = stiffness[:, None, None] * outer + (tangential * ratio)[:, None, None] * stuck
    return force, tangent, stretch[:, None] * direction, slides


@dataclass(frozen=True, eq=False, slots=True)
class PairFriction:
    """Friction coefficients of the points of one body against another."""

    own: Array
    """Static and dynamic friction [-] and rolling resistance length [m] of each point, shape (n, 3)."""
    other: Array
    """The same for each kind of face of the other body, or one row for all, shape (m, 3) or (1, 3)."""
    faces: NearestFace | None
    """Faces of the other body in the start pose, labelled with their kinds; None if one row applies to all."""
    given: tuple[float, float] | None = None
    """Static and dynamic friction set explicitly for this pair of bodies."""

    @classmethod
    def of(cls, model: Model, a: Body, b: Body) -> "PairFriction":
        """Coefficients of the points of `a` against `b`."""
        own = np.broadcast_to(a.friction_rows, (len(a.vertices), 3))
        if b.face_friction is None:
            return cls(own, b.friction_rows, None, model.given_friction(a, b))
        kinds, label = np.unique(b.face_friction, axis=0, return_inverse=True)
        found = NearestFace.of(b.vertices, b.faces, label.reshape(-1))
        return cls(own, kinds, found, model.given_friction(a, b))

    def at(self, index: NDArray[np.int64], material: Array) -> Array:
        """Coefficients of the pair at some points (k,) that touch the other body at material points (k, 3) of its start
        pose [m], shape (k, 3)."""
        row = np.zeros(len(index), dtype=np.int64) if self.faces is None else self.faces.label_at(material)
        both = np.sqrt(self.own[index] * self.other[row])
        if self.given is not None:
            both[:, :2] = self.given
        return np.asarray(both)


@dataclass(frozen=True, eq=False, slots=True)
class RollingTorque:
    """Rolling resistance between two bodies, at least one of them free."""

    a: int
    b: int
    torque: NDArray[np.float64]
    """Torque on a [N m], shape (3,)."""
    tangent: NDArray[np.float64]
    """Derivative of the torque [N m/rad], shape (3, 3)."""
    elastic: NDArray[np.float64]
    """Elastic part of the torque at the end of the step, from which the next step starts [N m], shape (3,)."""
    length: float
    """Lever of the normal force at which the resistance yields [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class Spin:
    """Rotation of the nodes of a free soft body, and distribution of a torque to them."""

    nodes: slice
    arm: NDArray[np.float64]
    """Arms from the centre of mass [m], shape (n, 3)."""
    map: NDArray[np.float64]
    """Map from node displacements to the rotation vector, I^-1 m [r]x, shape (3, 3 n); its transpose distributes a
    torque."""

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
        """Node forces (n, 3) that sum to the torque [N m] and do the same work."""
        return (torque @ self.map).reshape(-1, 3)


@dataclass(frozen=True, slots=True)
class RollingCoefficients:
    """Coefficients of one pair in one step."""

    limit: float
    """Largest torque b * N [N m]."""
    stiffness: float
    """Stiffness [N m/rad]."""
    damping: float
    """Damping [N m s/rad]."""


RollingLaw = Callable[[float, float, float, float], RollingCoefficients]
"""Resistance length b [m], normal force N [N], half size [m] and mass [kg] of the moving body -> the pair's
coefficients."""


def law_stiff(length: float, normal_force: float, half_size: float, mass: float) -> RollingCoefficients:
    """Law on the way to rest: stops rolling bodies."""
    limit = length * normal_force
    return RollingCoefficients(limit, limit / LEAST_ANGLE, 0.0)


def law_compliant(length: float, normal_force: float, half_size: float, mass: float) -> RollingCoefficients:
    """Law while a rest state is tested: gives way to a body that falls over."""
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
    """Torque between a pair in a step, from the lever [m], the law, the elastic torque at the start [N m], the turn
    since then [rad] and the length of the step [s]."""
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
