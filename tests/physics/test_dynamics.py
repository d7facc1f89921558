"""True-mass steps of the default method on their own: momentum, energy, frequency."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from solver.config import SolverConfig
from solver.model import Model
from solver.runtime import start
from solver.settle import Drop
from solver.state import start_state


@pytest.fixture(autouse=True)
def one_thread():
    """As in `settle`: small dense factorisations on many threads mostly wait for each other."""
    with threadpool_limits(1):
        yield


def undamped(body, **config):
    """A drop of one body without gravity and without material damping, and its start state."""
    start(2)
    one = Drop(Model((body,), np.zeros(3)), SolverConfig(**config))
    one.stepper.damping = 0.0
    one.stepper.weight = 1.0  # residuals in newtons: without gravity there is no weight to measure them by
    return one, start_state(one.model, one.soft)


def energy(one, state):
    """Kinetic and elastic energy [J]."""
    one.stepper.elastic_forces(state)
    return 0.5 * (one.soft.mass[:, None] * state.v**2).sum() + one.stepper.energy.sum()


def test_a_shaking_free_body_keeps_momentum_and_never_gains_energy(lab):
    """Internal forces sum to nothing and have no moment; backward Euler takes energy and never gives any."""
    blob = lab.soft("blob", lab.Capsule(0.05, 0.0), [0, 0, 0], E=3e4, cell=0.02)
    one, state = undamped(blob, newton_limit=30, linear_tolerance=1e-4)
    random = np.random.default_rng(0)
    arm = one.soft.rest
    state.v = 0.3 + np.cross([0.0, 2.0, 1.0], arm) + 5.0 * arm * random.normal(size=3)
    mass = one.soft.mass[:, None]
    before, spin, energies = (mass * state.v).sum(0), np.cross(state.x, mass * state.v).sum(0), [energy(one, state)]
    tolerance, dt, steps = 1e-6, 1e-3, 50
    for _ in range(steps):
        earlier = state.v
        state, report = one.stepper.advance(state, dt, tolerance)
        # no moment about the new positions: x' x v' = x' x v = x x v + dt v' x v, the loss of first order in dt
        spin += dt * np.cross(state.v, mass * earlier).sum(0)
        assert report.residual <= tolerance
        energies.append(energy(one, state))
    # each step leaves a force of at most the tolerance on the body as a whole
    assert (mass * state.v).sum(0) == pytest.approx(before, abs=steps * dt * tolerance)
    drift = 0.5 * (before**2).sum() / mass.sum()
    assert energies[-1] - drift < 0.7 * (energies[0] - drift)
    assert (np.diff(energies) < 1e-9 * energies[0]).all()
    assert np.cross(state.x, mass * state.v).sum(0) == pytest.approx(spin, abs=steps * dt * tolerance)


def test_a_bar_swings_lengthwise_with_its_first_period(lab):
    """T = 4 L sqrt(rho / E) for a bar held at one end, nu = 0; release from a uniform stretch."""
    E, rho, length = 1e6, 1000.0, 0.4
    bar = lab.soft("bar", lab.Box(np.array([length, 0.04, 0.04])), [length / 2, 0, 0], E=E, nu=0.0, rho=rho, cell=0.02,
                   held=np.s_[0], fixed=True)  # fmt: skip
    one, state = undamped(bar)
    period = 4.0 * length * np.sqrt(rho / E)
    mode = np.sin(np.pi * one.soft.rest[:, 0] / (2.0 * length))
    state.x[:, 0] += 1e-3 * mode
    dt = period / 100
    shape = one.soft.mass * mode
    swing = [shape @ (state.x[:, 0] - one.soft.rest[:, 0])]
    for _ in range(170):
        state, _ = one.stepper.advance(state, dt, 1e-3)
        swing.append(shape @ (state.x[:, 0] - one.soft.rest[:, 0]))
    swing = np.array(swing)
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    exact = crossings + swing[crossings] / (swing[crossings] - swing[crossings + 1])
    measured = 2.0 * np.diff(exact).mean() * dt
    # backward Euler: omega_h = atan(omega dt) / dt, so (omega dt)^2 / 3 = 1.3e-3 longer; linear cells with lumped mass:
    # (pi / (2 n))^2 / 24 = 3e-4 longer for n = 20; the fictitious layer of 0.1 % stiffness and the padding cells 0.2 %
    assert measured == pytest.approx(period, rel=5e-3)
    # amplitude per step 1 / sqrt(1 + (omega dt)^2)
    decay = (1.0 + (2.0 * np.pi / 100) ** 2) ** (-0.5 * 100)
    peaks = [swing[i] for i in range(1, len(swing) - 1) if swing[i] > swing[i - 1] and swing[i] >= swing[i + 1]]
    assert peaks[0] / swing[0] == pytest.approx(decay, rel=0.03)
