"""The linear system of one Newton step, matrix-free, and its solver.

Unknowns in one array: node displacements (n, 3), then frame motions (b, 6: translation, rotation vector about the
frame's centre). Held nodes and held motions are zero; core nodes move with their frame. The matrix is symmetric
positive semi-definite:

    (1 + beta / dt) K + G + M / dt^2 + J^T T J + W^T T_r W

with G the ghost penalty (ghost.py), J the relative displacement of the contact points, W the relative rotation of pairs
that resist rolling. T neglects that the limits of friction and of rolling resistance follow the normal force, a
dependence that is not symmetric: without it Newton's iterations gain a factor of three to ten each (docs/physics.md).

[N06] Nocedal, Wright: Numerical Optimization. 2nd ed., Springer 2006.
[S94] Shewchuk: An introduction to the conjugate gradient method without the agonizing pain. 1994.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse as scipy_sparse
from scipy.linalg import blas

from solver.arrays import Array
from solver.contact.active import Contacts
from solver.kernels import sparse
from solver.model.soft import SoftSystem
from solver.tl.coarse import CoarseSolve, ContactMap
from solver.tl.tangent import ElasticTangent

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
    core_nodes: list[NDArray[np.int64]]
    """Nodes of each frame's rigid core."""
    arm: list[NDArray[np.float64]]
    """Positions of the core nodes relative to the frame's centre [m]."""
    movable: NDArray[np.bool_]
    """Mask of the translations and rotations that are not held, shape (b, 6)."""


class TangentSystem:
    """Applies the matrix and its two-level preconditioner."""

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
        self.elastic = tangent
        self.dt = dt
        self.contacts = contacts
        self.frames = frames
        self.stiffness_scale = 1.0 + damping / dt
        self.node_inertia = soft.mass / dt**2
        self.free = ~(soft.held | (soft.core >= 0))
        self.constrained = np.flatnonzero(~self.free)
        self.frame_inertia = self._frame_inertia(dt)
        soft_bodies = {s.index for s in soft.bodies}
        self.place = {body: f for f, body in enumerate(frames.index) if body not in soft_bodies}
        """Frame of each free rigid body."""
        self.nodes = 3 * len(soft.rest)
        """Offset of the frames in the array of unknowns."""
        self.size = self.nodes + 6 * len(frames.index)
        self.contact = ContactMap.of(contacts, len(soft.rest), self.place, frames.center)
        self.rolling = self._rolling_rows()
        self.has_cores = any(len(t) for t in frames.core_nodes)

    def _frame_inertia(self, dt: float) -> NDArray[np.float64]:
        out = np.zeros((len(self.frames.index), 6, 6))
        out[:, :3, :3] = self.frames.mass[:, None, None] * np.eye(3) / dt**2
        out[:, 3:, 3:] = self.frames.inertia / dt**2
        return out

    def _rolling_rows(self) -> list[tuple[NDArray[np.float64], scipy_sparse.csr_matrix]]:
        """Tangent (3, 3) and rows of W (3, size) for each pair that resists rolling."""
        return [(r.tangent, self._turn_rows(r.a) - self._turn_rows(r.b)) for r in self.contacts.rolling]

    def _turn_rows(self, index: int) -> scipy_sparse.csr_matrix:
        """Map from the unknowns to the rotation vector of a body, shape (3, size)."""
        block, first = np.zeros((3, 0)), 0
        if index in self.contacts.spins:
            spin = self.contacts.spins[index]
            block, first = spin.map, 3 * spin.nodes.start
        elif index in self.place:
            block, first = np.eye(3), self.nodes + 6 * self.place[index] + 3
        width = block.shape[1]
        columns = np.tile(np.arange(first, first + width), 3)
        return scipy_sparse.csr_matrix((block.ravel(), columns, width * np.arange(4)), shape=(3, self.size))

    def split(self, flat: Array) -> Vector:
        """Views of the nodes' part (n, 3) and the frames' part (b, 6)."""
        return flat[: self.nodes].reshape(-1, 3), flat[self.nodes :].reshape(-1, 6)

    def expand(self, flat: Array) -> Array:
        """The same motion with the core nodes set from their frames."""
        if self.has_cores:
            flat = flat.copy()
            nodes, frames = self.split(flat)
            for f, cores in enumerate(self.frames.core_nodes):
                if len(cores):
                    nodes[cores] = frames[f, :3] + np.cross(frames[f, 3:], self.frames.arm[f])
        return flat

    def reduce(self, flat: Array) -> Array:
        """Reduce forces in place: those of core nodes are moved to their frames, and held degrees of freedom set to
        zero."""
        nodes, frames = self.split(flat)
        if self.has_cores:
            for f, cores in enumerate(self.frames.core_nodes):
                if len(cores):
                    frames[f, :3] += nodes[cores].sum(axis=0)
                    frames[f, 3:] += np.cross(self.frames.arm[f], nodes[cores]).sum(axis=0)
        nodes[self.constrained] = 0.0
        frames *= self.frames.movable
        return flat

    def contact_forces(self) -> Array:
        """Forces of contact and of rolling resistance on nodes and frames, before `reduce`."""
        out = np.zeros(self.size)
        self.contact.add_forces(self.contacts.force, *self.split(out))
        for rolling, (_, rows) in zip(self.contacts.rolling, self.rolling, strict=True):
            out += rows.T @ rolling.torque
        return out

    def prepare(self) -> None:
        """Update the preconditioner to this system; call once before the products."""
        self.inverse = self._preconditioner()

    def multiply(self, direction: Array) -> Array:
        """Matrix times vector."""
        p = self.expand(direction)
        out = self._elastic_and_inertia(p)
        if len(self.contacts.a):
            self.contact.add_product(self.split(p), self.split(out))
        for tangent, rows in self.rolling:
            out += rows.T @ (tangent @ (rows @ p))
        return self.reduce(out)

    def _elastic_and_inertia(self, p: Array) -> Array:
        out = np.empty(self.size)
        nodes, frames = self.split(out)
        if len(nodes):
            sparse.multiply(
                self.soft.neighbour, self.elastic.stencil, self.stiffness_scale, self.node_inertia, self.split(p)[0],
                nodes,
            )  # fmt: skip
            nodes += self.elastic.ghost @ self.split(p)[0]
        frames[:] = np.einsum("bij,bj->bi", self.frame_inertia, self.split(p)[1])
        return out

    def _preconditioner(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Inverses of the 3x3 node blocks (n, 3, 3), zero for nodes that are not free, and of the 6x6 frame blocks."""
        frames = self.frame_inertia.copy()
        more = np.zeros((len(self.soft.rest), 9))
        more[:, ::4] += self.elastic.ghost.diagonal()[:, None]
        if len(self.contacts.a):
            more += self.contact.node_blocks()
            own = self.contact.of_frames()[1]
            for f in range(len(frames)):
                frames[f] += own[6 * f : 6 * f + 6, 6 * f : 6 * f + 6]
        for tangent, rows in self.rolling:
            turn = rows[:, self.nodes :].toarray()
            for f in range(len(frames)):
                frames[f] += turn[:, 6 * f : 6 * f + 6].T @ tangent @ turn[:, 6 * f : 6 * f + 6]
        nodes = np.zeros((len(more), 3, 3), dtype=np.float32)
        if len(nodes):
            sparse.invert_diagonal(
                self.elastic.stencil, self.stiffness_scale, self.node_inertia, more, self.free.astype(np.int32), nodes
            )
        own_stiffness, coupling = self._core_coupling()
        frames += own_stiffness
        self.second = None
        if self.elastic.coarse is not None:
            self.second = CoarseSolve(
                self.elastic.coarse, self.contact, [(rows, t) for t, rows in self.rolling],
                self.frame_inertia + own_stiffness, coupling, self.stiffness_scale, self.dt,
            )  # fmt: skip
        return nodes, np.asarray(np.linalg.inv(frames), np.float64)

    def _core_coupling(self) -> tuple[NDArray[np.float64], dict[int, NDArray[np.float64]]]:
        """Forces of the six unit motions of each core: on the frames (b, 6, 6), and on the lattice, (3 m, 6) each."""
        own = np.zeros_like(self.frame_inertia)
        coupling = {}
        for f, cores in enumerate(self.frames.core_nodes):
            if not len(cores):
                continue
            columns = []
            for motion in range(6):
                unit = np.zeros(self.size)
                unit[self.nodes + 6 * f + motion] = 1.0
                forces = self._elastic_and_inertia(self.expand(unit))
                forces[self.nodes :] = 0.0
                if self.elastic.coarse is not None:
                    columns.append(self.elastic.coarse.restrict(self.split(forces)[0]).ravel())
                own[f, :, motion] += self.split(self.reduce(forces))[1][f]
            coupling[f] = np.stack(columns, axis=1)
        return own, coupling

    def precondition(self, residual: Array) -> Array:
        """A symmetric Gauss-Seidel sweep over the nodes, the frames' own blocks, and the coarse space added to both."""
        out = np.empty(self.size)
        nodes, frames = self.split(out)
        node_residual, frame_residual = self.split(residual)
        frames[:] = np.einsum("bij,bj->bi", self.inverse[1], frame_residual)
        if self.second is not None:
            lattice, more = self.second.apply(node_residual, frame_residual)
            frames += more
            sparse.precondition(
                self.soft.neighbour, self.elastic.half, self.elastic.unit, self.stiffness_scale, self.inverse[0],
                node_residual, self.second.space.corner, self.second.space.value, lattice, self.elastic.sweep, nodes,
            )  # fmt: skip
        frames *= self.frames.movable
        return out


def conjugate_gradient(system: TangentSystem, right: Array, tolerance: float, limit: int) -> tuple[Array, int]:
    """Solve system @ y = right, for a prepared system, until the preconditioned residual norm falls by `tolerance`
    [S94, B3]; returns (y, iterations). If the matrix is not positive (the relief of bending may be slightly too large
    in strained cells), y is the result so far, or the preconditioned right side: both are descent directions [N06, Alg.
    7.1]."""
    add = blas.daxpy  # in place: numpy would copy every term
    y, r = np.zeros_like(right), right.copy()
    z = system.precondition(r)
    p = z.copy()
    rho = start = float(r @ z)
    count = 0
    while count < limit and rho > tolerance**2 * start and rho > 0.0:
        q = system.multiply(p)
        curvature = float(p @ q)
        if curvature <= 0.0:
            return (y if count else p), count + 1
        alpha = rho / curvature
        add(p, y, a=alpha)
        add(q, r, a=-alpha)
        z = system.precondition(r)
        rho, previous = float(r @ z), rho
        p *= rho / previous
        p += z
        count += 1
    return y, count
