"""Criteria for a drop having come to rest: its signals after every step, judged over a window, for every method
alike."""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from solver.certificate import CertificateRow, History, SignalRows
from solver.config import SolverConfig
from solver.errors import UnstableStep

NEARLY = 10.0  # times the threshold of the speed: slower motion is nearly at rest [-]
STALLED = 0.9  # of the speed half a window ago: motion faster than that is not slowing down [-]


@dataclass(frozen=True, eq=False, slots=True)
class Signals:
    """Signals measured by the solver after one step."""

    time: float
    """Time [s]."""
    linear_speed: float
    """Largest speed of a free body's centre of mass [m/s]."""
    angular_speed: float
    """Largest angular speed of a free rigid body [rad/s]."""
    particle_speed: float
    """Largest speed of a soft particle [m/s]."""
    center: NDArray[np.float64]
    """Centre of mass of all free bodies [m], shape (3,)."""
    box: NDArray[np.float64]
    """Joint axis-aligned box of the free bodies [m], shape (6,)."""
    force_residual: float
    """Unbalanced force on the worst free body over its weight, or over its load if that is larger [-]."""
    torque_residual: float
    """Unbalanced torque about its centre over the same force times half its size [-]."""
    newton: int
    """Newton iterations of the step; mls: explicit steps of the interval."""
    linear: int
    """Iterations of the linear solver; mls: 0."""

    @property
    def speed(self) -> float:
        """Largest of all linear speeds [m/s]."""
        return max(self.linear_speed, self.particle_speed)


Progress = Callable[[int, float, Signals], None]
"""Callback after every step: its number, the time [s], its signals."""


def history_of(signals: list[Signals]) -> History:
    """A list of signals as columns."""
    return History(**{one.name: np.array([getattr(s, one.name) for s in signals]) for one in fields(History)})


class RestMonitor:
    """Signals of one simulation so far, and whether the latest ones mean rest."""

    def __init__(self, config: SolverConfig, gravity: float, length: float) -> None:
        """`gravity` > 0 [m/s^2] and the size of the largest free body [m] scale the thresholds."""
        self.length = length
        self.steps = config.rest_steps
        """Number of steps in a window."""
        self.speed = config.rest_speed * float(np.sqrt(gravity * length))
        """Largest speed at rest [m/s]."""
        self.drift = config.rest_drift * length
        """Largest change of a position over a window [m]."""
        self.residual = config.rest_residual
        self.signals: list[Signals] = []

    def record(self, signals: Signals, progress: Progress | None) -> None:
        """Add the signals of a step and report them to `progress`; raises UnstableStep if a signal is not finite."""
        measured = (
            signals.linear_speed, signals.angular_speed, signals.particle_speed, *signals.center, *signals.box,
            signals.force_residual, signals.torque_residual,
        )  # fmt: skip
        if not np.isfinite(measured).all():
            raise UnstableStep(f"t = {signals.time:.5f} s: a speed, place or residual of the bodies is not finite")
        self.signals.append(signals)
        if progress is not None:
            progress(len(self.signals), signals.time, signals)

    def window(self, begin: int = 0) -> list[Signals]:
        """The latest signals that are judged together, none from before step `begin`."""
        return self.signals[begin:][-self.steps :]

    def rows(self, begin: int = 0) -> SignalRows:
        """Value, threshold and margin of every rest signal over the window."""
        return self.judge(self.window(begin))

    def judge(self, window: list[Signals]) -> SignalRows:
        """The same for given steps."""
        return SignalRows(
            linear_speed=CertificateRow.at_most(max(s.linear_speed for s in window), self.speed),
            angular_speed=CertificateRow.at_most(
                max(s.angular_speed for s in window), self.speed / (0.5 * self.length)
            ),
            particle_speed=CertificateRow.at_most(max(s.particle_speed for s in window), self.speed),
            center_drift=CertificateRow.at_most(largest_change([s.center for s in window]), self.drift),
            box_change=CertificateRow.at_most(largest_change([s.box for s in window]), self.drift),
            force_residual=CertificateRow.at_most(max(s.force_residual for s in window), self.residual),
            torque_residual=CertificateRow.at_most(max(s.torque_residual for s in window), self.residual),
        )

    def complete(self) -> bool:
        """Return whether there is a complete window to judge."""
        return len(self.signals) >= self.steps

    def quiet(self) -> bool:
        """Return whether no signal was above its threshold over a complete window."""
        return self.complete() and not self.rows().exceeded

    def creeping(self) -> bool:
        """Whether the bodies are in balance and slow over a complete window, yet neither quiet nor slowing down."""
        if not self.complete() or not (exceeded := self.rows().exceeded):
            return False
        half = self.steps // 2
        early, late = (max(s.speed for s in part) for part in (self.window()[:half], self.window()[half:]))
        balanced = not exceeded.keys() & {"force_residual", "torque_residual"}
        return balanced and late > STALLED * early and late < NEARLY * self.speed


def largest_change(places: list[NDArray[np.float64]]) -> float:
    """Largest range of any coordinate [m] over places of shape (k,)."""
    return float(np.abs(np.ptp(np.array(places), axis=0)).max())
