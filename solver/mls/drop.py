"""Drop to rest with explicit MLS-MPM: the step, the damping on the way to rest, and the stopping criteria.

Every soft body has its own particles and grid (body.py); bodies interact at their surfaces (contact.py). One step:

    rigid bodies push each other -> surfaces push each other -> particles to grids and back [H18] -> rigid bodies move

The motion of a free body as a whole (falling, sliding, rolling) is never damped. Damped are the strain motion of every
soft body, by kinetic damping [B99] (the kinetic energy relative to the rigid motion is removed at each of its peaks,
where the body passes its equilibrium), and the bounce of a touching pair.

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
[B99] Barnes: Form finding and analysis of tension structures by dynamic relaxation. Int. J. Space Struct. 14, 1999.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from solver.arrays import Array
from solver.certificate import NotDone, PointForces, Verdict
from solver.config import SolverConfig
from solver.contact.active import contact_table, friction_margin, point_forces
from solver.contact.bonds import bond_table
from solver.errors import ModelError
from solver.frames import FrameRecorder
from solver.mls.body import SoftParticles
from solver.mls.contact import SurfaceContacts
from solver.mls.damping import PairDamping
from solver.mls.rigid import ContactReport, RigidBodies
from solver.model import soft as soft_system
from solver.model.bodies import Model, RigidBody
from solver.model.state import best_rigid_motion
from solver.rest import Progress, RestMonitor, Signals
from solver.result import FinalState, RestBody, SettledModel, build_result, carried, has_left

STEP_SHARE = 0.5  # of the longest step for the material: contact may be four times as stiff
LEAST_CELLS = 2.0  # least cells across a contact for its area to be resolved
LEAST_PARTICLES, PER_CELL = 3.0, 2.0
"""Least number of particles through a body, so that it can bend; particles through a cell [-]."""
PEAK_DROP = 0.02  # relative drop below the largest kinetic energy that marks a passed peak [-]


@dataclass(frozen=True, eq=False, slots=True)
class Momentum:
    """Momentum of one body."""

    center: Array
    """Centre of mass [m], shape (3,)."""
    linear: Array
    """Linear momentum [kg m/s], shape (3,)."""
    angular: Array
    """Angular momentum about the centre [kg m^2/s], shape (3,)."""


class ExplicitDrop:
    """One simulation from start to verdict."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        self.model, self.config = model, config
        if not model.soft_bodies:
            raise ModelError("mls: every body is rigid; there is no material to simulate; use method tl")
        if config.inertia:
            raise ModelError("mls: inertia is not supported, strain motion is relaxed; use method tl")
        self.gravity = np.asarray(model.gravity, dtype=np.float64)
        system = soft_system.build(model)
        grids = {one.index: one for one in system.bodies}
        crossing = config.mls_step_seconds / (STEP_SHARE * config.mls_cfl)
        self.soft = {i: SoftParticles(i, body, system, grids[i], crossing) for i, body in model.soft_bodies}
        self.rigid = RigidBodies(model, config)
        self.contacts = SurfaceContacts(model, system, self.soft, self.rigid, config)
        self.damping = PairDamping(
            model,
            self.soft,
            self.rigid,
            self.contacts.query.pairs,
            [one.bond for one in self.contacts.bonds],
            config,
        )
        self.free = [i for i, b in enumerate(model.bodies) if not b.fixed]
        self.watched = self.free or list(self.soft)
        self.mass = {i: self.soft[i].mass if i in self.soft else model.bodies[i].mass for i in self.watched}
        self.length = max(model.bodies[i].size for i in self.watched)
        self.monitor = RestMonitor(config, model.gravity_strength, self.length)
        self.recorder = FrameRecorder(model.bodies, self.length)
        self.time, self.steps = 0.0, 0
        self._refuse_overlap()
        self._refuse_coarse()

    @property
    def cell(self) -> float:
        """Smallest cell of any soft body [m]."""
        return min(one.cell for one in self.soft.values())

    def run(self, progress: Progress | None) -> SettledModel:
        """Run intervals until the bodies are quiet or have left, or the steps are used up."""
        while True:
            report = self._interval(progress)
            self.recorder.note(self.time, self._bodies)
            if self._left(report):
                verdict = Verdict.LEFT_TARGET
            elif self.monitor.quiet():
                verdict = Verdict.AT_REST
            elif len(self.monitor.signals) >= self.config.step_limit:
                verdict = Verdict.NO_EQUILIBRIUM
            else:
                continue
            return self._result(verdict, report)

    def _interval(self, progress: Progress | None) -> ContactReport:
        """Take the steps of one interval; returns the mean forces in it."""
        seconds = self.config.mls_interval_seconds
        before = self._momenta()
        left, steps = seconds, 0
        while left > 1e-9 * seconds:
            dt = left / np.ceil(left / self._longest_step())
            self.step(float(dt))
            left -= dt
            steps += 1
        self.steps += steps
        signals = self._signals(before, self._momenta(), seconds, steps)
        self.monitor.record(signals, progress)
        moving = signals.speed > self.config.moving_speed * np.sqrt(self.model.gravity_strength * self.length)
        self.contacts.stiffen(moving, seconds)
        return self.contacts.hand_over(seconds)

    def _longest_step(self) -> float:
        """Longest step by CFL: neither a wave nor a body crosses more than a share of a cell [s]."""
        return min(self.config.mls_step_seconds, self.config.mls_cfl * self.cell / max(self.contacts.speed(), 1e-12))

    def step(self, dt: float) -> None:
        """Advance everything by dt [s] in place, since no step is undone; raises UnstableStep if the state broke."""
        self.rigid.accelerate(dt)
        self.contacts.act(dt)
        where = f"t = {self.time:.5f} s, dt = {dt:.2e} s"
        for one in self.soft.values():
            one.step(dt, self.gravity)
            one.check(where)
        self.time += dt
        self.damping.damp(self.contacts.acting, dt)
        for one in self.soft.values():
            one.damp_strain(PEAK_DROP)
            one.stiffen_core()
        self.rigid.move(dt)

    def _refuse_overlap(self) -> None:
        """Raise ModelError if bodies begin inside each other."""
        (a, b), gap = self.contacts.deepest()
        if -gap > self.config.start_overlap:
            raise ModelError(
                f"bodies {self.model.bodies[a].name!r} and {self.model.bodies[b].name!r} start {-1e3 * gap:.1f} mm "
                f"inside each other (bound start_overlap = {1e3 * self.config.start_overlap:.1f} mm); move one of them"
            )

    def _refuse_coarse(self) -> None:
        """Raise ModelError for a body with fewer than three particles across, whose bending would not be resolved. Its
        surface may be only its touchable part, so the particles count."""
        for _, body in self.model.soft_bodies:
            for axis, planes in enumerate(body.interior.planes):
                number = np.arange(len(planes))
                half = np.floor(PER_CELL * np.interp(body.interior.position[:, axis], planes, number))
                ends = np.array([half.min(), half.max() + 1.0])
                count = float(np.diff(ends)[0])
                if count < LEAST_PARTICLES:
                    size = float(np.diff(np.interp(ends / PER_CELL, number, planes))[0])
                    raise ModelError(
                        f"mls: {count:.0f} particles across body {body.name!r} ({1e3 * size:.3g} mm along "
                        f"{'xyz'[axis]}), and explicit steps need {LEAST_PARTICLES:g}: give a resolution of "
                        f"{PER_CELL * size / LEAST_PARTICLES:.2g} m or finer, or use method tl"
                    )

    def _momenta(self) -> dict[int, Momentum]:
        """Momenta of all watched bodies."""
        out = {}
        for i in self.watched:
            if i in self.soft:
                m = self.soft[i].motion()
                out[i] = Momentum(m.center, self.mass[i] * m.velocity, m.angular_momentum)
            else:
                q = self.rigid.mass_matrix(i) @ self.rigid.velocity(i)
                out[i] = Momentum(self.rigid.state.center[i].copy(), q[:3], q[3:])
        return out

    def _signals(self, before: dict[int, Momentum], after: dict[int, Momentum], seconds: float, steps: int) -> Signals:
        """Rest signals of an interval. The unbalanced force on a body is its change of momentum over the time, so it
        includes every force. The largest of several values is NaN if one of them is."""
        linear = angular = force_worst = torque_worst = np.float64(0.0)
        for i in self.watched:
            linear = np.maximum(linear, np.linalg.norm(after[i].linear) / self.mass[i])
            if i in self.rigid.index:
                angular = np.maximum(angular, np.linalg.norm(self.rigid.state.angular_velocity[i]))
            if self.model.bodies[i].fixed:
                continue
            weight = self.mass[i] * self.model.gravity_strength * seconds
            force_worst = np.maximum(force_worst, np.linalg.norm(after[i].linear - before[i].linear) / weight)
            turn = float(np.linalg.norm(after[i].angular - before[i].angular))
            torque_worst = np.maximum(torque_worst, turn / (weight * 0.5 * self.model.bodies[i].size))
        points = np.concatenate([self.contacts.surface(i) for i in self.watched])
        center = np.sum([self.mass[i] * after[i].center for i in self.watched], axis=0) / sum(self.mass.values())
        box = np.concatenate([points.min(axis=0), points.max(axis=0)])
        fastest = max(one.fastest for one in self.soft.values())
        # scaled inertia slows strain: such a motion only counts as rest once its energy is as small as that of a rigid
        # motion at the same speed
        energy = sum(one.highest_energy() for one in self.soft.values())
        fastest = max(fastest, float(np.sqrt(2.0 * energy / sum(self.mass.values()))))
        return Signals(
            self.time,
            float(linear),
            float(angular),
            fastest,
            center,
            box,
            float(force_worst),
            float(torque_worst),
            steps,
            0,
        )

    def _left(self, report: ContactReport) -> bool:
        """Return whether a free body has left everything that could carry it."""
        pairs = report.pairs()
        if self.rigid.contacts is not None:
            pairs |= set(zip(self.rigid.contacts.a.tolist(), self.rigid.contacts.b.tolist(), strict=True))
        for i in set(self.free) - carried(self.model, pairs):
            center = self.soft[i].motion().center if i in self.soft else self.rigid.state.center[i]
            if has_left(self.model, self.contacts.surface(i), center):
                return True
        return False

    def _bodies(self) -> tuple[RestBody, ...]:
        """The state of every body."""
        out = []
        for i, body in enumerate(self.model.bodies):
            if isinstance(body, RigidBody):
                rotation, q = self.rigid.state.rotation[i], self.rigid.velocity(i)
                translation = self.rigid.state.center[i] - rotation @ body.center_of_mass
                speed = float(np.linalg.norm(q[:3]) + 0.5 * body.size * np.linalg.norm(q[3:]))
            else:
                one = self.soft[i]
                rotation, translation, speed = np.eye(3), np.zeros(3), one.fastest
                if not body.fixed:
                    mass = one.given(one.constant[:, 0])
                    rotation, translation = best_rigid_motion(one.start, one.given(one.x), mass)
            out.append(RestBody(body.name, self.contacts.surface(i), rotation, translation, speed))
        return tuple(out)

    def _result(self, verdict: Verdict, report: ContactReport) -> SettledModel:
        rows, final = self.monitor.rows(), self._final(report)
        self.recorder.note(self.time, lambda: final.bodies, last=True)
        result = build_result(
            verdict, final, self.monitor, rows, NotDone(), self.config, self._unresolved(final), self.recorder.frames()
        )  # fmt: skip
        certificate = replace(
            result.certificate,
            method="mls",
            cell_m=self.cell,
            bonds=bond_table(self.model, ((bond, force, stretch) for bond, _, force, stretch in report.bonded)) or None,
            substeps=self.steps,
            inertia_scale=max(one.scale for one in self.soft.values()),
            interval_s=self.config.mls_interval_seconds,
        )
        material = {one.body.name: one.material() for one in self.soft.values()}
        return replace(result, certificate=certificate, material=material)

    def _unresolved(self, final: FinalState) -> list[str]:
        """A warning for each contact that is too small for its cells."""
        soft = {one.body.name for one in self.soft.values()}
        return [
            f"the contact of {row.a} and {row.b}, {1e4 * row.area_m2:.2g} cm2, is less than {LEAST_CELLS:g} cells of "
            f"{1e3 * self.cell:.2g} mm across: its area and pressure are not resolved; give a smaller --resolution"
            for row in final.contacts
            if soft & {row.a, row.b} and row.area_m2 < (LEAST_CELLS * self.cell) ** 2
        ]

    def _final(self, report: ContactReport) -> FinalState:
        """Summary of the last state for the result."""
        bodies = self._bodies()
        surfaces = {i: body.vertices for i, body in enumerate(bodies)}
        forces, touching = report.forces(), [*report.touching]
        if self.rigid.contacts is not None:
            forces = joined(forces, point_forces(self.rigid.contacts))
            touching += self.rigid.contacts.active
        points = {
            self.model.bodies[i].name: forces.position[~forces.bonded & ((forces.a == i) | (forces.b == i))]
            for i in self.free
        }
        return FinalState(
            seconds=self.time,
            bodies=bodies,
            contacts=contact_table(self.model, touching, surfaces.__getitem__),
            contact_points=points,
            forces=forces,
            friction_margin=friction_margin(touching),
            free_weight=sum(self.mass.values()) * self.model.gravity_strength,
            inverted=sum(one.inverted for one in self.soft.values()),
            particles=sum(len(one.start) for one in self.soft.values()),
        )


def joined(one: PointForces, other: PointForces) -> PointForces:
    """The forces of both, one after the other."""
    return PointForces(*(np.concatenate([getattr(one, f.name), getattr(other, f.name)]) for f in fields(PointForces)))
