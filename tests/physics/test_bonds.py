"""Bonded bodies stay together, carry what hangs on them, and move as one."""

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.errors import ModelError
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop, settle
from solver.tl.stability import bonded_groups, kicked_state


def settled(lab, bonds, *bodies, **config):
    model = Model(tuple(bodies), np.array([0.0, 0.0, -lab.gravity]), bonds=bonds)
    return settle(model, SolverConfig(threads=2, **config))


def test_a_body_bonded_under_a_fixed_one_hangs_there(lab):
    """The bond carries m g; it is made to stretch 0.05 mm under ten times that."""
    ceiling = lab.rigid("ceiling", lab.Box(np.array([0.2, 0.2, 0.02])), [0, 0, 0.01], fixed=True)
    lamp = lab.rigid("lamp", lab.Box(np.array([0.06, 0.06, 0.06])), [0, 0, -0.0305], mass=0.7)
    result = settled(lab, (("ceiling", "lamp"),), ceiling, lamp)
    bond = result.certificate.bonds[0]
    assert result.verdict == "at_rest"
    assert result.bodies[1].translation == pytest.approx(np.zeros(3), abs=1e-5)
    assert bond.force_n == pytest.approx(0.7 * lab.gravity, rel=5e-3)
    assert bond.stretch_m <= 0.1 * 5e-5 * 1.05


@pytest.mark.parametrize("bonded", [True, False])
def test_two_bonded_boxes_tip_about_the_edge_that_one_of_them_would_stay_behind(lab, bonded):
    """The lower box alone stands; with a heavy one bonded to its side the common centre of mass is beyond its edge."""
    table = lab.rigid("table", lab.Box(np.array([0.3, 0.3, 0.04])), [0, 0, -0.02], fixed=True, edge=0.02)
    box = lab.rigid("box", lab.Box(np.array([0.06, 0.06, 0.06])), [0.119, 0, 0.0302], mass=0.3)
    arm = lab.rigid("arm", lab.Box(np.array([0.12, 0.06, 0.02])), [0.2095, 0, 0.0402], mass=0.6)
    # over the edge at x = 0.15: 0.3 * 0.119 + 0.6 * 0.2095 = 0.9 * 0.179
    bodies, bonds = ((table, box, arm), (("box", "arm"),)) if bonded else ((table, box), ())
    result = settled(lab, bonds, *bodies, step_limit=150)
    assert result.verdict == ("left_target" if bonded else "at_rest")


@pytest.mark.slow
def test_a_soft_body_keeps_its_rigid_buttons(lab):
    """Two rigid beads sunk halfway into the top of a soft block end where the surface under them is, and the floor
    carries the weight of all three."""
    toy = lab.soft("toy", lab.Box(np.array([0.08, 0.08, 0.06])), [0, 0, 0.032], E=3e4, rho=150.0, cell=0.0125,
                   edge=0.004)  # fmt: skip
    eyes = [lab.rigid(f"eye{k}", lab.Capsule(0.006, 0.0), [0.0, y, 0.062], mass=0.01, edge=0.002, spacing=0.001)
            for k, y in enumerate((0.02, -0.02))]  # fmt: skip
    result = settled(lab, (("toy", "eye0"), ("toy", "eye1")), toy, *eyes, lab.floor())
    assert result.verdict == "at_rest"
    weight = (toy.mass + 0.02) * lab.gravity
    floor = [c for c in result.contacts if "floor" in (c.a, c.b)]
    assert sum(c.normal_force_n for c in floor) == pytest.approx(weight, rel=5e-3)
    assert max(b.stretch_m for b in result.certificate.bonds) < 3e-4
    for k in (1, 2):
        start = eyes[k - 1].center_of_mass
        now = result.bodies[k].rotation @ start + result.bodies[k].translation
        near = np.argsort(np.linalg.norm(toy.vertices - start, axis=1))[:4]
        moved = (result.bodies[0].vertices - toy.vertices)[near].mean(axis=0)
        assert now - start == pytest.approx(moved, abs=2e-3)


def test_a_kick_moves_bonded_bodies_as_one(lab):
    """Two bonded boxes and a third beside them: the pair's velocities are those of one rigid body."""
    box = lab.Box(np.array([0.06, 0.06, 0.06]))
    bodies = [lab.rigid(name, box, [x, 0, 0.0302], mass=mass) for name, x, mass in
              (("left", 0.0, 0.3), ("alone", 0.3, 0.5), ("right", 0.0605, 0.6))]  # fmt: skip
    model = Model((*bodies, lab.floor()), np.array([0.0, 0.0, -lab.gravity]), bonds=(("left", "right"),))
    start(2)
    simulation = ImplicitDrop(model, SolverConfig())
    assert bonded_groups(simulation) == [[0, 2], [1]]
    state = kicked_state(simulation, simulation.start_state())
    v, spin = state.velocity, state.angular_velocity
    assert spin[0] == pytest.approx(spin[2])
    assert v[2] - v[0] == pytest.approx(np.cross(spin[0], bodies[2].center_of_mass - bodies[0].center_of_mass))
    assert not np.allclose(spin[1], spin[0])
    # at the pair's common centre of mass
    assert np.linalg.norm((0.3 * v[0] + 0.6 * v[2]) / 0.9) == pytest.approx(SolverConfig().kick_speed)


def test_a_bond_of_bodies_that_do_not_touch_is_refused(lab):
    """One line that names both and the reach."""
    one = lab.rigid("one", lab.Box(np.array([0.06, 0.06, 0.06])), [0, 0, 0.04])
    two = lab.rigid("two", lab.Box(np.array([0.06, 0.06, 0.06])), [0.2, 0, 0.04])
    with pytest.raises(ModelError, match="bond 'one', 'two': 0 surface points lie within 2 mm"):
        settled(lab, (("one", "two"),), one, two, lab.floor())
    with pytest.raises(ModelError, match="bond names body 'three'"):
        settled(lab, (("one", "three"),), one, two, lab.floor())
