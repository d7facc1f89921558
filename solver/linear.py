"""The linear system of one Newton step, matrix-free, and its conjugate gradient solver.

Unknowns: node displacements (n, 3) and frame motions (b, 6: translation, rotation vector about the frame's centre).
Held nodes do not move; core nodes move with their frame. The matrix is symmetric positive semi-definite:

    (1 + beta / dt) K + M / dt^2 + contact tangents.

[S94] Shewchuk: An introduction to the conjugate gradient method without the agonizing pain. 1994.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.coarse import CoarseSolve, CoarseSpace
from solver.contact import Contacts
from solver.kernels import sparse
from solver.soft import SoftSystem
from solver.state import cross_matrix
from solver.tangent import ElasticTangent

Vector = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(eq=False, slots=True)
class Frames:
    """The moving frames of a model at one state."""

    index: list[int]
    """Model index of each frame's body."""
    center: NDArray[np.float64]
    """Reference points [m], shape (b, 3)."""
    mass: NDArray[np.float64]
    """Own masses [kg] (zero for cores, whose mass sits in their nodes), shape (b,)."""
    inertia: NDArray[np.float64]
    """Own inertia, world axes [kg m^2], shape (b, 3, 3)."""
    tied: list[NDArray[np.int64]]
    """Core nodes of each frame."""
    arm: list[NDArray[np.float64]]
    """Positions of the core nodes relative to the frame's centre [m]."""


class TangentSystem:
    """Applies the matrix and its block-diagonal inverse."""

    def __init__(
        self,
        soft: SoftSystem,
        tangent: ElasticTangent,
        contacts: Contacts,
        frames: Frames,
        dt: float,
        damping: float,
    ) -> None:
        self.soft = soft
        self.stencil = tangent.stencil
        self.coarse = tangent.coarse
        self.dt = dt
        self.contacts = contacts
        self.frames = frames
        self.stiffness_scale = 1.0 + damping / dt
        self.node_inertia = soft.mass / dt**2
        self.free = ~(soft.held | (soft.core >= 0))[:, None]
        self.frame_inertia = self._frame_inertia(dt)
        soft_bodies = {s.index for s in soft.bodies}
        self.place = {body: f for f, body in enumerate(frames.index) if body not in soft_bodies}
        """Frame of each free rigid body."""
        self.sides = self._sides()
        self._product = np.zeros_like(soft.rest)
        self.inverse: Vector | None = None
        self.second: CoarseSolve | None = None

    def _frame_inertia(self, dt: float) -> NDArray[np.float64]:
        out = np.zeros((len(self.frames.index), 6, 6))
        out[:, :3, :3] = self.frames.mass[:, None, None] * np.eye(3) / dt**2
        out[:, 3:, 3:] = self.frames.inertia / dt**2
        return out

    def _sides(self) -> list[tuple[int, NDArray[np.int64], NDArray[np.float64], float]]:
        """Per frame and side: which contact points it moves rigidly, their arms and the sign."""
        out = []
        for body, f in self.place.items():
            for which, sign in ((self.contacts.a, 1.0), (self.contacts.b, -1.0)):
                points = np.flatnonzero(which == body)
                if len(points):
                    out.append((f, points, self.contacts.position[points] - self.frames.center[f], sign))
        return out

    def expand(self, nodes: NDArray[np.float64], frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Node displacements with the core nodes filled in from their frames."""
        for f, tied in enumerate(self.frames.tied):
            if len(tied):
                nodes[tied] = frames[f, :3] + np.cross(frames[f, 3:], self.frames.arm[f])
        return nodes

    def reduce(self, nodes: NDArray[np.float64], frames: NDArray[np.float64]) -> Vector:
        """Node forces with those of the core nodes moved to their frames; held nodes drop out."""
        for f, tied in enumerate(self.frames.tied):
            if len(tied):
                frames[f, :3] += nodes[tied].sum(axis=0)
                frames[f, 3:] += np.cross(self.frames.arm[f], nodes[tied]).sum(axis=0)
        return nodes * self.free, frames

    def contact_forces(self, force: NDArray[np.float64]) -> Vector:
        """Point forces (k, 3) on side a as node forces and frame wrenches, before `reduce`."""
        nodes = np.asarray(self.contacts.gather.T @ force)[: len(self.soft.rest)]
        frames = np.zeros((len(self.frames.index), 6))
        for f, points, arm, sign in self.sides:
            frames[f, :3] += sign * force[points].sum(axis=0)
            frames[f, 3:] += sign * np.cross(arm, force[points]).sum(axis=0)
        return nodes, frames

    def multiply(self, direction: Vector) -> Vector:
        """Matrix times vector."""
        p = self.expand(direction[0].copy(), direction[1])
        nodes = self._elastic_and_inertia(p)
        frames = np.einsum("bij,bj->bi", self.frame_inertia, direction[1])
        if len(self.contacts.a):
            relative = np.asarray(self.contacts.gather @ p) if len(p) else np.zeros((len(self.contacts.a), 3))
            for f, points, arm, sign in self.sides:
                relative[points] += sign * (direction[1][f, :3] + np.cross(direction[1][f, 3:], arm))
            node_part, frame_part = self.contact_forces(np.einsum("kij,kj->ki", self.contacts.tangent, relative))
            nodes += node_part
            frames += frame_part
            turns = [self._turn(r.a, p, direction[1]) - self._turn(r.b, p, direction[1]) for r in self.contacts.rolling]
            torques = [r.tangent @ t for r, t in zip(self.contacts.rolling, turns, strict=True)]
            self.add_rolling(torques, nodes, frames)
        return self.reduce(nodes, frames)

    def _elastic_and_inertia(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        if len(p):
            sparse.multiply(
                self.soft.neighbour, self.stencil, self.stiffness_scale, self.node_inertia, p, self._product
            )
        return self._product

    def add_rolling(
        self, torques: list[NDArray[np.float64]], nodes: NDArray[np.float64], frames: NDArray[np.float64]
    ) -> None:
        """Add one torque per rolling pair, on its body a and against b, to node forces and frame wrenches."""
        for r, torque in zip(self.contacts.rolling, torques, strict=True):
            for index, sign in ((r.a, 1.0), (r.b, -1.0)):
                if index in self.contacts.spins:
                    spin = self.contacts.spins[index]
                    nodes[spin.nodes] += spin.forces(sign * torque)
                elif index in self.place:
                    frames[self.place[index], 3:] += sign * torque

    def _turn(self, index: int, nodes: NDArray[np.float64], frames: NDArray[np.float64]) -> NDArray[np.float64]:
        if index in self.contacts.spins:
            spin = self.contacts.spins[index]
            return spin.turn(nodes[spin.nodes])
        return frames[self.place[index], 3:] if index in self.place else np.zeros(3)

    def _preconditioner(self) -> Vector:
        """Inverses of the 3x3 node blocks (n, 9), zero where nodes are not free, and of the 6x6 frame blocks."""
        frames = self.frame_inertia.copy()
        for r in self.contacts.rolling:
            for body, f in self.place.items():
                if body in (r.a, r.b):
                    frames[f, 3:, 3:] += r.tangent
        if self.coarse is not None:
            coupling = {
                f: self._core_coupling(f, frames, self.coarse) for f, tied in enumerate(self.frames.tied) if len(tied)
            }
            self.second = CoarseSolve(
                self.coarse, self.contacts, self.sides, frames, coupling, self.stiffness_scale, self.dt
            )
        more = np.zeros((len(self.soft.rest), 9))
        if len(self.contacts.a):
            if len(more):
                squared = self.contacts.gather.multiply(self.contacts.gather).T
                more += np.asarray(squared @ self.contacts.tangent.reshape(-1, 9))[: len(more)]
            for f, points, arm, _ in self.sides:
                frames[f] += _wrench_block(self.contacts.tangent[points], arm)
        nodes = np.zeros_like(more)
        if len(nodes):
            sparse.invert_diagonal(
                self.stencil, self.stiffness_scale, self.node_inertia, more, self.free[:, 0].astype(np.int32), nodes
            )
        return nodes, np.asarray(np.linalg.inv(frames), np.float64)

    def _core_coupling(self, f: int, frames: NDArray[np.float64], coarse: CoarseSpace) -> NDArray[np.float64]:
        """Forces of the six unit motions of a core: on itself (added to `frames`) and on the lattice, shape
        (3 m, 6)."""
        columns = []
        for motion in np.eye(6):
            unit = np.zeros((len(self.frames.index), 6))
            unit[f] = motion
            p = self.expand(np.zeros_like(self._product), unit)
            forces = self._elastic_and_inertia(p)
            columns.append(np.asarray(coarse.prolong.T @ forces).ravel())
            own = np.zeros((len(self.frames.index), 6))
            self.reduce(forces, own)
            frames[f, :, int(np.argmax(motion))] += own[f]
        return np.stack(columns, axis=1)

    def precondition(self, residual: Vector) -> Vector:
        """Block-Jacobi plus the coarse space."""
        if self.inverse is None:
            self.inverse = self._preconditioner()
        node_inverse, frame_inverse = self.inverse
        nodes = np.zeros_like(residual[0])
        if len(nodes):
            sparse.apply_diagonal(node_inverse, residual[0], nodes)
        frames = np.einsum("bij,bj->bi", frame_inverse, residual[1])
        if self.second is not None:
            node_part, frame_part = self.second.apply(*residual)
            nodes += node_part
            frames += frame_part
        return nodes, frames


def _wrench_block(tangent: NDArray[np.float64], arm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sum of J^T K J over points, J = [I, -[arm]x], shape (6, 6)."""
    jacobian = np.concatenate([np.broadcast_to(np.eye(3), (len(arm), 3, 3)), -cross_matrix(arm)], axis=2)
    return np.asarray(np.einsum("kia,kij,kjb->ab", jacobian, tangent, jacobian))


def dot(a: Vector, b: Vector) -> float:
    """Inner product; numpy's pairwise summation runs in a fixed order on one thread."""
    return float((a[0] * b[0]).sum() + (a[1] * b[1]).sum())


def conjugate_gradient(system: TangentSystem, right: Vector, tolerance: float, limit: int) -> tuple[Vector, int]:
    """Solve system @ y = right until the preconditioned residual norm falls by `tolerance` [S94, B3]; returns (y,
    iterations)."""
    y = (np.zeros_like(right[0]), np.zeros_like(right[1]))
    r = (right[0].copy(), right[1].copy())
    z = system.precondition(r)
    p = (z[0].copy(), z[1].copy())
    rho = start = dot(r, z)
    count = 0
    while count < limit and rho > tolerance**2 * start and rho > 0.0:
        q = system.multiply(p)
        curvature = dot(p, q)
        if curvature <= 0.0:
            break
        alpha = rho / curvature
        for k in (0, 1):
            y[k][...] += alpha * p[k]
            r[k][...] -= alpha * q[k]
        z = system.precondition(r)
        rho, previous = dot(r, z), rho
        for k in (0, 1):
            p[k][...] *= rho / previous
            p[k][...] += z[k]
        count += 1
    return y, count
