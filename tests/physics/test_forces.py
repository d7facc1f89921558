"""What rests is carried: contact forces against weights, and soft supports against what lies on them."""

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop
from solver.tl.simulation import StepControl

SHARE = 0.005  # of the weight: what the certificate allows to be unbalanced


def settled(lab, *bodies):
    """The result of a drop, the drop, and the state in which it ended."""
    start(2)
    one = ImplicitDrop(Model(bodies, np.array([0.0, 0.0, -lab.gravity])), SolverConfig(threads=2))
    end = one.approach(one.checked_start(), StepControl(one.config.step_seconds), None)
    result = one.judged(end, None)
    assert result.verdict == "at_rest"
    assert result.warnings == ()  # it withstood the kick, so the state is that of the result
    return result, one, end.state


def reaction(one, state, index):
    """Force with which the clamp of a soft body holds it [N]: minus the elastic forces on its held nodes."""
    nodes = one.query.soft_of[index].nodes
    force = one.stepper.elastic.forces(state)[nodes]
    return -force[one.soft.held[nodes]].sum(axis=0)


def foam(lab, **options):
    return lab.soft("foam", lab.Box(np.array([0.3, 0.3, 0.1])), [0, 0, 0.05], cell=0.02, held=np.s_[:, :, 0],
                    fixed=True, loaded=True, **options)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("rigid ball", marks=pytest.mark.sweep), "rigid block",
                                  pytest.param("soft block", marks=pytest.mark.long)])  # fmt: skip
def test_the_clamp_of_a_foam_block_carries_what_lies_on_it(lab, kind):
    """Through contact and elasticity the clamp feels the load's weight and nothing else."""
    size = np.array([0.1, 0.1, 0.06])
    if kind == "soft block":
        load = lab.soft("load", lab.Box(size), [0, 0, 0.131], E=2e4, rho=300.0, cell=0.02)
        weight = 300.0 * 0.1 * 0.1 * 0.06 * lab.gravity
    else:
        solid = lab.Capsule(0.04, 0.0) if kind == "rigid ball" else lab.Box(size)
        half = 0.04 if kind == "rigid ball" else 0.03
        load, weight = lab.rigid("load", solid, [0, 0, 0.101 + half], mass=0.5), 0.5 * lab.gravity
    result, one, state = settled(lab, load, foam(lab, E=3e4))
    # each of the two bodies may be unbalanced by the share, and moving nodes by the tolerance of a step
    assert reaction(one, state, 1) == pytest.approx([0.0, 0.0, weight], abs=2 * SHARE * weight)
    row = result.contacts[0]
    # faces are level, so the normal force is the weight; in a ball's dent friction carries a part of it
    if kind != "rigid ball":
        assert row.normal_force_n == pytest.approx(weight, rel=SHARE)
    assert np.hypot(row.normal_force_n, row.tangential_force_n) > (1 - SHARE) * weight
    assert result.certificate.signals.force_residual.value < SHARE


@pytest.mark.long
@pytest.mark.slow
def test_two_blocks_on_foam_add_up(lab):
    """The clamp carries both weights, and each contact its own."""
    left, right = (
        lab.rigid(name, lab.Box(np.full(3, 0.06)), [x, 0, 0.1302], mass=mass, edge=0.01)
        for name, x, mass in (("left", -0.08, 0.3), ("right", 0.08, 0.6))
    )
    result, one, state = settled(lab, left, right, foam(lab, E=3e4))
    total = 0.9 * lab.gravity
    assert reaction(one, state, 2) == pytest.approx([0.0, 0.0, total], abs=2 * SHARE * total)
    for row, mass in zip(result.contacts, (0.3, 0.6), strict=True):
        assert row.normal_force_n == pytest.approx(mass * lab.gravity, rel=SHARE)


@pytest.mark.slow
@pytest.mark.long
def test_a_plate_ten_thousand_times_as_heavy_rests_on_a_gram_of_foam(lab):
    """10 kg on 1 g: each of the foam's contacts carries the plate, and it shortens by N H / (E A) with E A in between
    that of free and of held faces."""
    E, side, height, mass = 1e7, 0.05, 0.02, 10.0
    little = lab.soft("little", lab.Box(np.array([side, side, height])), [0, 0, 0.5 * height + 2e-4], E=E, rho=20.0,
                      cell=0.005, edge=0.0025)  # fmt: skip
    plate = lab.rigid("plate", lab.Box(np.array([0.2, 0.2, 0.02])), [0, 0, height + 0.0106], mass=mass, edge=0.01)
    result, _, state = settled(lab, plate, little, lab.floor())
    assert [row.normal_force_n for row in result.contacts] == pytest.approx([mass * lab.gravity] * 2, rel=1e-2)
    thickness = state.center[0][2] - 0.01
    shortened = mass * lab.gravity * height / (E * side**2)
    confined = shortened * 1.3 * 0.4 / 0.7  # nu = 0.3: over E (1 - nu) / ((1 + nu) (1 - 2 nu))
    assert confined < height - thickness < shortened + 1e-4  # and the penetration targets of both contacts


@pytest.mark.slow
@pytest.mark.sweep
def test_a_stack_of_five_foam_blocks_stands(lab):
    """Every interface carries what is above it, and the stack shortens by the sum of its strains.

    nu = 0: block k of 5 shortens by (its own weight / 2 + all above) H / (E A), together 5^2 / 2 rho g H^2 / E.
    """
    E, rho, side, count = 2e5, 200.0, 0.1, 5
    blocks = [
        lab.soft(f"block{k}", lab.Box(np.full(3, side)), [0, 0, (k + 0.5) * side + (k + 1) * 2e-4], E=E, nu=0.0,
                 rho=rho, cell=0.025, mu=(0.8, 0.7), edge=0.0125)
        for k in range(count)
    ]  # fmt: skip
    result = lab.drop(*blocks, lab.floor(mu=(0.8, 0.7)))
    assert result.verdict == "at_rest"
    for body in result.bodies[:count]:
        assert np.abs(body.translation[:2]).max() < 1e-3
    one = rho * side**3 * lab.gravity
    for row in result.contacts:
        names = sorted(n for n in (row.a, row.b) if n != "floor")
        above = count - int(names[-1][-1])
        # unbalanced forces of all blocks above may add up
        assert row.normal_force_n == pytest.approx(above * one, abs=SHARE * above * one)
    shortened = count * side - result.bodies[count - 1].vertices[:, 2].max()
    strain = rho * lab.gravity * side / E
    # five interfaces with at most 0.06 mm of penetration each, against 12.3 mm
    assert shortened == pytest.approx(0.5 * count**2 * strain * side, rel=0.04, abs=count * 6e-5)
