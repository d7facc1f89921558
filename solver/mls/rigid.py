"""Rigid bodies between the grid's steps: motion, contact with each other, and mean forces.

Contact between rigid bodies is the penalty law of solver.contact (springs at surface points, friction with memory,
rolling resistance), applied by one linearly implicit Euler step per substep [B98]: with K = -df/dx of the springs and
damping beta K,

    (M + dt (dt + beta) K) (q' - q) = dt (f(x + dt q) - beta K q)

so that a light body under a heavy one stays stable at any substep. beta damps a body of its own weight on its springs
critically, omega = sqrt(g / penetration target).

[B98] Baraff, Witkin: Large steps in cloth simulation. SIGGRAPH 1998.

Mean forces on bodies over an interval of explicit steps.
"""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np

from solver.arrays import Array
from solver.certificate import PointForces
from solver.config import SolverConfig
from solver.contact.active import Contacts, Pair, TouchingPoints, vertex_areas
from solver.contact.bonds import BondedPair
from solver.contact.friction import PairFriction
from solver.contact.query import ContactQuery
from solver.model import soft as soft_system
from solver.model.bodies import Model, RigidBody, free_motions
from solver.model.state import ContactMemory, State, cross_matrix, rotate, start_state

NEAR = 0.02  # rigid bodies whose bounding spheres are farther apart than this [m] are not checked


class RigidBodies:
    """All rigid bodies of a model and their state."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        self.model = model
        self.bodies: dict[int, RigidBody] = dict(model.rigid_bodies)
        self.index = list(self.bodies)
        self.free = [i for i in self.index if not model.bodies[i].fixed]
        no_soft = soft_system.empty()
        self.query = ContactQuery(model, no_soft, rigid_pairs(model, config))
        self.state: State = start_state(model, no_soft)
        self.state.memory = self.query.fresh_memory()
        self.contacts: Contacts | None = None
        self.radius = {
            i: float(np.linalg.norm(b.vertices - b.center_of_mass, axis=1).max()) for i, b in model.rigid_bodies
        }
        self.box = {i: (b.vertices.min(axis=0), b.vertices.max(axis=0)) for i, b in model.rigid_bodies}
        self.damping = 2.0 * config.damping_ratio * float(np.sqrt(config.penetration_target / model.gravity_strength))

    def mass_matrix(self, index: int) -> Array:
        """Mass and inertia about the centre of mass in world axes, shape (6, 6)."""
        body, rotation = self.bodies[index], self.state.rotation[index]
        out = np.zeros((6, 6))
        out[:3, :3] = body.mass * np.eye(3)
        out[3:, 3:] = rotation @ body.inertia @ rotation.T
        return out

    def velocity(self, index: int) -> Array:
        """Velocity (V, w), shape (6,); zero for a fixed body."""
        if self.model.bodies[index].fixed:
            return np.zeros(6)
        return np.concatenate([self.state.velocity[index], self.state.angular_velocity[index]])

    def set_velocity(self, index: int, q: Array) -> None:
        """Set (V, w), restricted to the motions that the body may do."""
        q = q * free_motions(self.bodies[index])
        self.state.velocity[index], self.state.angular_velocity[index] = q[:3], q[3:]

    def accelerate(self, dt: float) -> None:
        """Apply gravity and the forces between rigid bodies."""
        for i in self.free:
            movable = free_motions(self.bodies[i])
            self.state.velocity[i] = self.state.velocity[i] + dt * self.model.gravity * movable[:3]
        self.contacts = None
        if any(self._near(p.a, p.b) for p in self.query.pairs if p.a < p.b or self.model.bodies[p.b].fixed):
            self._push(dt)

    def _near(self, a: int, b: int) -> bool:
        """Return whether the sphere around a comes near the sphere, or the fixed box, around b."""
        one, two = self.model.bodies[a], self.model.bodies[b]
        if one.fixed:
            return self._near(b, a) if not two.fixed else False
        center = self.state.center[a]
        if two.fixed:
            low, high = self.box[b]
            gap = float(np.linalg.norm(center - np.clip(center, low, high))) - self.radius[a]
        else:
            gap = float(np.linalg.norm(center - self.state.center[b])) - self.radius[a] - self.radius[b]
        return gap < NEAR

    def _push(self, dt: float) -> None:
        """Take one linearly implicit step of the springs between rigid bodies."""
        # springs are evaluated at the predicted end of the step, so slip is that of this step
        ahead = self.state.copy()
        self._move(ahead, dt)
        contacts = self.query.find(ahead, self.query.begin(self.state, dt))
        self.contacts = contacts
        self.state.memory = contacts.memory
        if not contacts.active:
            return
        row = {i: 6 * k for k, i in enumerate(self.free)}
        count = 6 * len(self.free)
        mass, K, f = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count)
        q = np.concatenate([self.velocity(i) for i in self.free])
        for i in self.free:
            mass[row[i] : row[i] + 6, row[i] : row[i] + 6] = self.mass_matrix(i)
        arms = {}
        for side, sign in ((contacts.a, 1.0), (contacts.b, -1.0)):
            for i in self.free:
                at = np.flatnonzero(side == i)
                if len(at):
                    arm = cross_matrix(contacts.position[at] - ahead.center[i])
                    G = np.concatenate([np.tile(np.eye(3), (len(at), 1, 1)), -arm], axis=2)  # v = G (V, w)
                    arms[i, sign] = (at, sign * G)
        for (i, _), (at, G) in arms.items():
            f[row[i] : row[i] + 6] += np.einsum("kij,ki->j", G, contacts.force[at])
            for (j, _), (also, H) in arms.items():
                both, mine, other = np.intersect1d(at, also, return_indices=True)
                if len(both):
                    block = np.einsum("kia,kij,kjb->ab", G[mine], contacts.tangent[both], H[other])
                    K[row[i] : row[i] + 6, row[j] : row[j] + 6] += block
        for r in contacts.rolling:
            for body, sign in ((r.a, 1.0), (r.b, -1.0)):
                if body in row:
                    turn = slice(row[body] + 3, row[body] + 6)
                    f[turn] += sign * r.torque
                    K[turn, turn] += r.tangent
        after = q + np.linalg.solve(mass + dt * (dt + self.damping) * K, dt * (f - self.damping * K @ q))
        slip = np.zeros((2, len(contacts.force), 3))
        for (i, _), (at, G) in arms.items():
            for speed, end in zip(slip, (q, after), strict=True):
                speed[at] += np.einsum("kij,j->ki", G, end[row[i] : row[i] + 6])
        self.state.memory = _end_anchors(contacts, dt * (slip[1] - slip[0]))
        moved = dt * (slip[1] - slip[0]) + self.damping * slip[1]
        self.contacts = acted(contacts, contacts.force - np.einsum("kij,kj->ki", contacts.tangent, moved))
        for i in self.free:
            self.set_velocity(i, after[row[i] : row[i] + 6])

    def move(self, dt: float) -> None:
        """Update positions and rotations by the step; a free turn keeps its angular momentum."""
        self._move(self.state, dt)

    def _move(self, state: State, dt: float) -> None:
        for i in self.free:
            inertia = self.bodies[i].inertia
            momentum = state.rotation[i] @ inertia @ state.rotation[i].T @ state.angular_velocity[i]
            state.center[i] = state.center[i] + dt * state.velocity[i]
            state.rotation[i] = rotate(state.rotation[i], dt * state.angular_velocity[i])
            turned = state.rotation[i] @ inertia @ state.rotation[i].T
            state.angular_velocity[i] = np.linalg.solve(turned, momentum)

    def surface(self, index: int) -> Array:
        """World positions of a body's surface points [m], shape (n, 3)."""
        return self.query.surface(self.state, index)


def acted(contacts: Contacts, force: Array) -> Contacts:
    """The contacts with the forces (k, 3) [N] that result from an implicit step."""
    ends = np.cumsum([len(t.point) for t in contacts.active])
    parts = np.split(force, ends[:-1])
    active = tuple(replace(t, force=part) for t, part in zip(contacts.active, parts, strict=True))
    return replace(contacts, active=active, force=force)


def _end_anchors(contacts: Contacts, ahead: Array) -> ContactMemory:
    """Memory with friction's anchors at the end of a step: anchors of sticking points follow the step's result, which
    is `ahead` (k, 3) [m] of the place where the springs were evaluated; otherwise a body would creep to make up for the
    difference."""
    first, points = 0, dict(contacts.memory.points)
    for t in contacts.active:
        more = ahead[first : first + len(t.point)]
        first += len(t.point)
        along = more - (more * t.normal).sum(axis=1, keepdims=True) * t.normal
        old = points[t.pair.key]
        anchor = old.anchor.copy()
        anchor[t.point] = np.where(t.sliding[:, None], t.anchor, t.anchor + along)
        points[t.pair.key] = replace(old, anchor=anchor)
    return replace(contacts.memory, points=points)


def rigid_pairs(model: Model, config: SolverConfig) -> list[Pair]:
    """Ordered pairs of rigid bodies with at least one movable body; three points carry the weight at the penetration
    target."""
    gravity = max(float(np.linalg.norm(model.gravity)), 1.0)
    out = []
    for (a, one), (b, two) in permutations(model.rigid_bodies, 2):
        if not (one.fixed and two.fixed):
            load = max(body.mass for body in (one, two) if not body.fixed) * gravity
            count = len(one.vertices)
            stiffness = np.full(count, load / (3.0 * config.penetration_target))
            out.append(Pair(a, b, PairFriction.of(model, one, two), stiffness, vertex_areas(one)))
    return out


@dataclass(frozen=True, eq=False, slots=True)
class ContactReport:
    """Mean forces over an interval."""

    touching: list[TouchingPoints]
    bonded: list[tuple[BondedPair, Array, Array, Array]]
    """Bond, positions, mean forces on its first body, and stretches, shape (k, 3) each."""

    def pairs(self) -> set[tuple[int, int]]:
        """Bodies that hold each other, lower index first."""
        found = [one.pair.key for one in self.touching] + [(bond.a.body, bond.b.body) for bond, *_ in self.bonded]
        return {(min(key), max(key)) for key in found}

    def forces(self) -> PointForces:
        """All forces of contacts and bonds, point by point."""
        some = [(*t.pair.key, t.position, t.force, False) for t in self.touching]
        some += [(bond.a.body, bond.b.body, position, force, True) for bond, position, force, _ in self.bonded]
        count = [len(one[3]) for one in some]
        a, b, bonded = (np.repeat(np.array([one[k] for one in some], dtype=kind), count)
                        for k, kind in ((0, np.int64), (1, np.int64), (4, np.bool_)))  # fmt: skip
        position, force = (np.concatenate([np.zeros((0, 3)), *(one[k] for one in some)]) for k in (2, 3))
        return PointForces(a, b, position, force, bonded)
