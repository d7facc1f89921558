"""Disturb a rest state and follow it until it is quiet again, has gone, or the time is up.

A rest state is verified with a small kick; a graded push (stability.py) ends in the same way: let go and watch.
"""

from dataclasses import dataclass, replace

import numpy as np

from solver.certificate import KickCheck, KickRow
from solver.config import SolverConfig
from solver.contact.rolling import law_compliant
from solver.model.state import State
from solver.rest import Progress, RestMonitor, Signals
from solver.tl.simulation import Simulation, StepControl

KICK_NOISE = 0.1  # share of a kick's speed below which growth is the noise of solving to a tolerance
# of a speed in a quarter of a period's steps: what grows slower rolls in a neutral balance, it does not fall over
GROWTH = 1.25


@dataclass(frozen=True, slots=True)
class Displacement:
    """How far free bodies have moved."""

    distance: float
    """Of a centre of mass [m]."""
    angle: float
    """Of a body [rad]."""

    @classmethod
    def between(cls, simulation: Simulation, rest: State, state: State) -> "Displacement":
        """Largest of all free bodies."""
        return cls(*simulation.distance(rest, state))

    def within(self, bound: "Displacement") -> bool:
        """Neither farther nor turned more than the bound."""
        return self.distance <= bound.distance and self.angle <= bound.angle


@dataclass(frozen=True, slots=True)
class StopCriteria:
    """When to stop following what has not come to rest."""

    at_once: Displacement
    """Beyond it at once."""
    at_period_end: Displacement
    """Beyond it at the end of a period."""
    speed: float
    """Faster at the end of a period, over the kick's speed [-]."""
    when_quiet: bool = False
    """At rest over a window too: not after a kick, which is so small that a lost balance shows only later."""


@dataclass(frozen=True, eq=False, slots=True)
class Response:
    """How a disturbance ended."""

    state: State
    control: StepControl
    """For a step that goes on from there."""
    stable: bool
    """At rest again, near where it was."""
    moved: Displacement
    """From the rest state to the end."""
    farthest: float
    """Largest distance on the way [m]."""
    speed_left: float
    """Largest speed at the end over the kick's, 0 below the rest thresholds [-]."""
    growing: bool
    segments: int
    """Periods of kick_seconds that it took."""


def kick(
    simulation: Simulation, monitor: RestMonitor, rest: State, control: StepControl, progress: Progress | None
) -> tuple[State, StepControl, KickCheck]:
    """Kick a rest state and follow it: where that ends, what a further step takes over, whether the rest was stable.

    `control` is that of the rest state; `monitor` takes the signals.
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
    """A rest state in which everything free has got the kick, seeded, bonded bodies as one."""
    c = simulation.config
    random = np.random.default_rng(c.seed)
    state = stopped(rest)
    for group in bonded_groups(simulation):
        direction, axis = (d / np.linalg.norm(d) for d in random.normal(size=(2, 3)))
        mass = np.array([simulation.mass[i] for i in group])
        centers = np.array([simulation.center(state, i) for i in group])
        arms = centers - mass @ centers / mass.sum()
        longest_arm = float(np.linalg.norm(arms, axis=1).max())
        # however long the arms, no member gets more than twice the kick's speed
        spin = min(c.kick_angular_speed, c.kick_speed / max(longest_arm, 1e-12)) * axis
        for i, arm in zip(group, arms, strict=True):
            simulation.add_rigid_motion(state, i, c.kick_speed * direction + np.cross(spin, arm), spin)
    return state


def bonded_groups(simulation: Simulation) -> list[list[int]]:
    """Free bodies by the free bodies that they are bonded to, directly or through others: each group moves as one."""
    groups: list[list[int]] = []
    for i in simulation.free:
        bodies = simulation.model.bodies
        joined = [g for g in groups if any(simulation.model.bonded(bodies[i], bodies[j]) for j in g)]
        groups = [g for g in groups if g not in joined] + [sorted([i, *(j for g in joined for j in g)])]
    return sorted(groups)


def stopped(rest: State) -> State:
    """A rest state without the last of its motion."""
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
    """Let a disturbed state go on from where it is; it is stable if it comes to rest within `near` of the rest state.

    Rolling resistance gives way meanwhile (rolling.py). `monitor` takes the signals; steps begin anew at half the
    longest that follows a loss of balance.
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
    """Largest speed at the end over the kick's (0 where it is below the rest thresholds) and whether it still grows.

    An unstable balance gains speed by a factor e in about sqrt(L / 2g): 0.1 s for L = 0.2 m, and GROWTH in a quarter of
    half a second for L = 6 m. A wobble may look like it for half its period, so growth alone only asks for more time.
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
