"""Coulomb's law between soft and soft, soft and rigid, rigid and soft: the same as between rigid bodies."""

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


KINDS = [("soft", "rigid"), ("rigid", "soft"), ("soft", "soft")]


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
    time, speed = result.history["time"], result.history["linear_speed"]
    expected = lab.gravity * (np.sin(angle) - MU_D * np.cos(angle))
    late = (time > 0.08) & (speed < 1.0)
    measured = np.polyfit(time[late], speed[late], 1)[0]
    # soft blocks shake while they slide; the mean is the law
    assert measured == pytest.approx(expected, rel=0.03)
