"""When a drop counts as at rest."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.errors import UnstableStep
from solver.rest import NEARLY, RestMonitor, Signals, history_of

CONFIG = SolverConfig()
GRAVITY, LENGTH = 10.0, 0.1  # sqrt(g L) = 1 m/s
SPEED, DRIFT = CONFIG.rest_speed, CONFIG.rest_drift * LENGTH
STILL = Signals(0.0, 0.0, 0.0, 0.0, np.zeros(3), np.zeros(6), 0.0, 0.0, 1, 2)


def monitor(*signals: Signals) -> RestMonitor:
    """What was measured so far."""
    one = RestMonitor(CONFIG, GRAVITY, LENGTH)
    for each in signals:
        one.record(each, None)
    return one


def test_thresholds_follow_size_and_gravity() -> None:
    """Speeds go by sqrt(g L), places by L, angular speeds by the speed over half the size."""
    rows = monitor(STILL).rows()
    assert rows.linear_speed.threshold == rows.particle_speed.threshold == pytest.approx(SPEED)
    assert rows.angular_speed.threshold == pytest.approx(SPEED / (0.5 * LENGTH))
    assert rows.center_drift.threshold == rows.box_change.threshold == pytest.approx(DRIFT)
    assert rows.force_residual.threshold == rows.torque_residual.threshold == CONFIG.rest_residual


def test_rest_takes_a_whole_window() -> None:
    """One step less is not rest, however still."""
    assert not monitor(*[STILL] * (CONFIG.rest_steps - 1)).quiet()
    assert monitor(*[STILL] * CONFIG.rest_steps).quiet()


@pytest.mark.parametrize(
    "name", ["linear_speed", "angular_speed", "particle_speed", "force_residual", "torque_residual"]
)
def test_what_is_not_a_number_is_no_rest(name: str) -> None:
    """It breaks the step that it was measured after, as it compares with no threshold."""
    broken: dict[str, Any] = {name: np.nan}
    with pytest.raises(UnstableStep, match="not finite"):
        monitor(replace(STILL, **broken))
    with pytest.raises(UnstableStep, match="not finite"):
        monitor(replace(STILL, center=np.array([0.0, np.nan, 0.0])))


EXCEEDING = {
    "linear_speed": replace(STILL, linear_speed=1.01 * SPEED),
    "angular_speed": replace(STILL, angular_speed=1.01 * SPEED / (0.5 * LENGTH)),
    "particle_speed": replace(STILL, particle_speed=1.01 * SPEED),
    "force_residual": replace(STILL, force_residual=1.01 * CONFIG.rest_residual),
    "torque_residual": replace(STILL, torque_residual=1.01 * CONFIG.rest_residual),
    "center_drift": replace(STILL, center=np.array([0.0, 1.01 * DRIFT, 0.0])),
    "box_change": replace(STILL, box=np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.01 * DRIFT])),
}
"""A step whose signal makes a row of this name exceed its threshold by 1 %, beside steps at rest."""


@pytest.mark.parametrize("name", EXCEEDING)
@pytest.mark.parametrize("at", [0, CONFIG.rest_steps - 1])
def test_one_signal_of_one_step_above_its_threshold_is_not_rest(name: str, at: int) -> None:
    """Anywhere in the window; once that step has left it, it is."""
    steps = [STILL] * CONFIG.rest_steps
    steps[at] = EXCEEDING[name]
    one = monitor(*steps)
    assert not one.quiet()
    assert one.rows().exceeded.keys() == {name}
    assert getattr(one.rows(), name).margin == pytest.approx(-0.01)
    for _ in range(CONFIG.rest_steps):
        one.record(STILL, None)
    assert one.quiet()


@pytest.mark.parametrize(("start", "end", "residual", "creeps"), [
    (2.0, 2.0, 0.0, True),  # slow, and as fast as before
    (2.0, 1.5, 0.0, False),  # slowing
    (2.0, 2.0, 2.0, False),  # pushed
    (1.5 * NEARLY, 1.5 * NEARLY, 0.0, False),  # on its way
    (0.5, 0.5, 0.0, False),  # at rest
])  # fmt: skip
def test_what_neither_rests_nor_slows_creeps(start: float, end: float, residual: float, creeps: bool) -> None:
    """Speeds over the threshold at both ends of the window, unbalanced force over its own."""
    speeds = np.linspace(start, end, CONFIG.rest_steps) * SPEED
    force = residual * CONFIG.rest_residual
    assert monitor(*[replace(STILL, linear_speed=float(s), force_residual=force) for s in speeds]).creeping() is creeps


def test_a_history_has_a_number_per_step() -> None:
    """In columns by name, floats and counts apart."""
    history = history_of([replace(STILL, time=0.1 * k, newton=k) for k in range(4)])
    assert history.time == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert history.newton.tolist() == [0, 1, 2, 3]
    assert history.newton.dtype == history.linear.dtype == np.int64


def test_everybody_who_listens_is_told_of_every_step() -> None:
    """Its number from 1, its time, its signals."""
    told: list[tuple[int, float, Signals]] = []
    one = RestMonitor(CONFIG, GRAVITY, LENGTH)
    second = replace(STILL, time=0.5)
    for signals in (STILL, second):
        one.record(signals, lambda *each: told.append(each))
    assert told == [(1, 0.0, STILL), (2, 0.5, second)]
