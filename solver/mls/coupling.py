"""Impulses between rigid bodies and the grid, and what they add up to per pair of bodies.

A rigid body acts on the nodes that lie inside it: their velocity relative to it may not point inwards, and friction
stops their tangential motion up to Coulomb's limit. The rigid body takes the opposite impulses in the same, implicit,
exchange, so momentum is conserved and a light body on heavy material stays stable.

Two more exchanges act between the rigid motions of the two bodies of a touching pair: a dashpot along the contact
normals, which damps the bounce of one on the other critically, and rolling resistance, a torque of at most b N. Both
vanish at rest.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solver.config import SolverConfig
from solver.contact.predict import contact_stiffness
from solver.kernels.mls_coupling import COUPLED, IMPULSE, LOAD, NORMAL_IMPULSE, NORMAL_MATRIX, SETTLED, TOUCHING, couple
from solver.kernels.mls_distance import distance_at_nodes
from solver.mls.bodies import SoftBodies
from solver.mls.rigid import RigidBodies
from solver.model.bodies import Body, Model, SignedDistance, SoftBody

Array = NDArray[np.float64]

REACH = 1.0  # nodes this far outside of a rigid body, in cells, still hold material that touches it: half their support


@dataclass(eq=False, slots=True)
class NodeDistances:
    """Distance and normal of one rigid body at the nodes of a box of the grid."""

    span: NDArray[np.int32]
    """First node and count along x, y, z, shape (2, 3)."""
    phi: Array
    """Signed distance [m], shape (n,)."""
    normal: Array
    """Outwards, shape (n, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class Exchange:
    """What a soft body received from a rigid one in one step."""

    load: float
    """Normal impulses [N s]."""
    impulse: Array
    """[N s], shape (3,)."""
    along_normal: Array
    """Normal part of it [N s], shape (3,)."""
    normal_matrix: Array
    """Sum of G^T n n^T G weighted by normal impulses, G = [I, -[r]x] about the rigid body's centre, shape (6, 6)."""

    @classmethod
    def of(cls, row: Array) -> "Exchange":
        """From one row of what `couple` tells."""
        matrix = row[NORMAL_MATRIX : NORMAL_MATRIX + 36].reshape(6, 6)
        impulse, along = (row[k : k + 3] for k in (IMPULSE, NORMAL_IMPULSE))
        return cls(float(row[LOAD]), impulse, along, matrix)


@dataclass(eq=False, slots=True)
class PairImpulse:
    """Sums over some time of what a soft body received from a rigid one."""

    load: float = 0.0
    """Normal impulses [N s]."""
    impulse: Array = field(default_factory=lambda: np.zeros(3))
    """On the soft body [N s], shape (3,)."""
    along_normal: Array = field(default_factory=lambda: np.zeros(3))
    """Normal part of it [N s], shape (3,)."""


@dataclass(eq=False, slots=True)
class Unsettled:
    """Exchanges of a rigid body in which its velocity and the friction on it had not come to agree."""

    count: int = 0
    largest_change: float = 0.0
    """Of the velocity in the last sweep, over the velocity [-]."""


class Coupling:
    """All pairs of a rigid and a soft body."""

    def __init__(self, model: Model, soft: SoftBodies, rigid: RigidBodies, config: SolverConfig) -> None:
        self.model, self.soft, self.rigid, self.config = model, soft, rigid, config
        self.work = np.zeros((6, 7))
        self.number = np.zeros((0, 2), dtype=np.int32)
        self.touching = np.zeros((0, TOUCHING))
        self.last_change = np.zeros(1)
        self.unsettled: dict[int, Unsettled] = {}
        self.fixed_distances: dict[int, NodeDistances | None] = {}
        self.friction = {
            r: np.array([model.friction(model.bodies[r], model.bodies[i]) for i in soft.index]) for r in rigid.index
        }
        self.dashpot = {
            (r, part): dashpot_coefficient(model, r, i, config)
            for r in rigid.index
            for part, i in enumerate(soft.index)
        }
        self.impulses: dict[tuple[int, int], PairImpulse] = {}
        self.loaded: list[tuple[int, int, Exchange]] = []

    def discard_distances(self) -> None:
        """The grid has been laid out anew: distances of fixed bodies are no longer at its nodes."""
        self.fixed_distances = {}

    def exchange(self) -> None:
        """Let every rigid body act on the nodes inside it, one after the other, in the order of the model."""
        self.loaded = []
        for index in self.rigid.index:
            near = self._field(index)
            if near is None:
                continue
            out = np.zeros((len(self.soft.index), COUPLED))
            body, q = self.model.bodies[index], self.rigid.velocity(index)
            if len(self.number) < len(near.phi):
                self.number, self.touching = np.zeros((len(near.phi), 2), np.int32), np.zeros((len(near.phi), TOUCHING))
            g = self.soft.grid
            couple(
                int(not body.fixed), g.cell, REACH * g.cell, self.soft.least_mass, int(g.shape[1]), int(g.shape[2]),
                self.frame(index), near.span, near.phi, near.normal, self.soft.owner, self.soft.material,
                self.friction[index], self.rigid.mass_matrix(index), g.node, q, self.work, self.number,
                self.touching, self.last_change, out,
            )  # fmt: skip
            self._watch(index, float(self.last_change[0]))
            if not body.fixed:
                self.rigid.set_velocity(index, q)
            for part in np.flatnonzero(out[:, LOAD] > 0.0).tolist():
                received = Exchange.of(out[part])
                self._add(index, part, received)
                self.loaded.append((index, part, received))

    def _watch(self, index: int, change: float) -> None:
        """Remember an exchange that did not settle."""
        if change > SETTLED:
            one = self.unsettled.setdefault(index, Unsettled())
            one.count += 1
            one.largest_change = max(one.largest_change, change)

    def warnings(self) -> list[str]:
        """Rigid bodies of which some exchange did not settle."""
        return [
            f"mls: {self.model.bodies[i].name!r}: in {one.count} steps contact and friction did not settle with the "
            f"body's velocity, which still changed by up to {one.largest_change:.1g} of itself; compare with method tl"
            for i, one in self.unsettled.items()
        ]

    def hand_over_impulses(self) -> dict[tuple[int, int], PairImpulse]:
        """What was summed up since this was last asked for, by rigid body and soft part; sums begin anew."""
        impulses, self.impulses = self.impulses, {}
        return impulses

    def damp(self, dt: float) -> None:
        """Dashpot and rolling resistance of the pairs that the last exchange loaded, once particles have moved."""
        for index, part, received in self.loaded:
            self._damp(index, part, received, dt)

    def _add(self, index: int, part: int, received: Exchange) -> None:
        pair = self.impulses.setdefault((index, part), PairImpulse())
        pair.load += received.load
        pair.impulse = pair.impulse + received.impulse
        pair.along_normal = pair.along_normal + received.along_normal

    def _damp(self, index: int, part: int, received: Exchange, dt: float) -> None:
        """Dashpot and rolling resistance between the rigid motions of a pair, both taken implicitly."""
        one, two = self.model.bodies[index], self.model.bodies[self.soft.index[part]]
        if one.fixed and two.fixed:
            return
        center = self.rigid.state.center[index]
        of_rigid = np.zeros((6, 6)) if one.fixed else np.linalg.inv(self.rigid.mass_matrix(index))
        of_soft = self.soft.inverse_mass(part, center)
        drag = self.dashpot[index, part] * dt * received.normal_matrix / received.load
        before = self.rigid.velocity(index) - self.soft.velocity(part, center)
        after = np.linalg.solve(np.eye(6) + (of_rigid + of_soft) @ drag, before)
        impulse = -drag @ after
        length = float(np.sqrt(one.rolling_resistance * two.rolling_resistance))
        spin = float(np.linalg.norm(after[3:]))
        if length > 0.0 and spin > 0.0:
            axis = after[3:] / spin
            stopping = spin / float(axis @ (of_rigid + of_soft)[3:, 3:] @ axis)
            impulse[3:] -= min(length * received.load, stopping) * axis
        if not one.fixed:
            self.rigid.set_velocity(index, self.rigid.velocity(index) + of_rigid @ impulse)
        if not two.fixed:
            own = of_soft @ -impulse
            arm = self.soft.motion(part).center - center
            own[:3] += np.cross(own[3:], arm)
            self.soft.add_rigid_motion(part, own)

    def _field(self, index: int) -> NodeDistances | None:
        """Distances at the nodes in the body's box; those of a fixed body are kept."""
        if index in self.fixed_distances:
            return self.fixed_distances[index]
        body, g = self.model.bodies[index], self.soft.grid
        span, near = self.span(index, REACH), None
        if span is not None:
            count = int(span[1].prod())
            near = NodeDistances(span, np.zeros(count), np.zeros((count, 3)))
            grid: SignedDistance = body.distance
            distance_at_nodes(
                g.cell, int(g.shape[1]), int(g.shape[2]), self.frame(index), span,
                -1.0 if body.fixed else self.soft.least_mass, self.soft.held, g.node, grid.spacing, grid.values,
                near.phi, near.normal,
            )  # fmt: skip
        if body.fixed:
            self.fixed_distances[index] = near
        return near

    def span(self, index: int, reach: float) -> NDArray[np.int32] | None:
        """First node and count along x, y, z of the grid's part within `reach` cells of a body's box, None if empty."""
        body, g = self.model.bodies[index], self.soft.grid
        surface = body.vertices if body.fixed else self.rigid.surface(index)
        first = np.floor((surface.min(axis=0) - g.low) / g.cell - reach).astype(np.int64)
        last = np.ceil((surface.max(axis=0) - g.low) / g.cell + reach).astype(np.int64)
        first, last = np.maximum(first, 0), np.minimum(last, g.shape - 1)
        return np.stack([first, last - first + 1]).astype(np.int32) if (last >= first).all() else None

    def frame(self, index: int) -> Array:
        """Where the grid and a rigid body are, as kernels ask for it, shape (7, 3)."""
        body, state = self.model.bodies[index], self.rigid.state
        rows = [self.soft.grid.low, state.center[index], body.center_of_mass, body.distance.origin]
        return np.concatenate([np.stack(rows), state.rotation[index]])


def dashpot_coefficient(model: Model, first: int, second: int, config: SolverConfig) -> float:
    """Critical damping [N s/m] of a pair's bounce: 2 zeta sqrt(k m), k the Hertz stiffness of the lighter moving body
    on the softer of the two."""
    pair = model.bodies[first], model.bodies[second]
    free = [b for b in pair if not b.fixed]
    if not free:
        return 0.0
    mass = 1.0 / sum(1.0 / b.mass for b in free)
    lighter = min(free, key=lambda b: b.mass)
    young, poisson = min(softness(b) for b in pair if isinstance(b, SoftBody))
    stiffness = contact_stiffness(lighter.mass * model.gravity_strength, footprint_radius(lighter), young, poisson)
    return 2.0 * config.damping_ratio * float(np.sqrt(stiffness * mass))


def footprint_radius(body: Body) -> float:
    """A quarter of the sum of the horizontal sides [m]: the radius of a ball."""
    extent = np.ptp(body.vertices, axis=0)
    return 0.25 * float(extent[0] + extent[1])


def softness(body: SoftBody) -> tuple[float, float]:
    """Smallest Young's modulus [Pa] of a soft body and the Poisson ratio there."""
    at = int(np.argmin(body.interior.youngs_modulus))
    return float(body.interior.youngs_modulus[at]), float(body.interior.poisson_ratio[at])
