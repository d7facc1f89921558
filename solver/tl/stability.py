"""Disturbs a rest state, and measures the largest push after which it recovers.

Each free body in turn is pushed horizontally at its centre of mass, in directions all around, by a force that grows to
a share of its weight, stays, and is removed. The push is held if everything then comes to rest where it was; a search
brackets the largest held push. For a rigid body on a level rigid floor the answer is a formula: it slides at mu_s, or
tips at (distance of the edge) / (height of the centre of mass), whichever is less. The same number is the allowed
horizontal acceleration of its support, in units of gravity.

There is no randomness, and every trial starts from the same state: the same model and config give the same grade.

Disturbs a rest state and follows it until it is quiet again, has left, or the time is up.

A rest state is verified with a small kick; a graded push ends in the same way: by letting the bodies go and following
them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from solver.certificate import BodyStability, KickCheck, KickRow, NotDone, PushBounds, PushRow, StabilityGrade
from solver.config import SolverConfig
from solver.contact.friction import law_compliant
from solver.errors import UnstableStep
from solver.model.state import State
from solver.rest import Progress, RestMonitor, Signals
from solver.tl.simulation import Simulation, StepControl

KICK_NOISE = 0.1  # share of a kick's speed below which growth is noise of the solver's tolerance
# growth of a speed in a quarter of a period's steps: a body with slower growth rolls in neutral balance, it does not
# fall over
GROWTH = 1.25


@dataclass(frozen=True, slots=True)
class Displacement:
    """Motion of free bodies."""

    distance: float
    """Displacement of a centre of mass [m]."""
    angle: float
    """Rotation of a body [rad]."""

    @classmethod
    def between(cls, simulation: Simulation, rest: State, state: State) -> "Displacement":
        """Largest displacement of all free bodies between two states."""
        return cls(*simulation.distance(rest, state))

    def within(self, bound: "Displacement") -> bool:
        """Return whether neither the distance nor the angle exceeds the bound."""
        return self.distance <= bound.distance and self.angle <= bound.angle


@dataclass(frozen=True, slots=True)
class StopCriteria:
    """Criteria to stop following bodies that have not come to rest."""

    at_once: Displacement
    """Stop at once beyond this displacement."""
    at_period_end: Displacement
    """Stop beyond this displacement at the end of a period."""
    speed: float
    """Stop at a larger speed at the end of a period, over the kick's speed [-]."""
    when_quiet: bool = False
    """Stop at rest over a window as well: not after a kick, which is so small that a lost balance only shows later."""


@dataclass(frozen=True, eq=False, slots=True)
class Response:
    """Response to a disturbance."""

    state: State
    control: StepControl
    """Control for a step that continues from there."""
    stable: bool
    """Whether the bodies came to rest again near the rest state."""
    moved: Displacement
    """Displacement from the rest state to the end."""
    farthest: float
    """Largest distance during the motion [m]."""
    speed_left: float
    """Largest speed at the end over the kick's, 0 below the rest thresholds [-]."""
    growing: bool
    segments: int
    """Number of periods of kick_seconds."""


def kick(
    simulation: Simulation, monitor: RestMonitor, rest: State, control: StepControl, progress: Progress | None
) -> tuple[State, StepControl, KickCheck]:
    """Kick a rest state and follow it; returns the final state, the data for a further step, and whether the rest was
    stable.

    `control` is that of the rest state; `monitor` records the signals.
    """
    c = simulation.config
    state = kicked_state(simulation, rest)
    begin = len(monitor.signals)
    bound = Displacement(c.kick_distance * simulation.length, c.kick_angle)
    # a stable state does not gain speed from a kick
    stop = StopCriteria(Displacement(np.inf, np.inf), bound, 1.0)
    end = follow(simulation, monitor, rest, state, control, near=bound, stop=stop, progress=progress)
    return (
        end.state,
        end.control,
        KickCheck(
            stable=end.stable,
            speed_m_s=c.kick_speed,
            angular_speed_rad_s=c.kick_angular_speed,
            seconds=end.segments * c.kick_seconds,
            steps=len(monitor.signals) - begin,
            growing=end.growing,
            speed_left=KickRow(end.speed_left, c.kick_decay),
            distance_m=KickRow(end.moved.distance, bound.distance, end.farthest),
            angle_rad=KickRow(end.moved.angle, bound.angle),
        ),
    )


def kicked_state(simulation: Simulation, rest: State) -> State:
    """A rest state with the kick, from a seeded direction, on all free bodies; bonded bodies are kicked as one."""
    c = simulation.config
    random = np.random.default_rng(c.seed)
    state = stopped(rest)
    for group in bonded_groups(simulation):
        direction, axis = (d / np.linalg.norm(d) for d in random.normal(size=(2, 3)))
        mass = np.array([simulation.mass[i] for i in group])
        centers = np.array([simulation.center(state, i) for i in group])
        arms = centers - mass @ centers / mass.sum()
        longest_arm = float(np.linalg.norm(arms, axis=1).max())
        # whatever the length of the arms, no member gets more than twice the kick's speed
        spin = min(c.kick_angular_speed, c.kick_speed / max(longest_arm, 1e-12)) * axis
        for i, arm in zip(group, arms, strict=True):
            simulation.add_rigid_motion(state, i, c.kick_speed * direction + np.cross(spin, arm), spin)
    return state


def bonded_groups(simulation: Simulation) -> list[list[int]]:
    """Free bodies, grouped with those that they are bonded to, directly or through others: each group moves as one."""
    groups: list[list[int]] = []
    for i in simulation.free:
        bodies = simulation.model.bodies
        joined = [g for g in groups if any(simulation.model.bonded(bodies[i], bodies[j]) for j in g)]
        groups = [g for g in groups if g not in joined] + [sorted([i, *(j for g in joined for j in g)])]
    return sorted(groups)


def stopped(rest: State) -> State:
    """A rest state without its residual motion."""
    state = rest.copy()
    state.stop()
    return state


def follow(
    simulation: Simulation,
    monitor: RestMonitor,
    rest: State,
    state: State,
    control: StepControl,
    *,
    near: Displacement,
    stop: StopCriteria,
    progress: Progress | None,
) -> Response:
    """Continue a disturbed state; it is stable if it comes to rest within `near` of the rest state.

    Rolling resistance is compliant meanwhile (friction.py). `monitor` records the signals; steps restart at half the
    longest step after a loss of balance.
    """
    c = simulation.config
    start, farthest, control = state.time, 0.0, replace(control, dt=0.5 * simulation.balance_step())
    begin = len(monitor.signals)
    undecided, segment = True, 0
    while undecided and segment < c.kick_segments:
        segment += 1
        first = len(monitor.signals)
        while state.time < start + segment * c.kick_seconds - 1e-9:
            step = simulation.step(state, control, rolling=law_compliant)
            state, control = step.state, step.control
            monitor.record(step.signals, progress)
            moved = Displacement.between(simulation, rest, state)
            farthest = max(farthest, moved.distance)
            if not moved.within(stop.at_once):
                return Response(state, control, False, moved, farthest, np.inf, True, segment)
            if stop.when_quiet and len(monitor.signals) >= begin + c.rest_steps and monitor.quiet():
                return Response(state, control, moved.within(near), moved, farthest, 0.0, False, segment)
        left, growing = _speed_left(monitor, monitor.signals[first:], c)
        moving = growing or left > c.kick_decay
        undecided = moving and moved.within(stop.at_period_end) and left <= stop.speed
    stable = moved.within(near) and not moving
    return Response(state, control, stable, moved, farthest, left, growing, segment)


def _speed_left(monitor: RestMonitor, followed: list[Signals], c: SolverConfig) -> tuple[float, bool]:
    """Largest speed at the end over the kick's speed (0 if it is below the rest thresholds), and whether it still
    grows.

    An unstable balance gains speed by a factor e in about sqrt(L / 2g): 0.1 s for L = 0.2 m, and GROWTH in a quarter of
    half a second for L = 6 m. A wobble may look like it for half its period, so growth alone only extends the time.
    """
    quarter = max(len(followed) // 4, 2)
    before, end = monitor.judge(followed[-2 * quarter : -quarter]), monitor.judge(followed[-quarter:])
    left, growing = 0.0, False
    for earlier, now, speed in (
        (before.linear_speed, end.linear_speed, c.kick_speed),
        (before.angular_speed, end.angular_speed, c.kick_angular_speed),
        (before.particle_speed, end.particle_speed, 2.0 * c.kick_speed),
    ):
        left = max(left, 0.0 if now.holds else now.value / speed)
        growing |= now.value > GROWTH * max(earlier.value, KICK_NOISE * speed)
    return left, growing


# half its size away, or turned by 60 degrees: lost, whatever happens later [-], [rad]
LOST = Displacement(0.5, np.pi / 3.0)


@dataclass(eq=False, slots=True)
class PushTrials:
    """Trials of one body in one direction, all from the same rest state."""

    simulation: Simulation
    rest: State
    index: int
    direction: NDArray[np.float64]
    """Horizontal unit vector, shape (3,)."""
    tolerance_factor: float
    """Factor on the tolerance of the rest state, as in StepControl."""
    ends: dict[int, Displacement] = field(default_factory=dict)
    """Motion of the bodies when each push, in units of push_step, was judged."""
    steps: int = 0
    warnings: list[str] = field(default_factory=list)

    def held(self, level: int, progress: Progress | None) -> bool:
        """Return whether everything comes back to rest after a push of `level` times push_step of the weight.

        A push that the solver cannot follow counts as lost, with a warning.
        """
        monitor = self.simulation.rest_monitor()
        try:
            held, self.ends[level] = self._push(level * self.simulation.config.push_step, monitor, progress)
        except UnstableStep as error:
            held, self.ends[level] = False, Displacement(np.inf, np.inf)
            self.warnings.append(f"stability: a push counts as lost because the solver cannot follow it: {error}")
        self.steps += len(monitor.signals)
        return held

    def _push(self, share: float, monitor: RestMonitor, progress: Progress | None) -> tuple[bool, Displacement]:
        simulation, c = self.simulation, self.simulation.config
        size = simulation.model.bodies[self.index].size
        lost_bound = Displacement(LOST.distance * size, LOST.angle)
        seconds = c.push_time * float(np.sqrt(0.5 * size / simulation.gravity))
        full = np.zeros((len(simulation.model.bodies), 3))
        full[self.index] = share * simulation.gravity * self.direction

        def load(time: float) -> NDArray[np.float64]:
            return min((time - self.rest.time) / seconds, 1.0) * full

        state = stopped(self.rest)
        control = StepControl(0.5 * simulation.balance_step(), tolerance_factor=self.tolerance_factor)
        while state.time < self.rest.time + 2.0 * seconds - 1e-9:
            step = simulation.step(state, control, load, law_compliant)
            state, control = step.state, step.control
            monitor.record(step.signals, progress)
            moved = Displacement.between(simulation, self.rest, state)
            if not moved.within(lost_bound):
                return False, moved
            if state.time >= self.rest.time + seconds + simulation.config.rest_steps * control.dt and monitor.quiet():
                break  # in balance under the whole push
        near = Displacement(c.push_distance * size, c.push_angle)
        stop = StopCriteria(lost_bound, lost_bound, np.inf, when_quiet=True)
        end = follow(simulation, monitor, self.rest, state, control, near=near, stop=stop, progress=progress)
        return end.stable, end.moved

    def bracket(self, most: int, guess: int | None, progress: Progress | None) -> tuple[int, PushRow]:
        """The largest held level, and the certificate's row."""
        level = largest_held(lambda one: self.held(one, progress), most, guess)
        lost = self.ends.get(level + 1)
        unit = self.simulation.config.push_step
        x, y, z = (np.round(self.direction, 12) + 0.0).tolist()
        return level, PushRow(
            direction=(x, y, z),
            held=round(level * unit, 9),
            lost=None if lost is None else round((level + 1) * unit, 9),
            trials=len(self.ends),
            lost_moved_m=finite(lost.distance) if lost else None,
            lost_turned_rad=finite(lost.angle) if lost else None,
        )


def grade(
    simulation: Simulation, rest: State, tolerance_factor: float, progress: Progress | None
) -> tuple[StabilityGrade | NotDone, list[str]]:
    """For every free body and direction the largest held and the smallest lost push, over the body's weight (lost is
    None if the largest tried push was held), the smallest of all held pushes, and the trials' warnings.

    Every trial has its own history. `tolerance_factor` is that to which the rest state was solved (StepControl).
    """
    c = simulation.config
    if not simulation.model.gravity.any():
        return NotDone(reason="without gravity there is no weight to compare a push with"), []
    most, steps = max(1, round(c.push_most / c.push_step)), 0
    quarter = max(1, c.push_directions // 4)  # directions in a quarter turn, after which many things look the same
    bodies: dict[str, BodyStability] = {}
    warnings: list[str] = []
    for index in simulation.free:
        rows: list[PushRow] = []
        found: list[int] = []
        for direction in directions(simulation.model.gravity, c.push_directions):
            pushes = PushTrials(simulation, rest, index, direction, tolerance_factor)
            guess = found[-quarter] if len(found) >= quarter else None
            level, row = pushes.bracket(most, guess, progress)
            found.append(level)
            rows.append(row)
            steps += pushes.steps
            warnings += pushes.warnings
        bodies[simulation.model.bodies[index].name] = BodyStability(min(row.held for row in rows), tuple(rows))
    graded = StabilityGrade(
        grade=min(body.grade for body in bodies.values()),
        bodies=bodies,
        trials=sum(row.trials for body in bodies.values() for row in body.directions),
        steps=steps,
        bounds=PushBounds(c.push_distance, c.push_angle, c.push_step),
    )
    return graded, warnings


def largest_held(held: Callable[[int], bool], most: int, guess: int | None) -> int:
    """Largest level 0..most that `held` is true for, if it is true up to some level and false above; 0 is not tried.

    Bisection takes log2(most + 1) trials, rounded up; with a guess, in strides that double away from it, at most two
    more than twice as many, and only two if the guess is right.
    """
    low, high = 0, most + 1
    if guess is not None:
        probe, stride = guess + 1, 1
        up = probe < high and held(probe)
        low, high = (probe, high) if up else (low, probe)
        while low < (probe := low + stride if up else high - stride) < high:
            holds = held(probe)
            low, high = (probe, high) if holds else (low, probe)
            if holds != up:
                break
            stride *= 2
    while high - low > 1:
        level = (low + high) // 2
        low, high = (level, high) if held(level) else (low, level)
    return low


def directions(gravity: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Unit vectors evenly around the vertical, first along x (along y where x is vertical), shape (count, 3)."""
    up = -gravity / np.linalg.norm(gravity)
    axis = np.eye(3)[0 if abs(up[0]) < 0.9 else 1]
    first = axis - (axis @ up) * up
    first /= np.linalg.norm(first)
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.asarray(np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(up, first))


def finite(value: float) -> float | None:
    """The value, or None if it is not finite, for JSON."""
    return value if np.isfinite(value) else None
