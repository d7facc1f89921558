"""Steps of one body on its own, without gravity: momentum, energy, frequency, with backward Euler on the way to rest
and with true-mass elastodynamics (`inertia`); and the rebound of a ball."""

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop
from solver.tl.simulation import StepControl


@pytest.fixture(autouse=True)
def one_thread():
    """As in `settle`: small dense factorisations on many threads mostly wait for each other."""
    with threadpool_limits(1):
        yield


def alone(body, **config):
    """A drop of one body without gravity and without material damping, and its start state."""
    start(2)
    one = ImplicitDrop(Model((body,), np.zeros(3)), SolverConfig(**config))
    one.stepper.elastic.damping = 0.0
    one.stepper.weights[:] = 1.0  # residuals in newtons: without gravity there is no weight to measure them by
    return one, one.start_state()


def shaking(lab, **config):
    """A free soft ball that flies, turns and shakes, solved closely enough to judge what it keeps."""
    blob = lab.soft("blob", lab.Capsule(0.05, 0.0), [0, 0, 0], E=3e4, cell=0.02)
    one, state = alone(blob, newton_limit=30, linear_tolerance=1e-4, **config)
    arm = one.soft.rest
    state.v = 0.3 + np.cross([0.0, 2.0, 1.0], arm) + 5.0 * arm * np.random.default_rng(0).normal(size=3)
    return one, state


def energy(one, state):
    """Kinetic and elastic energy [J]."""
    elastic = one.stepper.elastic
    elastic.forces(state)
    ties = 0.5 * (state.x * (elastic.ghost @ state.x)).sum()
    return 0.5 * (one.soft.mass[:, None] * state.v**2).sum() + elastic.energy.sum() + ties


def swinging(lab, per_period, steps, tolerance, **config):
    """(first period of a bar held at one end, nu = 0, by T = 4 L sqrt(rho / E); as measured; swing after each step):
    released from its first mode."""
    E, rho, length = 1e6, 1000.0, 0.4
    bar = lab.soft("bar", lab.Box(np.array([length, 0.04, 0.04])), [length / 2, 0, 0], E=E, nu=0.0, rho=rho, cell=0.02,
                   held=np.s_[0], fixed=True)  # fmt: skip
    one, state = alone(bar, **config)
    period = 4.0 * length * np.sqrt(rho / E)
    mode = np.sin(np.pi * one.soft.rest[:, 0] / (2.0 * length))
    state.x[:, 0] += 1e-3 * mode
    shape = one.soft.mass * mode
    amplitudes = [shape @ (state.x[:, 0] - one.soft.rest[:, 0])]
    for _ in range(steps):
        state, _ = one.stepper.step(state, period / per_period, tolerance)
        amplitudes.append(shape @ (state.x[:, 0] - one.soft.rest[:, 0]))
    swing = np.array(amplitudes)
    crossings = np.flatnonzero(np.diff(np.sign(swing)))
    exact = crossings + swing[crossings] / (swing[crossings] - swing[crossings + 1])
    return period, 2.0 * np.diff(exact).mean() * period / per_period, swing


@pytest.mark.slow
def test_a_shaking_free_body_keeps_momentum_and_never_gains_energy(lab):
    """Internal forces sum to nothing and have no moment; backward Euler takes energy and never gives any."""
    one, state = shaking(lab)
    mass = one.soft.mass[:, None]
    before, spin, energies = (mass * state.v).sum(0), np.cross(state.x, mass * state.v).sum(0), [energy(one, state)]
    tolerance, dt, steps = 1e-6, 1e-3, 50
    for _ in range(steps):
        earlier = state.v
        state, report = one.stepper.step(state, dt, tolerance)
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


@pytest.mark.slow
@pytest.mark.parametrize("theta", [0.5, 0.52])
def test_with_inertia_a_shaking_free_body_keeps_momentum_and_gains_no_energy(lab, theta):
    """The midpoint rule (theta = 1/2) keeps linear and angular momentum, and energy to O(dt^2) without drift; above 1/2
    energy falls. Forces are solved to 1e-6 N: momentum changes by at most that times the time."""
    one, state = shaking(lab, inertia=True, inertia_theta=theta)
    mass = one.soft.mass[:, None]
    linear, angular = (mass * state.v).sum(0), np.cross(state.x, mass * state.v).sum(0)
    drift = 0.5 * (linear**2).sum() / mass.sum()
    energies, tolerance, steps = [energy(one, state) - drift], 1e-6, 100
    dt = one.wave_step
    for _ in range(steps):
        state, report = one.stepper.step(state, dt, tolerance)
        assert report.residual <= tolerance
        energies.append(energy(one, state) - drift)
    lost = steps * dt * tolerance
    assert (mass * state.v).sum(0) == pytest.approx(linear, abs=lost)
    if theta == 0.5:
        spin = np.cross(state.x, mass * state.v).sum(0)
        assert spin == pytest.approx(angular, abs=1e-4 * float(np.linalg.norm(angular)))
        # 20 steps a period and less for the higher modes that the start shakes too: (omega dt)^2 / 12 of the energy
        assert energies[-20:] == pytest.approx(np.full(20, energies[0]), rel=0.03)
    else:
        assert energies[-1] < energies[0]
        assert max(energies) <= 1.02 * energies[0]


@pytest.mark.slow
def test_a_bar_swings_lengthwise_with_its_first_period(lab):
    """Backward Euler: omega_h = atan(omega dt) / dt, so (omega dt)^2 / 3 = 1.3e-3 longer; linear cells with lumped
    mass: (pi / (2 n))^2 / 24 = 3e-4 longer for n = 20; the fictitious layer of 0.1 % stiffness and the padding cells
    0.2 %. Amplitude per step: 1 / sqrt(1 + (omega dt)^2)."""
    period, measured, swing = swinging(lab, per_period=100, steps=170, tolerance=1e-3)
    assert measured == pytest.approx(period, rel=5e-3)
    decay = (1.0 + (2.0 * np.pi / 100) ** 2) ** (-0.5 * 100)
    peaks = [swing[i] for i in range(1, len(swing) - 1) if swing[i] > swing[i - 1] and swing[i] >= swing[i + 1]]
    assert peaks[0] / swing[0] == pytest.approx(decay, rel=0.03)


@pytest.mark.slow
def test_with_inertia_a_bar_swings_with_its_first_period_and_keeps_swinging(lab):
    """With 40 steps a period the theta method is (omega dt)^2 / 12 = 0.2 % too slow; 20 linear cells with lumped mass
    add 0.006 %. Damping ratio (theta - 1/2) omega dt: exp(-0.02 * (2 pi / 40) * 2 pi * 3) after three periods."""
    period, measured, swing = swinging(lab, per_period=40, steps=130, tolerance=1e-4, inertia=True)
    assert measured == pytest.approx(period, rel=0.01)
    assert swing[110:].max() == pytest.approx(swing[0] * np.exp(-0.02 * (2 * np.pi / 40) * 2 * np.pi * 3), rel=0.02)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.slow
def test_with_inertia_a_thin_plate_rebounds_no_faster_than_it_came(lab):
    """It sinks in by a good part of its thickness on the way; springs that became stiffer then would throw it up."""
    slab = lab.soft("slab", lab.Box(np.array([0.3, 0.3, 0.1])), [0, 0, -0.05], E=1.2e4, cell=0.02,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    plate = lab.rigid("plate", lab.Box(np.array([0.08, 0.08, 0.006])), [0, 0, 0.004], mass=2.0, vertical=True,
                      edge=0.01, velocity=np.array([0.0, 0.0, -1.0]))  # fmt: skip
    start(2)
    one = ImplicitDrop(Model((plate, slab), np.array([0.0, 0.0, -lab.gravity])), SolverConfig(inertia=True))
    state, control, speeds = one.start_state(), StepControl(2e-3), list[float]()
    with threadpool_limits(1):
        while len(speeds) < 400 and (len(speeds) < 5 or speeds[-1] >= speeds[-2] or speeds[-1] < 0.0):
            step = one.step(state, control)
            state, control = step.state, step.control
            one.stiffen(state, step.report.contacts, step.signals)
            speeds.append(float(state.velocity[0, 2]))
    assert 0.0 < max(speeds) < -min(speeds)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("inertia", [True, False])
def test_a_ball_rebounds_from_an_elastic_slab_only_with_inertia(lab, inertia):
    """Without loss of material a heavy ball gets most of its speed back; the way to rest is critically damped."""
    slab = lab.soft("slab", lab.Box(np.array([0.3, 0.3, 0.1])), [0, 0, -0.05], E=5e4, rho=60.0, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.06], mass=1.0)
    start(2)
    one = ImplicitDrop(Model((ball, slab), np.array([0.0, 0.0, -lab.gravity])), SolverConfig(inertia=inertia))
    state, control, lowest, highest = one.start_state(), StepControl(1e-3), np.inf, 0.0
    while state.time < 0.25:
        step = one.step(state, control)
        state, control = step.state, step.control
        lowest = min(lowest, state.velocity[0, 2])
        highest = max(highest, state.velocity[0, 2])
    if inertia:
        assert highest > 0.6 * -lowest
    else:
        assert highest < 0.1 * -lowest
