"""Drop to rest: steps until quiet, then a kick to see whether the rest is stable, then the certificate."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from solver import soft as soft_system
from solver.certificate import Signals, certificate, contact_table, measure, rest_rows
from solver.config import SolverConfig
from solver.contact import ContactQuery, Contacts, Pair, vertex_areas
from solver.errors import ModelError, UnstableStep
from solver.mls import drop as mls
from solver.model import Body, Model
from solver.predict import contact_stiffness
from solver.result import AT_REST, LEFT_TARGET, NO_EQUILIBRIUM, RestBody, Result, beside, carried
from solver.runtime import start
from solver.soft import SoftSystem
from solver.state import State, best_rigid_motion, start_state
from solver.step import Stepper, StepReport

Progress = Callable[[int, float, Signals], None]

CELL_STIFFNESS = (
    4.0  # first guess of the contact stiffness per area, in E / cell size; then adapted to the penetration target
)
KICK_NOISE = 0.1  # share of a kick's speed below which growth is the noise of solving to a tolerance
STEP_GROWTH = 1.25  # growth of the step when Newton converges easily


def settle(model: Model, config: SolverConfig, progress: Progress | None = None) -> Result:
    """Let the free bodies of `model` come to rest.

    Returns the rest state with its certificate, or the last state with the verdict that says why it is none.
    Raises ModelError for
    input that cannot be simulated, UnstableStep when a step breaks and ArchError where the kernels cannot run. Same
    model and config: the same bytes for any thread count.
    """
    start(config.threads, config.arch)
    with threadpool_limits(1):  # dense factorisations would round differently with the number of threads
        result = (mls.Drop if config.method == "mls" else Drop)(model, config).run(progress)
    return replace(result, certificate={"arch": config.arch} | result.certificate)


class Drop:
    """One simulation from start to verdict."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        self.model = model
        self.config = config
        self.soft = soft_system.build(model)
        self.free = [i for i, b in enumerate(model.bodies) if not b.fixed]
        self.watched = self.free or [s.index for s in self.soft.bodies]
        self.mass = {i: self._mass(i) for i in self.watched}
        self.gravity = float(np.linalg.norm(model.gravity))
        if not self.watched:
            raise ModelError("nothing can move: every body is rigid and fixed")
        self.length = max(model.bodies[i].size for i in self.watched)
        self.weight = sum(self.mass.values()) * max(self.gravity, 1e-12)
        self.query = ContactQuery(model, self.soft, contact_pairs(model, self.soft, config, self.gravity))
        self.stepper = Stepper(model, self.soft, self.query, config, self.weight)
        self.stepper.damping = predicted_damping(model, config, {i: self.mass[i] for i in self.free}, self.gravity)
        self.history: list[Signals] = []
        self.warnings: list[str] = []

    def _mass(self, index: int) -> float:
        for s in self.soft.bodies:
            if s.index == index:
                return float(self.soft.mass[s.nodes].sum())
        return self.model.bodies[index].mass

    def run(self, progress: Progress | None) -> Result:
        """Approach, rest, kick, verdict."""
        state = start_state(self.model, self.soft)
        self._refuse_overlap(state)
        verdict, state, report = self._approach(state, progress)
        kick: dict[str, object] = {"done": False}
        rows = self._rows(self.history[-self.config.rest_steps :])
        if verdict == AT_REST and self.free:
            stable, kick = self._verify(state, progress)
            if not stable:
                verdict, state, report, rows, kick = self._after_failed_kick(kick, progress)
        return self._result(verdict, state, report, rows, kick)

    def _refuse_overlap(self, state: State) -> None:
        for t in self.query.find(state, state).touching:
            depth = float(-t.gap.min())
            if depth > self.config.start_overlap:
                a, b = self.model.bodies[t.pair.a].name, self.model.bodies[t.pair.b].name
                raise ModelError(
                    f"bodies {a!r} and {b!r} start {1e3 * depth:.1f} mm inside each other near "
                    f"{np.round(t.position[int(np.argmin(t.gap))], 3).tolist()} (bound start_overlap = "
                    f"{1e3 * self.config.start_overlap:.1f} mm); move one of them"
                )

    def _approach(
        self, state: State, progress: Progress | None, dt: float | None = None
    ) -> tuple[str, State, StepReport]:
        dt = dt or self.config.step_seconds
        while True:
            state, report, dt = self._step(state, dt)
            signals = self._record(state, report, progress)
            if self._left(state, report.contacts):
                return LEFT_TARGET, state, report
            if self._quiet():
                return AT_REST, state, report
            if len(self.history) >= self.config.step_limit:
                return NO_EQUILIBRIUM, state, report
            self._adapt(report.contacts, signals)

    def _step(self, state: State, dt: float) -> tuple[State, StepReport, float]:
        """One accepted step and the proposal for the next."""
        speed = self.history[-1].speed if self.history else 0.0
        dt = min(dt, self._longest_step(speed))
        moving = speed > self.config.moving_speed * np.sqrt(self.gravity * self.length)
        tolerance = self.config.moving_tolerance if moving else self.config.newton_tolerance
        while True:
            after, report = self.stepper.advance(state, dt, tolerance)
            bound = self.config.acceptable_residual * (1.0 + self.config.impact_share * speed / (self.gravity * dt))
            if report.residual <= bound:
                break
            if dt <= self.config.shortest_step_seconds:
                raise UnstableStep(
                    f"t = {state.time:.4f} s: step of {dt:.1e} s ends with {report.residual:.2g} of the free weight "
                    f"unbalanced after {report.newton} Newton iterations (bound {bound:.2g}: acceptable_residual = "
                    f"{self.config.acceptable_residual}, more in an impact); {report.inverted} inverted particles"
                )
            dt = max(0.5 * dt, self.config.shortest_step_seconds)
        self.query.remember(report.contacts)
        easy = report.newton <= self.config.newton_limit // 2 and (len(report.contacts.a) > 0 or not self.free)
        return after, report, dt * (STEP_GROWTH if easy else 1.0)

    def _longest_step(self, speed: float) -> float:
        """No free body may skip a contact; what only hangs on a clamp has none to skip and no path to get wrong."""
        if not self.free:
            return self.config.hanging_step_seconds
        distance = max(self.config.step_distance, self.config.step_share * self.length)
        reach = max(distance / max(speed, 1e-12), self.config.shortest_step_seconds)
        return min(reach, self._balance_step())

    def _balance_step(self) -> float:
        """Longest step that follows a loss of balance [s]."""
        return self.config.longest_step * float(np.sqrt(0.5 * self.length / max(self.gravity, 1e-12)))

    def _record(self, state: State, report: StepReport, progress: Progress | None) -> Signals:
        signals = measure(self.model, self.soft, self.query, self.watched, self.mass, state, report)
        self.history.append(signals)
        if progress is not None:
            progress(len(self.history), state.time, signals)
        return signals

    def _quiet(self) -> bool:
        """All signals below their thresholds over the whole window."""
        window = self.history[-self.config.rest_steps :]
        if len(window) < self.config.rest_steps:
            return False
        return all(row["value"] <= row["threshold"] for row in self._rows(window).values())

    def _rows(self, window: list[Signals]) -> dict[str, dict[str, float]]:
        """Value and threshold of every rest signal over a window of steps."""
        return rest_rows(window, self.config, self.gravity, self.length)

    def _left(self, state: State, contacts: Contacts) -> bool:
        """A free body has left everything that could carry it."""
        pairs = {(t.pair.a, t.pair.b) for t in contacts.touching}
        loose = set(self.free) - carried(self.model, pairs)
        return any(beside(self.model, self.query.surface(state, i), self._center(state, i)) for i in loose)

    def _adapt(self, contacts: Contacts, signals: Signals) -> None:
        """Stiffen pairs that penetrate more than asked for; only near rest, where the load is the weight."""
        if signals.speed > self.config.moving_speed * np.sqrt(self.gravity * self.length):
            return
        for t in contacts.touching:
            load = t.normal_force
            if load.sum() <= 0.0:
                continue
            depth = float(-(t.gap * load).sum() / load.sum())
            if depth > 1.25 * self.config.penetration_target:
                factor = min(4.0, depth / self.config.penetration_target)
                t.pair.stiffness *= factor
                t.pair.anchor /= factor

    def _verify(self, rest: State, progress: Progress | None) -> tuple[bool, dict[str, object]]:
        """Kick the rest state and follow it; stable if it stays near and comes to rest again."""
        c = self.config
        random = np.random.default_rng(c.seed)
        state = rest.copy()
        state.v[:] = 0.0
        state.velocity[:] = 0.0
        state.angular_velocity[:] = 0.0
        for i in self.free:
            direction, axis = (d / np.linalg.norm(d) for d in random.normal(size=(2, 3)))
            state.velocity[i] = c.kick_speed * direction
            state.angular_velocity[i] = c.kick_angular_speed * axis
            for s in self.soft.bodies:
                if s.index == i:
                    arm = state.x[s.nodes] - self._center(state, i)
                    state.v[s.nodes] = state.velocity[i] + np.cross(state.angular_velocity[i], arm)
        begin, farthest = len(self.history), 0.0
        self.query.gentle = True
        dt = 0.5 * self._balance_step()
        undecided, segment = True, 0
        while undecided and segment < c.kick_segments:
            segment += 1
            first = len(self.history)
            while state.time < rest.time + segment * c.kick_seconds - 1e-9:
                state, report, dt = self._step(state, dt)
                self._record(state, report, progress)
                farthest = max(farthest, self._distance(rest, state)[0])
            distance, angle = self._distance(rest, state)
            near = distance <= c.kick_distance * self.length and angle <= c.kick_angle
            left, growing = self._kick_left(self.history[first:])
            undecided = near and left <= 1.0 and (growing or left > c.kick_decay)
        stable = near and left <= c.kick_decay and not growing
        self._kicked = state
        return stable, {
            "done": True, "stable": stable, "speed_m_s": c.kick_speed, "angular_speed_rad_s": c.kick_angular_speed,
            "seconds": segment * c.kick_seconds, "steps": len(self.history) - begin, "growing": growing,
            "speed_left": {"value": left, "threshold": c.kick_decay},
            "distance_m": {"value": distance, "threshold": c.kick_distance * self.length, "largest": farthest},
            "angle_rad": {"value": angle, "threshold": c.kick_angle},
        }  # fmt: skip

    def _kick_left(self, kicked: list[Signals]) -> tuple[float, bool]:
        """Largest speed at the end over the kick's (0 where it is below the rest thresholds) and whether it
        still grows.

        An unstable balance gains speed; a wobble may look like it for half a period, so growth alone only
        asks for more time.
        """
        c = self.config
        quarter = max(len(kicked) // 4, 2)
        before, end = self._rows(kicked[-2 * quarter : -quarter]), self._rows(kicked[-quarter:])
        left, growing = 0.0, False
        kicks = {
            "linear_speed": c.kick_speed,
            "angular_speed": c.kick_angular_speed,
            "particle_speed": 2.0 * c.kick_speed,
        }
        for name, kick in kicks.items():
            now = end[name]["value"]
            left = max(left, now / kick if now > end[name]["threshold"] else 0.0)
            growing |= now > max(before[name]["value"], KICK_NOISE * kick)
        return left, growing

    def _after_failed_kick(
        self, first: dict[str, object], progress: Progress | None
    ) -> tuple[str, State, StepReport, dict[str, dict[str, float]], dict[str, object]]:
        """The rest was not stable: follow the motion that the kick started to its end; a second rest is
        verified in its turn."""
        begin = len(self.history)
        verdict, state, report = self._approach(self._kicked, progress)
        rows = self._rows(self.history[begin:][-self.config.rest_steps :])
        if verdict != AT_REST:
            return verdict, state, report, rows, first
        stable, kick = self._verify(state, progress)
        if stable:
            self.warnings.append("the first rest state was unstable under the kick; this is the one it fell into")
        return (AT_REST if stable else NO_EQUILIBRIUM), state, report, rows, kick

    def _center(self, state: State, index: int) -> NDArray[np.float64]:
        for s in self.soft.bodies:
            if s.index == index:
                m = self.soft.mass[s.nodes]
                return np.asarray(m @ state.x[s.nodes] / m.sum())
        return np.asarray(state.center[index])

    def _distance(self, rest: State, state: State) -> tuple[float, float]:
        """Largest distance of a centre of mass [m] and largest turn [rad] of any free body between two states."""
        distance = max(float(np.linalg.norm(self._center(state, i) - self._center(rest, i))) for i in self.free)
        angle = 0.0
        for i in self.free:
            a, b = self._motion(rest, i)[0], self._motion(state, i)[0]
            angle = max(angle, float(np.arccos(np.clip((np.trace(b @ a.T) - 1.0) / 2.0, -1.0, 1.0))))
        return distance, angle

    def _motion(self, state: State, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        for s in self.soft.bodies:
            if s.index == index and not self.model.bodies[index].fixed:
                return best_rigid_motion(self.soft.rest[s.nodes], state.x[s.nodes], self.soft.mass[s.nodes])
        rotation = state.rotation[index]
        return rotation, state.center[index] - rotation @ self.model.bodies[index].center_of_mass

    def _result(
        self,
        verdict: str,
        state: State,
        report: StepReport,
        rows: dict[str, dict[str, float]],
        kick: dict[str, object],
    ) -> Result:
        bodies = []
        for i, body in enumerate(self.model.bodies):
            rotation, translation = self._motion(state, i)
            bodies.append(
                RestBody(body.name, self.query.surface(state, i), rotation, translation, self._speed(state, i))
            )
        if report.inverted:
            self.warnings.append(f"{report.inverted} particles are inverted in the last state")
        patch = {
            self.model.bodies[i].name: np.concatenate(
                [t.position for t in report.contacts.touching if i in (t.pair.a, t.pair.b)] or [np.zeros((0, 3))]
            )
            for i in self.free
        }
        return Result(
            verdict,
            tuple(bodies),
            contact_table(self.model, report.contacts),
            patch,
            certificate(self.model, rows, kick, report, self.stepper.damping, self.weight, self.length),
            {k: np.array([getattr(s, k) for s in self.history]) for k in Signals.SERIES},
            len(self.history),
            state.time,
            int(self.soft.real.sum()),
            tuple(self.warnings),
        )

    def _speed(self, state: State, index: int) -> float:
        for s in self.soft.bodies:
            if s.index == index:
                return float(np.linalg.norm(state.v[s.nodes], axis=1).max())
        reach = 0.5 * self.model.bodies[index].size
        return float(np.linalg.norm(state.velocity[index]) + reach * np.linalg.norm(state.angular_velocity[index]))


def contact_pairs(model: Model, soft: SoftSystem, config: SolverConfig, gravity: float) -> list[Pair]:
    """Every ordered pair of bodies that can push each other, with its first contact stiffness per point."""
    pairs = []
    for a, one in enumerate(model.bodies):
        for b, two in enumerate(model.bodies):
            if a == b or (one.fixed and two.fixed):
                continue
            area = vertex_areas(one)
            # what three points need to carry the load at the penetration that is aimed at: more only makes impacts hard
            load = max(body.mass for body in (one, two) if not body.fixed) * max(gravity, 1.0)
            stiffness = np.full(len(area), load / (3.0 * config.penetration_target))
            if one.soft is not None or two.soft is not None:
                cell, modulus = softest(one, two)
                stiffness = np.minimum(stiffness, CELL_STIFFNESS * modulus / cell * np.minimum(area, cell**2))
            mu_s, mu_d = model.friction(one, two)
            points = len(one.vertices)
            pairs.append(
                Pair(
                    a,
                    b,
                    mu_s,
                    mu_d,
                    stiffness,
                    area,
                    np.zeros((points, 3)),
                    np.zeros(points, dtype=bool),
                    np.full((points, 3), np.nan),
                )
            )
    return pairs


def softest(one: Body, two: Body) -> tuple[float, float]:
    """Cell under the contact [m] and smallest Young's modulus [Pa] of a pair of which at least one is soft."""
    parts = [b.soft for b in (one, two) if b.soft is not None]
    cell = min(max(float(np.diff(p).min()) for p in s.planes) for s in parts)
    return cell, min(float(s.youngs_modulus.min()) for s in parts)


def predicted_damping(model: Model, config: SolverConfig, mass: dict[int, float], gravity: float) -> float:
    """Stiffness-proportional damping beta [s] that damps the bounce of the free bodies on their soft partners.

    omega = sqrt(k / m) with k the Hertz stiffness of the heaviest free body on the softest part; beta = 2 zeta / omega.
    """
    moduli = [float(b.soft.youngs_modulus.min()) for b in model.bodies if b.soft is not None]
    if not moduli or not mass or gravity == 0.0:
        return 0.0
    heaviest = max(mass, key=lambda i: mass[i])
    body = model.bodies[heaviest]
    extent = np.ptp(body.vertices, axis=0)
    radius = 0.25 * float(extent[0] + extent[1])
    stiffness = contact_stiffness(mass[heaviest] * gravity, radius, min(moduli), 0.3)
    return 2.0 * config.damping_ratio / float(np.sqrt(stiffness / mass[heaviest]))
