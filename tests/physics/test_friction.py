"""Coulomb's law between soft and soft, soft and rigid, rigid and soft: the same as between rigid bodies."""

from dataclasses import replace

import numpy as np
import pytest

MU_S, MU_D = 0.5, 0.4


def pair(lab, kinds):
    """A block on a slab, each soft or rigid."""
    block_kind, slab_kind = kinds
    mu = (MU_S, MU_D)
    size = np.array([0.12, 0.12, 0.06])
    if slab_kind == "soft":
        slab = lab.soft("slab", lab.Box(np.array([0.8, 0.3, 0.05])), [0.2, 0, -0.025], E=2e6, rho=100.0, cell=0.025,
                        held=np.s_[:, :, 0], fixed=True, loaded=True, mu=mu)  # fmt: skip
    else:
        slab = lab.floor(mu=mu)
    if block_kind == "soft":
        block = lab.soft("block", lab.Box(size), [0, 0, 0.0302], E=1e6, rho=300.0, cell=0.02, mu=mu)
    else:
        block = lab.rigid("block", lab.Box(size), [0, 0, 0.0302], mass=0.3, mu=mu, edge=0.02)
    return block, slab


def incline(lab, angle):
    """Gravity as felt on an incline that runs down along x."""
    return lab.gravity * np.array([np.sin(angle), 0.0, -np.cos(angle)])


KINDS = [("soft", "rigid"), pytest.param(("rigid", "soft"), marks=pytest.mark.long), ("soft", "soft")]


@pytest.mark.slow
@pytest.mark.parametrize("kinds", KINDS)
def test_a_block_stays_below_the_friction_angle(lab, kinds):
    """tan(a) = 0.8 mu_s: at rest within a few millimetres of where it was put down."""
    result = lab.drop(*pair(lab, kinds), gravity=incline(lab, np.arctan(0.8 * MU_S)))
    assert result.verdict == "at_rest"
    assert abs(result.bodies[0].translation[0]) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("kinds", KINDS)
def test_a_block_slides_as_fast_as_a_rigid_one(lab, kinds):
    """tan(a) = 1.6 mu_s: a = g (sin a - mu_d cos a)."""
    angle = np.arctan(1.6 * MU_S)
    result = lab.drop(*pair(lab, kinds), gravity=incline(lab, angle), step_limit=60)
    time, speed = result.history.time, result.history.linear_speed
    expected = lab.gravity * (np.sin(angle) - MU_D * np.cos(angle))
    late = (time > 0.08) & (speed < 1.0)
    measured = np.polyfit(time[late], speed[late], 1)[0]
    # soft blocks shake while they slide; the mean is the law
    assert measured == pytest.approx(expected, rel=0.03)


EVERY_PAIR = [*KINDS, ("rigid", "rigid")]


@pytest.mark.slow
@pytest.mark.parametrize("kinds", EVERY_PAIR)
@pytest.mark.parametrize(("share", "stays"), [(0.95, True), (1.05, False)])
def test_a_block_slides_iff_the_slope_beats_static_friction(lab, kinds, share, stays):
    """tan(a) <= mu, known to a twentieth; mu_d = mu_s, since some points slip while the load builds up."""
    block, slab = (replace(body, static_friction=0.5, dynamic_friction=0.5) for body in pair(lab, kinds))
    result = lab.drop(block, slab, gravity=incline(lab, np.arctan(share * 0.5)), step_limit=80)
    if stays:
        assert result.verdict == "at_rest"
        # it lands after a fall of 0.2 mm, and shear of the soft bodies is some micrometres
        assert abs(result.bodies[0].translation[0]) < 5e-4
        return
    time, speed = result.history.time, result.history.linear_speed
    expected = lab.gravity * 0.05 * 0.5 * np.cos(np.arctan(1.05 * 0.5))  # g (sin a - mu cos a) = 0.217 m/s^2
    late = (time > 0.1) & (time < 0.6)
    # a balance of two forces twenty times larger: each known to the 0.5 % at which steps are solved makes 20 %
    assert np.polyfit(time[late], speed[late], 1)[0] == pytest.approx(expected, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("E", [1e5, pytest.param(1e6, marks=pytest.mark.long)])
def test_a_foam_block_slides_on_foam_as_fast_as_a_rigid_one(lab, E):
    """a = g (sin a - mu_d cos a) does not depend on stiffness: internal damping is no brake."""
    size, mu = np.array([0.12, 0.12, 0.06]), (MU_S, MU_D)
    slab = lab.soft("slab", lab.Box(np.array([0.8, 0.3, 0.05])), [0.2, 0, -0.025], E=E, rho=100.0, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True, mu=mu)  # fmt: skip
    block = lab.soft("block", lab.Box(size), [0, 0, 0.0302], E=E, rho=300.0, cell=0.02, mu=mu)
    angle = np.arctan(1.6 * MU_S)
    result = lab.drop(block, slab, gravity=incline(lab, angle), step_limit=60)
    time, speed = result.history.time, result.history.linear_speed
    late = (time > 0.08) & (speed < 1.0)
    expected = lab.gravity * (np.sin(angle) - MU_D * np.cos(angle))
    # steps solved to 1 % of the weight while moving, against the 0.41 of it that accelerate
    assert np.polyfit(time[late], speed[late], 1)[0] == pytest.approx(expected, rel=0.03)


def test_a_ball_on_a_steep_slope_slips_and_spins_up(lab):
    """tan(a) > 7/2 mu: a = g (sin a - mu cos a) and alpha = 5/2 mu g cos(a) / R."""
    radius, mu = 0.05, 0.1
    angle = np.arctan(0.6)
    ball = lab.rigid("ball", lab.Capsule(radius, 0.0), [-0.2, 0, 0.0501], mu=(mu, mu), edge=0.003, spacing=0.0015)
    result = lab.drop(ball, lab.floor(mu=(mu, mu)), gravity=incline(lab, angle), step_limit=50)
    history = result.history
    late = (history.time > 0.08) & (history.linear_speed < 1.3)
    series = {"linear_speed": history.linear_speed, "angular_speed": history.angular_speed}
    rate = {name: np.polyfit(history.time[late], one[late], 1)[0] for name, one in series.items()}
    # steps solved to 1 % of the weight, against the 0.43 that accelerate; of friction, 0.086 of the weight, facets of
    # 3 mm (sagitta 22 um) make the load shake
    assert rate["linear_speed"] == pytest.approx(lab.gravity * (np.sin(angle) - mu * np.cos(angle)), rel=0.02)
    assert rate["angular_speed"] == pytest.approx(2.5 * mu * lab.gravity * np.cos(angle) / radius, rel=0.05)
