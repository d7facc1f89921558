"""Drop to rest with explicit MLS-MPM: the step, the damping on the way to rest, and when it stops.

One step [H18, Alg. 1 with its Sec. 5 for rigid bodies]:

    particles to grid -> node velocities -> rigid bodies act on nodes -> grid to particles -> rigid bodies move

The motion of a free body as a whole (falling, sliding, rolling) is never damped. What is damped: the strain motion of
every soft body, by kinetic damping [B99] (at each peak of its kinetic energy relative to its rigid motion that part
is taken away: the peak is where it passes its equilibrium), and the bounce of a touching pair (coupling.py,
soft_pairs.py).

[H18] Hu et al.: A moving least squares material point method ... SIGGRAPH 2018.
[B99] Barnes: Form finding and analysis of tension structures by dynamic relaxation. Int. J. Space Struct. 14, 1999.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.certificate import NotDone, Verdict
from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from solver.frames import FrameRecorder
from solver.kernels import mls_transfers as transfers
from solver.kernels.mls_moments import ENERGY, INVERSIONS, SQUARED_SPEED, STRAYS
from solver.mls.bodies import SoftBodies
from solver.mls.coupling import Coupling
from solver.mls.material import material_states
from solver.mls.outcome import IntervalImpulses, IntervalReport, measure_interval
from solver.mls.particles import PER_AXIS
from solver.mls.plates import THIN, Plates, thin_bodies
from solver.mls.rigid import RigidBodies
from solver.mls.soft_pairs import SoftPairs
from solver.model.bodies import Body, Model
from solver.rest import Progress, RestMonitor
from solver.result import FinalState, SettledModel, beside, build_result, carried

Array = NDArray[np.float64]

PEAK_DROP = 0.02  # a kinetic energy this much below its largest value has passed its peak [-]
COARSENING = 1.1  # factor by which a cell grows until the particles fit their budget
STALE = 0.01  # motion in cells after which contact looks anew where the material is: a tenth of what it resolves
TOLD_APART = {
    True: "material is on one of its sides there and does not feel what lies on the other (CPIC)",
    False: "material feels what lies behind it, and may leak through, because cpic is off",
}
LEAST_THROUGH = 3  # particles through the smallest side below which a part is named as under-resolved (the paper's)


class ExplicitDrop:
    """One simulation from start to verdict."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        self.model, self.config = model, config
        self.warnings: list[str] = []
        if not model.soft_bodies:
            raise ModelError("mls: every body is rigid; there is no material to simulate; use method tl")
        if model.bonds:
            raise ModelError("mls: bonds are not supported; use method tl")
        if config.inertia:
            raise ModelError("mls: inertia is not supported, strain motion is relaxed; use method tl")
        layered = ", ".join(repr(b.name) for _, b in model.soft_bodies if b.interior.layers is not None)
        for _, b in model.soft_bodies:
            if b.interior.layers is not None and not (np.abs(b.interior.poisson_ratio) < 0.5).all():
                raise ModelError(
                    f"mls: {b.name!r}: layers are left out, and without them a Poisson ratio across layers of "
                    f"{np.abs(b.interior.poisson_ratio).max():g} is not possible; use method tl"
                )
        if layered:
            self.warnings.append(f"mls: {layered}: layers are left out, the material is taken as isotropic")
        self.gravity = np.asarray(model.gravity, dtype=np.float64)
        cell = choose_cell(model, config, self.warnings)
        thin = thin_bodies(model, cell)
        self.soft = SoftBodies(model, cell, thin=config.cpic and bool(thin))
        self.rigid = RigidBodies(model, config)
        self.coupling = Coupling(model, self.soft, self.rigid, config)
        self.soft_pairs = SoftPairs(model, self.soft, config)
        self.plates = Plates(model, self.soft, self.rigid, self.coupling, thin)
        if thin:
            names = ", ".join(repr(model.bodies[i].name) for i in thin)
            self.warnings.append(f"mls: {names}: thinner than {THIN:.0f} cells in places; {TOLD_APART[config.cpic]}")
        self.free = [i for i, b in enumerate(model.bodies) if not b.fixed]
        self.watched = self.free or self.soft.index
        self.length = max(model.bodies[i].size for i in self.watched)
        self.peak = np.zeros(len(self.soft.index))
        self.time = 0.0
        self.moved = self._sides_unknown()
        self.monitor = RestMonitor(config, model.gravity_strength, self.length)
        self.steps = 0
        self.recorder = FrameRecorder(model.bodies, self.length)
        self._refuse_overlap()
        self._name_thin_parts()

    def run(self, progress: Progress | None) -> SettledModel:
        """Intervals until quiet, left, or out of budget."""
        while True:
            last = self._interval()
            self.monitor.record(last.signals, progress)
            self.recorder.note(self.time, last.bodies)
            if self._left(last.impulses):
                verdict = Verdict.LEFT_TARGET
            elif self.monitor.quiet():
                verdict = Verdict.AT_REST
            elif len(self.monitor.signals) >= self.config.step_limit:
                verdict = Verdict.NO_EQUILIBRIUM
            else:
                continue
            return self._result(verdict, last)

    def _interval(self) -> IntervalReport:
        """Steps over one interval, and what they did to every body."""
        seconds = self.config.mls_interval_seconds
        before = self._momenta()
        left, steps = seconds, 0
        while left > 1e-9 * seconds:
            dt = left / np.ceil(left / self._longest_step())
            self.step(float(dt))
            left -= dt
            steps += 1
        self.steps += steps
        impulses = IntervalImpulses(self.coupling.hand_over_impulses(), self.rigid.hand_over_impulses())
        return measure_interval(self.model, self.soft, self.rigid, impulses, self.watched, before, self._momenta(),
                       seconds, self.time, steps)  # fmt: skip

    def _longest_step(self) -> float:
        """CFL: neither a wave nor a particle crosses more than a share of a cell [s]."""
        speeds = [self.soft.fastest]
        speeds += [float(np.linalg.norm(self.rigid.state.velocity[i])) for i in self.rigid.free]
        return self.config.mls_cfl * self.soft.grid.cell / (self.soft.wave_speed + max(speeds))

    def step(self, dt: float) -> None:
        """Advance everything in place by dt [s] (decision 039); raises UnstableStep for a state that broke."""
        soft, grid, p = self.soft, self.soft.grid, self.soft.particles
        C, F = p.C.reshape(-1, 3, 3), p.F.reshape(-1, 3, 3)
        self.rigid.accelerate(dt)
        transfers.clear(grid.node)
        self.plates.find_sides()
        for pencils in grid.colours:
            transfers.particles_to_grid(
                soft.thin,
                p.side,
                soft.node_side,
                dt,
                *grid.box,
                pencils,
                grid.pencil_start,
                p.x,
                p.v,
                C,
                F,
                p.constant,
                self.gravity,
                grid.node,
            )
        transfers.momentum_to_velocity(soft.least_mass, soft.held, grid.node)
        self._locate_material(dt)
        self.coupling.exchange()
        h, x, y, z, nodes_y, nodes_z = grid.box
        transfers.grid_to_particles(
            soft.thin, p.side, soft.node_side, p.group, *self.plates.motion(), dt, h, x, y, z,
            int(grid.shape[0]), nodes_y, nodes_z, grid.node, grid.block, p.x, p.v, C, F, p.constant, soft.sums,
        )  # fmt: skip
        self.time += dt
        self.plates.take_impulses()
        self._check(dt)
        self.coupling.damp(dt)
        self.soft_pairs.damp(dt)
        self._damp_strain()
        self._stiffen_cores()
        self.rigid.move(dt)

    def _locate_material(self, dt: float) -> None:
        """Renew where the nodes' material lies once it has moved by STALE cells."""
        self.moved += dt * self.soft.fastest
        if self.moved > STALE * self.soft.grid.cell:
            self.soft.locate_material()
            self.moved = 0.0

    def _sides_unknown(self) -> float:
        """`moved` on a grid just laid out: its material was located without sides, and is again once they are found."""
        return np.inf if self.soft.thin else 0.0

    def _check(self, dt: float) -> None:
        """Raise UnstableStep for what cannot go on; lay the grid out anew where particles have left their pencils."""
        soft = self.soft
        total = soft.sums.sum(axis=0)
        where = f"t = {self.time:.5f} s, dt = {dt:.2e} s"
        if not np.isfinite(total).all():
            bad = int(np.flatnonzero(~np.isfinite(soft.sums).all(axis=1))[0])
            name = self.model.bodies[soft.index[soft.grid.block_group[bad] // 2]].name
            raise UnstableStep(f"{where}: body {name!r} holds values that are not finite; lower mls_cfl")
        fastest = int(np.argmax(soft.sums[:, SQUARED_SPEED]))
        speed = float(np.sqrt(soft.sums[fastest, SQUARED_SPEED]))
        if speed > soft.wave_speed:
            name = self.model.bodies[soft.index[soft.grid.block_group[fastest] // 2]].name
            raise UnstableStep(
                f"{where}: a particle of body {name!r} moves at {speed:.3g} m/s, faster than its waves "
                f"({soft.wave_speed:.3g} m/s); lower mls_cfl ({self.config.mls_cfl})"
            )
        if total[STRAYS] > 0.0:
            soft.lay_out()
            self.moved = self._sides_unknown()
            self.coupling.discard_distances()

    def _damp_strain(self) -> None:
        """Kinetic damping of every soft body's motion relative to its own rigid motion."""
        for part in range(len(self.soft.index)):
            motion = None if self.soft.is_fixed(part) else self.soft.motion(part)
            if motion is None:
                energy = float((self.soft.group_sums(2 * part) + self.soft.group_sums(2 * part + 1))[ENERGY])
            else:
                energy = motion.strain_motion_energy
            if energy < (1.0 - PEAK_DROP) * self.peak[part]:
                self.soft.move(2 * part, keep=0.0, old=motion)
                self.peak[part] = 0.0
            else:
                self.peak[part] = max(self.peak[part], energy)

    def _stiffen_cores(self) -> None:
        """A rigid core moves as one: its particles take their common rigid motion."""
        for part in self.soft.cores:
            self.soft.make_rigid(2 * part + 1)

    def _momenta(self) -> dict[int, tuple[Array, Array, Array]]:
        """Centre, momentum and angular momentum about the centre of every watched body."""
        out = {}
        for i in self.watched:
            if i in self.rigid.index:
                q = self.rigid.mass_matrix(i) @ self.rigid.velocity(i)
                out[i] = (self.rigid.state.center[i].copy(), q[:3], q[3:])
            else:
                m = self.soft.motion(self.soft.index.index(i))
                out[i] = (m.center, m.mass * m.velocity, m.angular_momentum)
        return out

    def _left(self, impulses: IntervalImpulses) -> bool:
        """A free body has left everything that could carry it."""
        pairs = set(impulses.rigid)
        pairs |= {(r, self.soft.index[s]) for r, s in impulses.coupled}
        pairs |= {(self.soft.index[a], self.soft.index[b]) for a, b in self.soft.touching_parts()}
        for i in set(self.free) - carried(self.model, pairs):
            if i in self.rigid.index:
                surface, center = self.rigid.surface(i), self.rigid.state.center[i]
            else:
                part = self.soft.index.index(i)
                surface, center = self.soft.surface(part), self.soft.motion(part).center
            if beside(self.model, surface, center):
                return True
        return False

    def _refuse_overlap(self) -> None:
        for part, i in enumerate(self.soft.index):
            points = self.soft.start[self.soft.part == part]
            for j, other in enumerate(self.model.bodies):
                inside = points[_within(points, other)]
                if j == i or (other.fixed and self.model.bodies[i].fixed) or not len(inside):
                    continue
                depth = float(-other.distance.at(inside).min())
                if depth > self.config.start_overlap:
                    raise ModelError(
                        f"bodies {self.model.bodies[i].name!r} and {other.name!r} start {1e3 * depth:.1f} mm inside "
                        f"each other (bound start_overlap = {1e3 * self.config.start_overlap:.1f} mm); move one of them"
                    )

    def _name_thin_parts(self) -> None:
        spacing = self.soft.grid.cell / PER_AXIS
        for i in self.soft.index:
            body = self.model.bodies[i]
            through = float(np.ptp(body.vertices, axis=0).min()) / spacing
            if through < LEAST_THROUGH:
                self.warnings.append(
                    f"body {body.name!r} has {through:.1f} particles through its smallest side, {LEAST_THROUGH} are "
                    "the least that carries bending; lower mls_cell"
                )

    def _result(self, verdict: Verdict, last: IntervalReport) -> SettledModel:
        rows, final = self.monitor.rows(), self._final(last)
        warnings = [*self.warnings, *self.coupling.warnings(), *self.plates.warnings(), *last.warnings()]
        self.recorder.note(self.time, lambda: final.bodies, last=True)
        frames = self.recorder.frames()
        result = build_result(verdict, final, self.monitor, rows, NotDone(), self.config, warnings, frames)
        certificate = replace(
            result.certificate,
            method="mls",
            cell_m=self.soft.grid.cell,
            substeps=self.steps,
            interval_s=self.config.mls_interval_seconds,
        )
        return replace(result, certificate=certificate, material=material_states(self.soft))

    def _final(self, last: IntervalReport) -> FinalState:
        """What the result says of the last state."""
        contacts, points = last.contacts()
        free = {self.model.bodies[i].name for i in self.free}
        return FinalState(
            seconds=self.time,
            bodies=last.bodies(),
            contacts=contacts,
            contact_points={name: some for name, some in points.items() if name in free},
            friction_margin=last.friction_margin(contacts),
            free_weight=sum(last.mass(i) for i in self.watched) * self.model.gravity_strength,
            inverted=int(self.soft.sums[:, INVERSIONS].sum()),
            particles=len(self.soft.start),
        )


def _within(points: Array, body: Body) -> NDArray[np.bool_]:
    """Points in the box of a body's samples, shape (n,)."""
    grid = body.distance
    high = grid.origin + grid.spacing * (np.array(grid.values.shape) - 1)
    return np.asarray(((points >= grid.origin) & (points <= high)).all(axis=1))


def choose_cell(model: Model, config: SolverConfig, warnings: list[str]) -> float:
    """The cell of the uniform grid [m]: as asked, else the soft bodies' smallest, coarsened to the particle budget."""
    if config.mls_cell is not None:
        return float(config.mls_cell)
    parts = [b.interior for _, b in model.soft_bodies]
    finest = min(max(float(np.diff(p).min()) for p in s.planes) for s in parts)
    volume = sum(float(s.volume.sum()) for s in parts)
    cell = finest
    while PER_AXIS**3 * volume / cell**3 > config.mls_particles:
        cell *= COARSENING
    if cell > finest:
        warnings.append(
            f"mls: cells of {1e3 * cell:.1f} mm instead of {1e3 * finest:.1f} mm, so that {config.mls_particles} "
            "particles suffice (mls_particles); depths are known to about a cell"
        )
    return cell
