"""One simulation, step by step: length of a step, measurements after it, and positions of bodies.

A step depends only on its arguments: everything that it inherits from earlier steps is in the StepControl passed on by
them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.config import SolverConfig
from solver.contact.active import STIFFENED, Contacts, contact_pairs
from solver.contact.bonds import build_bonds
from solver.contact.friction import RollingLaw, law_stiff
from solver.contact.patch import contact_stiffness
from solver.contact.query import ContactQuery
from solver.errors import ModelError, UnstableStep
from solver.model import soft as soft_system
from solver.model.bodies import Model, free_motions
from solver.model.state import State, best_rigid_motion, start_state
from solver.rest import RestMonitor, Signals
from solver.tl.ghost import with_definite_relief
from solver.tl.measure import measure
from solver.tl.step import Stepper, StepReport

Load = Callable[[float], NDArray[np.float64]]
"""Function of the end time of a step [s]: the acceleration of each body besides gravity [m/s^2], shape (b, 3)."""

SHORTER = 0.1  # of a step that resolves elastic waves: the shortest step in an impact
STEP_GROWTH = 1.25  # growth of the step when Newton converges easily


@dataclass(frozen=True, slots=True)
class StepControl:
    """Step length and accuracy, carried over from step to step."""

    dt: float
    """Longest step to try [s]."""
    speed: float = 0.0
    """Largest linear speed after the previous step [m/s]."""
    tolerance_factor: float = 1.0
    """Factor on the tolerance of steps at rest [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class AcceptedStep:
    """Result of a step, and the control for the next one."""

    state: State
    report: StepReport
    signals: Signals
    control: StepControl


class Simulation:
    """Bodies and contacts of a model, and the law for stepping a state; keeps no history."""

    def __init__(self, model: Model, config: SolverConfig) -> None:
        self.model = model
        self.config = config
        self.soft = with_definite_relief(soft_system.build(model))
        self.soft_of = {one.index: one for one in self.soft.bodies}
        self.free = [i for i, b in enumerate(model.bodies) if not b.fixed]
        self.watched = self.free or [s.index for s in self.soft.bodies]
        self.mass = {i: self._mass(i) for i in self.watched}
        self.gravity = model.gravity_strength
        if not self.watched:
            raise ModelError("nothing can move: every body is rigid and fixed")
        self.length = max(model.bodies[i].size for i in self.watched)
        self.weight = sum(self.mass.values()) * self.gravity
        pairs = contact_pairs(model, self.soft, config, self.gravity)
        self.query = ContactQuery(model, self.soft, pairs, build_bonds(model, self.soft, config.penetration_target))
        weights = np.full(len(model.bodies), self.weight)
        weights[self.free] = [self.mass[i] * self.gravity for i in self.free]
        damping = 0.0
        if not config.inertia:
            damping = predicted_damping(model, config, {i: self.mass[i] for i in self.free}, self.gravity)
        self.stepper = Stepper(model, self.soft, self.query, config, weights, damping)
        self.wave_step = config.inertia_step * crossing_seconds(model) if config.inertia else np.inf
        """Longest step that resolves elastic waves [s]."""

    def rest_monitor(self) -> RestMonitor:
        """A monitor for the rest of this model, without any signals yet."""
        return RestMonitor(self.config, self.gravity, self.length)

    def _mass(self, index: int) -> float:
        if (one := self.soft_of.get(index)) is not None:
            return float(self.soft.mass[one.nodes].sum())
        return self.model.bodies[index].mass

    def start_state(self) -> State:
        """The start pose, with contacts without memory."""
        return start_state(self.model, self.soft, self.query.fresh_memory())

    def step(
        self, state: State, control: StepControl, load: Load | None = None, rolling: RollingLaw = law_stiff
    ) -> AcceptedStep:
        """One accepted step of at most `control.dt` [s]; `load` acts besides gravity."""
        speed = control.speed
        dt = min(control.dt, self._longest_step(speed))
        moving = speed > self.config.moving_speed * np.sqrt(self.gravity * self.length) and not self.config.inertia
        shortest = min(self.config.shortest_step_seconds, SHORTER * self.wave_step)
        tolerance = self.config.moving_tolerance if moving else control.tolerance_factor * self.config.newton_tolerance
        while True:
            push = None if load is None else load(state.time + dt)
            after, report = self.stepper.step(state, dt, tolerance, push, rolling)
            bound = self.config.acceptable_residual * (1.0 + self.config.impact_share * speed / (self.gravity * dt))
            if report.residual <= bound:
                break
            if dt <= shortest:
                name = self.model.bodies[report.worst].name
                raise UnstableStep(
                    f"t = {state.time:.4f} s: step of {dt:.1e} s ends with {report.residual:.2g} of what body {name!r} "
                    f"weighs or carries unbalanced, most of it at {np.round(report.where, 4).tolist()} m, after "
                    f"{report.newton} Newton iterations (bound {bound:.2g}: acceptable_residual = "
                    f"{self.config.acceptable_residual}, more in an impact); fastest body {speed:.2g} m/s, "
                    f"{report.inverted} inverted particles"
                )
            dt = max(0.5 * dt, shortest)
        if state.memory.stiffened:  # velocities stay, except for the approach along the normals, which is stopped
            after.move_as(state)
            for index, normal in state.memory.stiffened:
                self._end_approach(after, index, normal)
        easy = report.newton <= self.config.newton_limit // 2 and (len(report.contacts.a) > 0 or not self.free)
        weights = self.stepper.weights
        signals = measure(self.model, self.soft, self.query, self.watched, self.mass, weights, after, report)
        longer = dt * (STEP_GROWTH if easy else 1.0)
        return AcceptedStep(after, report, signals, StepControl(longer, signals.speed, control.tolerance_factor))

    def stiffen(self, state: State, contacts: Contacts, signals: Signals) -> None:
        """Near rest, where the load is the weight, stiffen pairs that penetrate more than requested, and before that
        those that penetrate more than is safe; not before with inertia, as nothing may add energy to an impact.

        Springs that suddenly become stiffer would throw a body up, so the next step only corrects positions.
        """
        moving = signals.speed > self.config.moving_speed * np.sqrt(self.gravity * self.length)
        if moving and self.config.inertia:
            return
        stiffened: list[tuple[int, NDArray[np.float64]]] = []
        for t in contacts.active:
            load = t.normal_force
            if load.sum() <= 0.0:
                continue
            depth = float(-(t.gap * load).sum() / load.sum())
            target = (
                max(t.pair.safe_depth, self.config.penetration_target) if moving else self.config.penetration_target
            )
            if depth > STIFFENED * target:
                if not self.config.inertia:
                    normal = load @ t.normal
                    stiffened += [(i, normal / np.linalg.norm(normal)) for i in t.pair.key]
                factor = min(4.0, depth / target)
                state.memory = state.memory.stiffen(t.pair.key, factor)
        state.memory = replace(state.memory, stiffened=tuple(stiffened))

    def _end_approach(self, state: State, index: int, normal: NDArray[np.float64]) -> None:
        """Remove the motion along a unit normal from a body; a clamped body is stopped."""
        one, body = self.soft_of.get(index), self.model.bodies[index]
        if one is None and not body.fixed:
            along = normal * free_motions(body)[:3]
            state.velocity[index] -= (state.velocity[index] @ normal) * along
        elif one is not None and body.fixed:
            state.v[one.nodes] = 0.0
        elif one is not None:
            mass = self.soft.mass[one.nodes]
            state.v[one.nodes] -= (mass @ state.v[one.nodes] @ normal / mass.sum()) * normal

    def _longest_step(self, speed: float) -> float:
        """Longest step in which no free body can skip a contact; a body on a clamp has no contact to skip and no path
        to get wrong."""
        if not self.free:
            return min(self.config.hanging_step_seconds, self.wave_step)
        distance = max(self.config.step_distance, self.config.step_share * self.length)
        longest = max(distance / max(speed, 1e-12), self.config.shortest_step_seconds)
        return min(longest, self.balance_step(), self.wave_step)

    def balance_step(self) -> float:
        """Longest step after a loss of balance [s]."""
        return self.config.longest_step * float(np.sqrt(0.5 * self.length / self.gravity))

    def add_rigid_motion(
        self, state: State, index: int, velocity: NDArray[np.float64], angular_velocity: NDArray[np.float64]
    ) -> None:
        """Add a rigid motion [m/s], [rad/s] about its centre of mass to the motion of a free body, as far as the body
        may move."""
        movable = free_motions(self.model.bodies[index])
        velocity, angular_velocity = velocity * movable[:3], angular_velocity * movable[3:]
        state.velocity[index] += velocity
        state.angular_velocity[index] += angular_velocity
        if (one := self.soft_of.get(index)) is not None:
            arm = state.x[one.nodes] - self.center(state, index)
            state.v[one.nodes] += velocity + np.cross(angular_velocity, arm)

    def center(self, state: State, index: int) -> NDArray[np.float64]:
        """Centre of mass of a body [m], shape (3,)."""
        if (one := self.soft_of.get(index)) is not None:
            m = self.soft.mass[one.nodes]
            return np.asarray(m @ state.x[one.nodes] / m.sum())
        return np.asarray(state.center[index])

    def distance(self, rest: State, state: State) -> tuple[float, float]:
        """Largest distance of a centre of mass [m] and largest turn [rad] of any free body between two states."""
        distance = max(float(np.linalg.norm(self.center(state, i) - self.center(rest, i))) for i in self.free)
        angle = 0.0
        for i in self.free:
            a, b = self.motion(rest, i)[0], self.motion(state, i)[0]
            angle = max(angle, float(np.arccos(np.clip((np.trace(b @ a.T) - 1.0) / 2.0, -1.0, 1.0))))
        return distance, angle

    def motion(self, state: State, index: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """World-from-start rotation (3, 3) and translation (3,) [m] of a body, best fit for a free soft one."""
        one = self.soft_of.get(index)
        if one is not None and not self.model.bodies[index].fixed:
            return best_rigid_motion(self.soft.rest[one.nodes], state.x[one.nodes], self.soft.mass[one.nodes])
        rotation = state.rotation[index]
        return rotation, state.center[index] - rotation @ self.model.bodies[index].center_of_mass

    def speed(self, state: State, index: int) -> float:
        """Bound of the speed of any point of a body [m/s]."""
        if (one := self.soft_of.get(index)) is not None:
            return float(np.linalg.norm(state.v[one.nodes], axis=1).max())
        half_size = 0.5 * self.model.bodies[index].size
        return float(np.linalg.norm(state.velocity[index]) + half_size * np.linalg.norm(state.angular_velocity[index]))


def crossing_seconds(model: Model) -> float:
    """Shortest time [s] that a wave of speed sqrt(E / rho) takes along the thinnest side of a soft body."""
    times = [np.inf]
    for _, body in model.soft_bodies:
        speed = float(np.sqrt(body.interior.youngs_modulus / body.interior.density).max())
        times.append(float(np.ptp(body.vertices, axis=0).min()) / speed)
    return min(times)


def predicted_damping(model: Model, config: SolverConfig, mass: dict[int, float], gravity: float) -> float:
    """Stiffness-proportional damping beta [s] that damps the bounce of the free bodies on their soft partners.

    omega = sqrt(k / m) with k the Hertz stiffness of the heaviest free body on the softest part; beta = 2 zeta / omega.
    """
    moduli = [float(b.interior.youngs_modulus.min()) for _, b in model.soft_bodies]
    if not moduli or not mass:
        return 0.0
    heaviest = max(mass, key=lambda i: mass[i])
    body = model.bodies[heaviest]
    extent = np.ptp(body.vertices, axis=0)
    radius = 0.25 * float(extent[0] + extent[1])
    stiffness = contact_stiffness(mass[heaviest] * gravity, radius, min(moduli), 0.3)
    return 2.0 * config.damping_ratio / float(np.sqrt(stiffness / mass[heaviest]))
