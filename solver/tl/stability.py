"""How far a verified rest state can be pushed before it is lost.

Each free body in turn is pushed horizontally at its centre of mass, in directions all around, by a force that grows to
a share of its weight, stays, and is taken away. The push is held if everything then comes to rest where it was; a
search brackets the largest one that is. For a rigid body on a level rigid floor the answer is a formula: it slides at
mu_s, or tips at (distance of the edge) / (height of the centre of mass), whichever is less. The same number is the
horizontal acceleration, in units of gravity, that what it stands on may have.

No randomness, and every trial starts from the same state: same model and config, same grade.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solver.certificate import BodyStability, NotDone, PushBounds, PushRow, StabilityGrade
from solver.contact.rolling import law_compliant
from solver.errors import UnstableStep
from solver.model.state import State
from solver.rest import Progress, RestMonitor
from solver.tl.disturbance import Displacement, StopCriteria, follow, stopped
from solver.tl.simulation import Simulation, StepControl

# half its size away, or turned by 60 degrees: lost, whatever comes after [-], [rad]
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
    """As in StepControl, of the rest state."""
    ends: dict[int, Displacement] = field(default_factory=dict)
    """How far bodies had moved when each push, in units of push_step, was judged."""
    steps: int = 0
    warnings: list[str] = field(default_factory=list)

    def held(self, level: int, progress: Progress | None) -> bool:
        """Whether everything comes back to rest after a push of `level` times push_step of the weight.

        A push that the solver cannot follow is lost, with a warning.
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
        """The largest level held, and the certificate's row."""
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
    """For every free body and direction the largest push held and the smallest lost, over the body's weight (lost is
    None where the largest one tried was held), and the smallest of all held ones; and the trials' warnings.

    Every trial has a history of its own. `tolerance_factor` is that to which the rest state was solved (StepControl).
    """
    c = simulation.config
    if not simulation.model.gravity.any():
        return NotDone(reason="without gravity there is no weight to compare a push with"), []
    most, steps = max(1, round(c.push_most / c.push_step)), 0
    quarter = max(1, c.push_directions // 4)  # directions back to a quarter turn, after which many things look the same
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

    Bisection, log2(most + 1) rounded up trials; with a guess in strides that double away from it, at most two more than
    twice as many, and two where it is right.
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
    """For JSON."""
    return value if np.isfinite(value) else None
