"""What one interval of steps did to every body: the signals, and at the end the contacts and the rest state.

Forces are impulses over the interval's length. The unbalanced force on a body is the change of its momentum over the
same time, so nothing that acted on it is left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.certificate import ContactRow
from solver.contact.active import vertex_areas
from solver.mls.bodies import SoftBodies
from solver.mls.coupling import PairImpulse
from solver.mls.rigid import RigidBodies
from solver.mls.soft_pairs import soft_contact
from solver.model.bodies import Model, RigidBody, SoftBody
from solver.model.state import best_rigid_motion
from solver.rest import Signals
from solver.result import RestBody

Array = NDArray[np.float64]
Momentum = tuple[Array, Array, Array]

PATCH = 0.25  # surface points of a touching pair nearer than so many cells belong to its contact: MPM bodies rest apart


@dataclass(frozen=True, eq=False, slots=True)
class IntervalImpulses:
    """What pairs of bodies exchanged over an interval."""

    coupled: Mapping[tuple[int, int], PairImpulse]
    """On soft bodies, by rigid body and soft part."""
    rigid: Mapping[tuple[int, int], Array]
    """On the first of two rigid bodies: impulse and its normal part [N s], shape (2, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class IntervalReport:
    """The end of an interval."""

    model: Model
    soft: SoftBodies
    rigid: RigidBodies
    impulses: IntervalImpulses
    seconds: float
    before: dict[int, Momentum]
    after: dict[int, Momentum]
    signals: Signals

    def mass(self, index: int) -> float:
        """[kg]."""
        return _mass(self.model, self.soft, index)

    def surface(self, index: int) -> Array:
        """Deformed surface points of a body [m], shape (n, 3)."""
        return surface_of(self.model, self.soft, self.rigid, index)

    def bodies(self) -> tuple[RestBody, ...]:
        """The state of every body."""
        out = []
        for i, body in enumerate(self.model.bodies):
            rotation, translation, speed = self._motion(i)
            out.append(RestBody(body.name, self.surface(i), rotation, translation, speed))
        return tuple(out)

    def _motion(self, index: int) -> tuple[Array, Array, float]:
        body = self.model.bodies[index]
        if isinstance(body, RigidBody):
            rotation, center = self.rigid.state.rotation[index], self.rigid.state.center[index]
            q = self.rigid.velocity(index)
            speed = float(np.linalg.norm(q[:3]) + 0.5 * body.size * np.linalg.norm(q[3:]))
            return rotation, center - rotation @ body.center_of_mass, speed
        mine = np.flatnonzero(self.soft.part == self.soft.index.index(index))
        p = self.soft.particles
        speed = float(np.linalg.norm(p.given(p.v)[mine], axis=1).max())
        if body.fixed:
            return np.eye(3), np.zeros(3), speed
        rotation, translation = best_rigid_motion(self.soft.start[mine], p.given(p.x)[mine], self.soft.mass[mine])
        return rotation, translation, speed

    def contacts(self) -> tuple[tuple[ContactRow, ...], dict[str, Array]]:
        """Touching pairs as in SettledModel.contacts, and the contact points of every body."""
        rows: list[ContactRow] = []
        points: dict[str, list[Array]] = {body.name: [] for body in self.model.bodies}
        for a, b, force, normal in [*self._coupled(), *self._shared(), *self._rigid()]:
            size = float(np.linalg.norm(normal))
            if size == 0.0:
                continue
            patch, gap, area = self._patch(a, b)
            for i in (a, b):
                points[self.model.bodies[i].name].append(patch)
            rows.append(
                ContactRow(
                    a=self.model.bodies[a].name,
                    b=self.model.bodies[b].name,
                    area_m2=area,
                    normal_force_n=size,
                    tangential_force_n=float(np.linalg.norm(force - normal)),
                    max_penetration_m=float(max(-gap.min(), 0.0)) if len(gap) else 0.0,
                    max_gap_m=float(max(gap.max(), 0.0)) if len(gap) else 0.0,
                    points=len(patch),
                )
            )
        return tuple(rows), {name: np.concatenate([np.zeros((0, 3)), *some]) for name, some in points.items()}

    def _coupled(self) -> list[tuple[int, int, Array, Array]]:
        """Rigid on soft: force on the soft body and its normal part [N]."""
        out = []
        for (r, part), pair in sorted(self.impulses.coupled.items()):
            i = self.soft.index[part]
            a, b, sign = (r, i, -1.0) if r < i else (i, r, 1.0)
            out.append((a, b, sign * pair.impulse / self.seconds, sign * pair.along_normal / self.seconds))
        return out

    def _shared(self) -> list[tuple[int, int, Array, Array]]:
        """Soft on soft through shared nodes: what is missing in the momentum balance of the free ones.

        Exact where every such pair is needed to balance some body (two bodies, a stack); else the smallest forces
        that do. Their normal part is that along the contact's mean normal, and all of it where there is none.
        """
        pairs = sorted(self.soft.touching_parts())
        movable = [p for p, i in enumerate(self.soft.index) if not self.model.bodies[i].fixed]
        pairs = [(a, b) for a, b in pairs if a in movable or b in movable]
        if not pairs:
            return []
        balance, missing = np.zeros((len(movable), len(pairs))), np.zeros((len(movable), 3))
        for row, part in enumerate(movable):
            i = self.soft.index[part]
            missing[row] = (self.after[i][1] - self.before[i][1]) / self.seconds - self._weight(part)
            missing[row] -= sum(
                (p.impulse / self.seconds for (_, q), p in self.impulses.coupled.items() if q == part), np.zeros(3)
            )
            for column, (a, b) in enumerate(pairs):
                balance[row, column] = 1.0 if part == a else (-1.0 if part == b else 0.0)
        forces = np.linalg.lstsq(balance, missing, rcond=None)[0]
        out = []
        for (a, b), force in zip(pairs, forces, strict=True):
            i, j = self.soft.index[a], self.soft.index[b]
            contact = soft_contact(self.soft, a, b)
            if contact is not None:
                n = contact.normal
                out.append((i, j, force, force if n is None else (force @ n) * n))
        return out

    def warnings(self) -> list[str]:
        """Soft bodies around each other, whose force has no normal part of its own."""
        pairs = [(a, b, soft_contact(self.soft, a, b)) for a, b in sorted(self.soft.touching_parts())]
        names = [self.model.bodies[i].name for i in self.soft.index]
        return [
            f"mls: {names[a]!r} and {names[b]!r}: one is around the other, so their normals have no common direction; "
            "which part of their force is normal is not determined, all of it is given as normal_force_n"
            for a, b, contact in pairs
            if contact is not None and contact.normal is None and not (self.soft.is_fixed(a) and self.soft.is_fixed(b))
        ]

    def _weight(self, part: int) -> Array:
        """What gravity does to the s-th soft body [N], shape (3,)."""
        constant = self.soft.particles.constant[self.soft.particles.group // 2 == part]
        return np.asarray((constant[:, 0] * constant[:, 3]).sum() * self.model.gravity)

    def _rigid(self) -> list[tuple[int, int, Array, Array]]:
        """Rigid on rigid: force on the first and its normal part [N]."""
        pairs = sorted(self.impulses.rigid.items())
        return [(a, b, both[0] / self.seconds, both[1] / self.seconds) for (a, b), both in pairs]

    def _patch(self, a: int, b: int) -> tuple[Array, Array, float]:
        """Surface points of a touching pair that lie on the other body (k, 3), their gaps (k,) [m], and their area."""
        reach = PATCH * self.soft.grid.cell
        if isinstance(self.model.bodies[a], RigidBody):  # ask the soft one: the rigid one's distance is exact
            a, b = b, a
        body, other, points = self.model.bodies[a], self.model.bodies[b], self.surface(a)
        if isinstance(other, RigidBody):
            arm = points - self.rigid.state.center[b]
            gap = other.distance.at(arm @ self.rigid.state.rotation[b] + other.center_of_mass)
        else:
            gap = cKDTree(self.surface(b)).query(points)[0]
        on = np.flatnonzero(gap < reach)
        return points[on], gap[on], float(vertex_areas(body)[on].sum())

    def friction_margin(self, rows: Sequence[ContactRow]) -> float:
        """Smallest share of the static friction cone that is left over the touching pairs [-]; 0: at the cone."""
        bodies = {body.name: body for body in self.model.bodies}
        margins = [1.0]
        for row in rows:
            one, two = bodies[row.a], bodies[row.b]
            limit = self.model.friction(one, two)[0] * row.normal_force_n
            if limit > 0.0 and not (isinstance(one, SoftBody) and isinstance(two, SoftBody)):
                margins.append(1.0 - row.tangential_force_n / limit)
        return min(margins)


def _mass(model: Model, soft: SoftBodies, index: int) -> float:
    return (
        float(soft.mass[soft.part == soft.index.index(index)].sum())
        if index in soft.index
        else (model.bodies[index].mass)
    )


def surface_of(model: Model, soft: SoftBodies, rigid: RigidBodies, index: int) -> Array:
    """Deformed surface points of a body [m], shape (n, 3)."""
    if index in soft.index:
        return soft.surface(soft.index.index(index))
    return model.bodies[index].vertices if model.bodies[index].fixed else rigid.surface(index)


def measure_interval(
    model: Model,
    soft: SoftBodies,
    rigid: RigidBodies,
    impulses: IntervalImpulses,
    watched: list[int],
    before: dict[int, Momentum],
    after: dict[int, Momentum],
    seconds: float,
    time: float,
    steps: int,
) -> IntervalReport:
    """Measure an interval of `steps` steps that ended at `time`."""
    linear = angular = force_worst = torque_worst = 0.0
    mass = {i: _mass(model, soft, i) for i in watched}
    for i in watched:
        linear = max(linear, float(np.linalg.norm(after[i][1])) / mass[i])
        if i in rigid.index:
            angular = max(angular, float(np.linalg.norm(rigid.state.angular_velocity[i])))
        if model.bodies[i].fixed:
            continue
        weight = mass[i] * model.gravity_strength * seconds
        force_worst = max(force_worst, float(np.linalg.norm(after[i][1] - before[i][1])) / weight)
        turn = float(np.linalg.norm(after[i][2] - before[i][2]))
        torque_worst = max(torque_worst, turn / (weight * 0.5 * model.bodies[i].size))
    points = np.concatenate([surface_of(model, soft, rigid, i) for i in watched])
    center = np.sum([mass[i] * after[i][0] for i in watched], axis=0) / sum(mass.values())
    signals = Signals(
        time, linear, angular, soft.fastest, center,
        np.concatenate([points.min(axis=0), points.max(axis=0)]), force_worst, torque_worst, steps, 0,
    )  # fmt: skip
    return IntervalReport(model, soft, rigid, impulses, seconds, before, after, signals)
