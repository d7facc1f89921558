"""One implicit step: backward Euler in true time with true masses, solved by Newton and conjugate gradients.

    M (v' - v) / dt = f(x') ,  x' = x + dt v'

Soft and rigid bodies, contact on both sides and friction are one system, so no side of a contact can outrun the other.
Backward Euler damps elastic vibration strongly and leaves slow rigid motion nearly untouched, as a path to rest needs;
stiffness-proportional damping beta K (Kelvin-Voigt) models the loss of real foams [B96, Sec. 9.3.3].

[B96] Bathe: Finite Element Procedures, Prentice Hall 1996.
[P92] Press, Teukolsky, Vetterling, Flannery: Numerical Recipes in C, 2nd ed., Cambridge 1992.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from solver.arrays import Array
from solver.config import SolverConfig
from solver.contact.active import Contacts
from solver.contact.friction import RollingLaw, law_stiff
from solver.contact.query import ContactQuery, StepStart
from solver.errors import UnstableStep
from solver.model.bodies import Model, RigidBody, free_motions
from solver.model.soft import SoftSystem
from solver.model.state import State, rotate, turn_between
from solver.tl.ghost import ghost_penalty
from solver.tl.linear import Frames, TangentSystem, Vector, conjugate_gradient
from solver.tl.tangent import ElasticForces, ElasticTangent, StepStrain

OVERSHOT = 0.3  # of the work at the start of a Newton move, as negative work at its end: the move went too far [-]
SEARCHES = 5  # number of shares of a move that are tried
LEAST_SHARE = 0.1  # least share of the interval by which a search narrows it [-]


@dataclass(eq=False, slots=True)
class StepReport:
    """Cost and accuracy of one step."""

    newton: int
    linear: int
    residual: float
    """Largest residual of a body over its weight, or over its load if that is larger [-]."""
    worst: int
    """Index of that body."""
    where: NDArray[np.float64]
    """Place of its largest imbalance [m]: a node, or the centre of a rigid body, shape (3,)."""
    contacts: Contacts
    frame_residual: NDArray[np.float64]
    inverted: int
    """Number of material particles with det F <= 0."""


@dataclass(frozen=True, eq=False, slots=True)
class StepProblem:
    """Definition of one step."""

    start: StepStart
    push: NDArray[np.float64]
    """Acceleration of each body besides gravity [m/s^2], shape (b, 3)."""
    strain: StepStrain | None
    """Strains at the start; None without material damping."""

    @property
    def before(self) -> State:
        """The state at the start of the step."""
        return self.start.state

    @property
    def dt(self) -> float:
        """Length of the step [s]."""
        return self.start.seconds


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """An iterate for the state at the end of a step."""

    state: State
    contacts: Contacts
    system: TangentSystem
    right: Array
    """Residual: forces on nodes [N], forces [N] and torques [N m] on frames, shape (3 n + 6 b,)."""
    residual: float
    """Size of the residual as in StepReport [-]."""
    worst: int


def carried_weights(weights: NDArray[np.float64], contacts: Contacts) -> NDArray[np.float64]:
    """Scale of the residuals of each body [N], shape (b,): its weight, or its load if that is larger, at most the
    largest weight. A sheet under a book is in balance if the book is."""
    return np.asarray(np.clip(contacts.carried_load(len(weights)), weights, weights.max()))


class Stepper:
    """Moves a state by one step with `step`; holds constant data and work arrays.

    The start of a step is entirely in its arguments, except for two caches: the elastic tangent (tangent.py) may be
    that of an earlier state, which only changes the path of Newton's iterations to a solution within the tolerance; and
    quantities at the last node positions are not computed again for the same positions (tangent.py).
    """

    def __init__(
        self,
        model: Model,
        soft: SoftSystem,
        query: ContactQuery,
        config: SolverConfig,
        weights: NDArray[np.float64],
        material_damping: float = 0.0,
    ) -> None:
        self.model = model
        self.soft = soft
        self.query = query
        self.config = config
        self.weights = weights
        """Weight of each body [N], for fixed bodies the weight of all free ones, shape (b,)."""
        self.theta = config.inertia_theta if config.inertia else 1.0
        """Fraction of a step at which forces and contacts are evaluated [-]."""
        ghost = ghost_penalty(soft)
        self.elastic = ElasticForces(soft, ghost, material_damping)
        self.tangent = ElasticTangent(soft, ghost, config.tangent_refresh)
        self.frame_bodies = [
            i
            for i, b in enumerate(model.bodies)
            if not b.fixed and (isinstance(b, RigidBody) or (soft.core == i).any())
        ]
        self.core_nodes = [np.flatnonzero(soft.core == i) for i in self.frame_bodies]
        self.movable = np.array([free_motions(model.bodies[i]) for i in self.frame_bodies]).reshape(-1, 6)

    def frames(self, state: State) -> Frames:
        """The moving frames at a state."""
        mass, inertia = np.zeros(len(self.frame_bodies)), np.zeros((len(self.frame_bodies), 3, 3))
        for f, i in enumerate(self.frame_bodies):
            body = self.model.bodies[i]
            if isinstance(body, RigidBody):  # the mass of a core is in its nodes
                mass[f], inertia[f] = body.mass, state.rotation[i] @ body.inertia @ state.rotation[i].T
        return Frames(
            self.frame_bodies,
            state.center[self.frame_bodies],
            mass,
            inertia,
            self.core_nodes,
            [state.x[t] - state.center[i] for t, i in zip(self.core_nodes, self.frame_bodies, strict=True)],
            self.movable,
        )

    def problem(
        self, state: State, dt: float, push: NDArray[np.float64] | None = None, rolling: RollingLaw = law_stiff
    ) -> StepProblem:
        """A step of `dt` [s] from a copy of the state; `push` (b, 3) accelerates bodies besides gravity [m/s^2]."""
        push = np.zeros((len(self.model.bodies), 3)) if push is None else push
        start = state.copy()
        return StepProblem(self.query.begin(start, dt, rolling), push, self.elastic.strain(start, dt))

    def step(
        self,
        state: State,
        dt: float,
        tolerance: float,
        push: NDArray[np.float64] | None = None,
        rolling: RollingLaw = law_stiff,
    ) -> tuple[State, StepReport]:
        """The state after `dt` [s], solved to `tolerance` of every body's weight; raises UnstableStep for a state that
        is not finite.

        A backward Euler step to theta dt, continued linearly from there: with theta = 1/2 the implicit midpoint rule.
        """
        problem = self.problem(state, self.theta * dt, push, rolling)
        total, count = 0, 0
        trial = self._linearise(self._predict(problem), problem)
        while trial.residual > tolerance and count < self.config.newton_limit:
            self.prepare(trial)
            move, iterations = conjugate_gradient(
                trial.system, trial.right, self.config.linear_tolerance, self.config.linear_limit
            )
            total += iterations
            count += 1
            trial = self._after_move(trial, move, problem)
        after, contacts = trial.state, trial.contacts
        self._finish(after, problem)
        if self.theta < 1.0:
            self._extrapolate(after, problem.before, dt)
            # friction's memory refers to the end of the whole step
            contacts = self.query.find(after, replace(problem.start, seconds=dt))
            after.memory = contacts.memory
        inverted = int((self.elastic.volume_ratio[self.soft.real] <= 0.0).sum())
        frames = trial.system.split(trial.right)[1]
        where = self._worst_place(trial)
        return after, StepReport(count, total, trial.residual, trial.worst, where, contacts, frames, inverted)

    def prepare(self, trial: Trial) -> None:
        """Update the elastic tangent and the preconditioner to a trial, before its system is solved."""
        self.elastic.evaluate(trial.state)
        self.tangent.refresh(trial.state, self.elastic.deformation)
        trial.system.prepare()

    def _after_move(self, trial: Trial, move: Array, problem: StepProblem) -> Trial:
        """Trial state after a Newton move, or after a share of it if the whole move goes too far.

        Forces derive from a potential except for the limits of friction, so unbalanced forces do positive work along a
        move until the potential is at its minimum, and negative work beyond. If the work at the end has become
        -OVERSHOT of the work at the start, a place in between is searched by false position [P92, Sec. 9.2].
        """
        move = self._capped(trial.system, move)
        first = float(trial.right @ move)
        low, high = (0.0, first), (1.0, 0.0)
        share, found = 1.0, []
        for _ in range(SEARCHES):
            latest = self._linearise(self._move(trial.state, trial.system, share * move), problem)
            work = float(latest.right @ move)
            found.append((abs(work), latest))
            if first <= 0.0 or (work >= -OVERSHOT * first and (share == 1.0 or work <= OVERSHOT * first)):
                break  # also if friction's limits make the move no descent at all
            if work < 0.0:
                high = (share, work)
            else:
                low = (share, work)
            at = float(np.clip(low[1] / (low[1] - high[1]), LEAST_SHARE, 1.0 - LEAST_SHARE))
            share = low[0] + at * (high[0] - low[0])
        else:  # none was close enough: take the closest, with the forces and the tangent of its own state
            best = min(found, key=lambda one: one[0])[1]
            return latest if best is latest else self._linearise(best.state, problem)
        return latest

    def _linearise(self, state: State, problem: StepProblem) -> Trial:
        """Forces, contacts and the system for a state at the end of a step, updating the state's contact memory; raises
        UnstableStep if the state is not finite."""
        dt = problem.dt
        self._require_finite(state, dt)
        force = self.elastic.forces(state, problem.strain)
        contacts = self.query.find(state, problem.start)
        state.memory = contacts.memory
        system = TangentSystem(self.soft, self.tangent, contacts, self.frames(state), dt, self.elastic.damping)
        right = self._residual(system, state, force, problem)
        residual, worst = self._size(system.split(right), contacts)
        if not np.isfinite(residual):
            raise self._not_finite("forces on", worst, state, dt)
        return Trial(state, contacts, system, right, residual, worst)

    def _require_finite(self, state: State, dt: float) -> None:
        """Raise UnstableStep for a body whose position is not finite."""
        for body in self.soft.bodies:
            if not np.isfinite(state.x[body.nodes]).all():
                raise self._not_finite("positions of", body.index, state, dt)
        for i in self.frame_bodies:
            if not (np.isfinite(state.center[i]).all() and np.isfinite(state.rotation[i]).all()):
                raise self._not_finite("positions of", i, state, dt)

    def _not_finite(self, what: str, body: int, state: State, dt: float) -> UnstableStep:
        one = self.model.bodies[body]
        return UnstableStep(
            f"t = {state.time:.4f} s: in a step of {dt:.2e} s {what} body {one.name!r} (placed at "
            f"{np.round(one.center_of_mass, 3).tolist()} m) are not finite"
        )

    def _predict(self, problem: StepProblem) -> State:
        """Predicted state with unchanged velocities; bodies without contact fall."""
        state, dt = problem.before, problem.dt
        touched = state.memory.touched
        after = state.copy()
        after.x = state.x + dt * state.v
        fall = dt**2 * self.model.gravity
        for body in self.soft.bodies:
            if not self.model.bodies[body.index].fixed and body.index not in touched:
                after.x[body.nodes] += fall
        for i, movable in zip(self.frame_bodies, self.movable, strict=True):
            after.center[i] = state.center[i] + dt * state.velocity[i]
            if i not in touched:
                after.center[i] += fall * movable[:3]
            after.rotation[i] = rotate(state.rotation[i], dt * state.angular_velocity[i])
        return self._constrain(after)

    def _constrain(self, state: State) -> State:
        """Place core nodes by their frame, and held nodes where they were at the start."""
        for i, cores in zip(self.frame_bodies, self.core_nodes, strict=True):
            if len(cores):
                arm = self.soft.rest[cores] - self.model.bodies[i].center_of_mass
                state.x[cores] = arm @ state.rotation[i].T + state.center[i]
        state.x[self.soft.held] = self.soft.rest[self.soft.held]
        return state

    def _residual(
        self, system: TangentSystem, after: State, elastic_force: NDArray[np.float64], problem: StepProblem
    ) -> Array:
        """Force minus inertia on every degree of freedom."""
        before, dt, push = problem.before, problem.dt, problem.push
        gravity = self.model.gravity
        velocity = (after.x - before.x) / dt
        out = system.contact_forces()
        nodes, frames = system.split(out)
        nodes += elastic_force + (self.soft.mass * self.soft.gravity_share)[:, None] * gravity
        for body in self.soft.bodies:
            nodes[body.nodes] += self.soft.mass[body.nodes, None] * push[body.index]
        nodes -= self.soft.mass[:, None] * (velocity - before.v) / dt
        for f, i in enumerate(self.frame_bodies):
            linear = (after.center[i] - before.center[i]) / dt
            angular = turn_between(before.rotation[i], after.rotation[i]) / dt
            frames[f, :3] += system.frames.mass[f] * (gravity + push[i] - (linear - before.velocity[i]) / dt)
            frames[f, 3:] -= system.frames.inertia[f] @ (angular - before.angular_velocity[i]) / dt
        return system.reduce(out)

    def _size(self, residual: Vector, contacts: Contacts) -> tuple[float, int]:
        """Largest residual of a body over its weight or load [-], from its nodes (2-norm), its force, and its torque
        over half its size; and the index of that body."""
        scale = carried_weights(self.weights, contacts)
        parts = np.zeros(len(self.model.bodies))
        for body in self.soft.bodies:
            nodes = residual[0][body.nodes]
            parts[body.index] = np.sqrt((nodes**2).sum())
            if not self.model.bodies[body.index].fixed:  # many small residuals of the same sign move a body as a whole
                parts[body.index] = np.maximum(parts[body.index], np.linalg.norm(nodes.sum(axis=0)))
        for index, spin in contacts.spins.items():
            torque = np.cross(spin.arm, residual[0][spin.nodes]).sum(axis=0)
            parts[index] = np.maximum(parts[index], np.linalg.norm(torque) / (0.5 * self.model.bodies[index].size))
        for f, i in enumerate(self.frame_bodies):
            torque = np.linalg.norm(residual[1][f, 3:]) / (0.5 * self.model.bodies[i].size)
            parts[i] = np.max([parts[i], np.linalg.norm(residual[1][f, :3]), torque])
        parts /= scale
        worst = int(np.argmax(parts))  # the first NaN, if there is one
        return float(parts[worst]), worst

    def _worst_place(self, trial: Trial) -> NDArray[np.float64]:
        """The place of StepReport.where."""
        for body in self.soft.bodies:
            if body.index == trial.worst:
                nodes = trial.system.split(trial.right)[0][body.nodes]
                return np.array(trial.state.x[body.nodes][int(np.argmax((nodes**2).sum(axis=1)))])
        return np.array(trial.state.center[trial.worst])

    def _capped(self, system: TangentSystem, move: Array) -> Array:
        """A Newton move, shortened so that no point jumps past a contact."""
        nodes, frames = system.split(system.expand(move))
        moves = [float(np.abs(nodes).max())] if len(nodes) else []
        for f, i in enumerate(self.frame_bodies):
            moves.append(
                float(np.linalg.norm(frames[f, :3]) + 0.5 * self.model.bodies[i].size * np.linalg.norm(frames[f, 3:]))
            )
        return min(1.0, self.config.longest_move / max([*moves, 1e-30])) * move

    def _move(self, state: State, system: TangentSystem, move: Array) -> State:
        """Apply a Newton move."""
        nodes, frames = system.split(system.expand(move))
        after = state.copy()
        after.x = state.x + nodes
        for f, i in enumerate(self.frame_bodies):
            after.center[i] = state.center[i] + frames[f, :3]
            after.rotation[i] = rotate(state.rotation[i], frames[f, 3:])
        return self._constrain(after)

    def _finish(self, after: State, problem: StepProblem) -> None:
        before, dt = problem.before, problem.dt
        after.v = (after.x - before.x) / dt
        for i in self.frame_bodies:
            after.velocity[i] = (after.center[i] - before.center[i]) / dt
            after.angular_velocity[i] = turn_between(before.rotation[i], after.rotation[i]) / dt
        after.time = before.time + dt

    def _extrapolate(self, after: State, before: State, dt: float) -> None:
        """Extrapolate from the state at theta dt to that at dt: positions and velocities are linear."""
        more = 1.0 / self.theta
        after.x = before.x + more * (after.x - before.x)
        after.v = before.v + more * (after.v - before.v)
        for i in self.frame_bodies:
            turn = turn_between(before.rotation[i], after.rotation[i])
            after.center[i] = before.center[i] + more * (after.center[i] - before.center[i])
            after.rotation[i] = rotate(before.rotation[i], more * turn)
            after.velocity[i] = before.velocity[i] + more * (after.velocity[i] - before.velocity[i])
            after.angular_velocity[i] = before.angular_velocity[i] + more * (
                after.angular_velocity[i] - before.angular_velocity[i]
            )
        self._constrain(after)
        after.time = before.time + dt
