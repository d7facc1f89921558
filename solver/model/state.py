"""The changing part of a simulation: node positions, rigid poses and their velocities.

Degrees of freedom: three per free node, six (translation, rotation about the centre of mass) per moving frame. A
frame is a free rigid body or the rigid core of a soft body; core nodes follow their frame.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from solver.model.bodies import Model
from solver.model.soft import SoftSystem


@dataclass(eq=False, slots=True)
class State:
    """Mutable arrays; `copy` before a step that may be taken back."""

    x: NDArray[np.float64]
    """Node positions [m], shape (n, 3)."""
    v: NDArray[np.float64]
    """Node velocities [m/s], shape (n, 3)."""
    rotation: NDArray[np.float64]
    """World-from-start rotation per model body (identity for soft ones without core), shape (b, 3, 3)."""
    center: NDArray[np.float64]
    """Position of the frame's reference point (centre of mass) per model body [m], shape (b, 3)."""
    velocity: NDArray[np.float64]
    """[m/s], shape (b, 3)."""
    angular_velocity: NDArray[np.float64]
    """World axes [rad/s], shape (b, 3)."""
    polar: NDArray[np.float64]
    """Warm start of the particles' rotations, row-major, shape (p, 9)."""
    time: float = 0.0

    def copy(self) -> "State":
        """An independent copy."""
        return State(
            self.x.copy(), self.v.copy(), self.rotation.copy(), self.center.copy(), self.velocity.copy(),
            self.angular_velocity.copy(), self.polar.copy(), self.time,
        )  # fmt: skip

    def move_as(self, other: "State") -> None:
        """Take over the velocities of another state."""
        self.v[:] = other.v
        self.velocity[:] = other.velocity
        self.angular_velocity[:] = other.angular_velocity

    def stop(self) -> None:
        """Everything stands still."""
        self.v[:] = 0.0
        self.velocity[:] = 0.0
        self.angular_velocity[:] = 0.0


def start_state(model: Model, soft: SoftSystem) -> State:
    """Everything in its start pose with the bodies' start velocities."""
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
