"""The changing part of a simulation: node positions, rigid poses, their velocities, and the memory of contacts.

Degrees of freedom: three per free node, six (translation, rotation about the centre of mass) per moving frame. A
frame is a free rigid body or the rigid core of a soft body; core nodes follow their frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from solver.model.bodies import Model
from solver.model.soft import SoftSystem


@dataclass(frozen=True, eq=False, slots=True)
class PointMemory:
    """Memory of the surface points of one pair of bodies from step to step."""

    stiffness: NDArray[np.float64]
    """Normal stiffness per point [N/m], shape (n,)."""
    anchor: NDArray[np.float64]
    """Elastic tangential displacement of each point [m], world axes, shape (n, 3)."""
    sliding: NDArray[np.bool_]
    """Points that slid at the end of the last step, shape (n,)."""
    material_point: NDArray[np.float64]
    """Last place of each point in the start pose of a soft partner [m], NaN if it was nowhere, shape (n, 3)."""
    superfluous: NDArray[np.bool_]
    """Points that did not count in the last step, because a soft partner's own points did, shape (n,)."""


@dataclass(frozen=True, eq=False, slots=True)
class ContactMemory:
    """Memory of all contacts in a state. A value: a step makes a new one and edits none."""

    points: Mapping[tuple[int, int], PointMemory] = field(default_factory=dict)
    """Memory by pair: the body of the points, the body that they touch."""
    rolling_torque: Mapping[tuple[int, int], NDArray[np.float64]] = field(default_factory=dict)
    """Elastic part of the torque against rolling per pair of bodies [N m], shape (3,)."""
    touched: frozenset[int] = frozenset()
    """Bodies in contact or bonded at the end of the last step."""
    stiffened: tuple[tuple[int, NDArray[np.float64]], ...] = ()
    """Bodies whose contacts have become stiffer since the last step, and the unit normals there. The next step brings
    positions into balance with the new stiffness, which is not motion."""

    def stiffen(self, pair: tuple[int, int], factor: float) -> "ContactMemory":
        """A copy with a stiffer pair; its anchors shrink, so that friction stays the same."""
        old = self.points[pair]
        new = replace(old, stiffness=factor * old.stiffness, anchor=old.anchor / factor)
        return replace(self, points={**self.points, pair: new})


@dataclass(eq=False, slots=True)
class State:
    """Mutable arrays; `copy` before a step that may be undone."""

    x: NDArray[np.float64]
    """Node positions [m], shape (n, 3)."""
    v: NDArray[np.float64]
    """Node velocities [m/s], shape (n, 3)."""
    rotation: NDArray[np.float64]
    """World-from-start rotation per model body (identity for soft ones without core), shape (b, 3, 3)."""
    center: NDArray[np.float64]
    """Position of the frame's reference point (centre of mass) per model body [m], shape (b, 3)."""
    velocity: NDArray[np.float64]
    """Velocity of the frame's reference point [m/s], shape (b, 3)."""
    angular_velocity: NDArray[np.float64]
    """Angular velocity of the frame, world axes [rad/s], shape (b, 3)."""
    polar: NDArray[np.float64]
    """Warm start of the particles' rotations, row-major, shape (p, 9)."""
    time: float = 0.0
    memory: ContactMemory = field(default_factory=ContactMemory)

    def copy(self) -> "State":
        """An independent copy."""
        return State(
            self.x.copy(), self.v.copy(), self.rotation.copy(), self.center.copy(), self.velocity.copy(),
            self.angular_velocity.copy(), self.polar.copy(), self.time, self.memory,
        )  # fmt: skip

    def move_as(self, other: "State") -> None:
        """Take over the velocities of another state."""
        self.v[:] = other.v
        self.velocity[:] = other.velocity
        self.angular_velocity[:] = other.angular_velocity

    def stop(self) -> None:
        """Set all velocities to zero."""
        self.v[:] = 0.0
        self.velocity[:] = 0.0
        self.angular_velocity[:] = 0.0


def start_state(model: Model, soft: SoftSystem, memory: ContactMemory | None = None) -> State:
    """The start pose with the bodies' start velocities; `memory` is the memory of contacts before any step."""
    count = len(model.bodies)
    velocity = np.array([b.velocity for b in model.bodies]).reshape(count, 3)
    angular = np.array([b.angular_velocity for b in model.bodies]).reshape(count, 3)
    center = np.array([b.center_of_mass for b in model.bodies]).reshape(count, 3)
    v = np.zeros_like(soft.rest)
    for body in soft.bodies:
        arm = soft.rest[body.nodes] - center[body.index]
        v[body.nodes] = velocity[body.index] + np.cross(angular[body.index], arm)
    v[soft.held] = 0.0
    return State(
        x=soft.rest.copy(), v=v, rotation=np.tile(np.eye(3), (count, 1, 1)), center=center.copy(), velocity=velocity,
        angular_velocity=angular, polar=np.tile(np.eye(3).ravel(), (len(soft.volume), 1)),
        memory=memory or ContactMemory(),
    )  # fmt: skip


def rotate(rotation: NDArray[np.float64], turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """Apply a rotation vector [rad], shape (3,), in world axes to a rotation matrix."""
    return np.asarray(Rotation.from_rotvec(turn).as_matrix() @ rotation)


def turn_between(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation vector [rad], world axes, that takes `before` to `after`, shape (3,)."""
    return np.asarray(Rotation.from_matrix(after @ before.T).as_rotvec())


def best_rigid_motion(
    rest: NDArray[np.float64], moved: NDArray[np.float64], weight: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation (3, 3) and translation (3,) of the rigid motion nearest to rest (n, 3) -> moved (n, 3),
    mass-weighted (Kabsch)."""
    total = weight.sum()
    a, b = weight @ rest / total, weight @ moved / total
    u, _, vt = np.linalg.svd((moved - b).T @ ((rest - a) * weight[:, None]))
    flip = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    rotation = u @ flip @ vt
    return rotation, b - rotation @ a


def cross_matrix(arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """[r]x with [r]x w = r x w for arms (k, 3), shape (k, 3, 3)."""
    out = np.zeros((len(arm), 3, 3))
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -arm[:, 2], arm[:, 1], -arm[:, 0]
    return out - out.transpose(0, 2, 1)
