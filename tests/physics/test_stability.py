"""How far a rest state can be pushed: closed forms of rigid bodies, and that trials do not disturb each other."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.certificate import NotDone
from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop
from solver.tl.simulation import StepControl
from solver.tl.stability import directions, grade, largest_held

STEP = SolverConfig().push_step
# under a push that is too large by e the body moves 4 e L in the time it acts, or leaves its balance by a factor e per
# sqrt(L / 2g): e = 0.0125 slides the 5 % of L that are allowed, and 3 % of the tipping push tips
SLIDES, TIPS = 0.0125, 0.03
# three points carry the weight at 0.05 mm, so the six of an edge that has it all sink 0.025 mm, the row 0.01 m inside
# nothing: the box leans by 0.0025, which moves its centre, 0.1 m high, by 1 % of the 25 mm
SINKS = 0.01


def pushed(lab, size, mu, *, at=0.0, count=2, **config):
    """Rows of the stability test of a box on the floor, by direction."""
    box = lab.rigid("box", lab.Box(np.array(size)), [at, 0, size[2] / 2 + 1e-4], mu=(mu, mu))
    result = lab.drop(box, lab.floor(mu=(mu, mu)), stability=True, push_directions=count, **config)
    assert result.verdict == "at_rest"
    return result.certificate.stability


@pytest.mark.slow
@pytest.mark.long
def test_a_tall_box_tips_where_its_weight_leaves_the_edge(lab):
    """F / W = half width / height of the centre of mass = 0.25, below friction."""
    found = pushed(lab, [0.05, 0.05, 0.2], 1.0)
    for row in found.bodies["box"].directions:
        assert row.lost - row.held == pytest.approx(STEP)
        assert row.held <= 0.25 * (1.0 + TIPS)
        assert row.lost >= 0.25 * (1.0 - SINKS)
        assert row.lost_turned_rad > 1.0
    assert found.grade == min(row.held for row in found.bodies["box"].directions)


@pytest.mark.slow
def test_a_wide_low_block_slides_at_friction_and_so_is_more_stable_than_a_tall_one(lab):
    """F / W = mu = 0.5, where tipping would take 4; it slides without turning."""
    found = pushed(lab, [0.2, 0.2, 0.05], 0.5)
    for row in found.bodies["box"].directions:
        assert row.held <= 0.5 + SLIDES
        assert row.lost >= 0.5
        assert row.lost_turned_rad < 1e-3
    assert found.grade > 0.25 * (1.0 + TIPS)  # the tall box's


@pytest.mark.slow
@pytest.mark.long
def test_a_block_near_an_edge_is_least_stable_towards_it(lab):
    """Its centre, 0.05 m high, is 0.01 m from the floor's edge: F / W = 0.2 that way, friction's 0.5 the other ways."""
    rows = pushed(lab, [0.1, 0.1, 0.1], 0.5, at=0.29, count=4).bodies["box"].directions
    assert rows[0].direction == pytest.approx([1.0, 0.0, 0.0])
    assert rows[0].held <= 0.2 * (1.0 + TIPS)
    # five points of the floor's edge sink 0.03 mm, the box's own, 0.01 m inside, do not: 0.05 m higher 0.15 of 10 mm
    assert rows[0].lost >= 0.2 * (1.0 - 0.015)
    for row in rows[1:]:
        assert 0.5 - STEP <= row.held <= 0.5 + SLIDES


@pytest.mark.slow
def test_pushing_changes_neither_the_rest_state_nor_its_history(lab):
    """The same result but for the grade."""
    box = lab.rigid("box", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.051])
    plain, graded = (lab.drop(box, lab.floor(), stability=s, push_directions=1) for s in (False, True))
    assert plain.certificate.stability is None
    assert graded.steps == plain.steps
    assert (graded.bodies[0].vertices == plain.bodies[0].vertices).all()
    assert replace(graded.certificate, stability=None) == plain.certificate
    for one in fields(plain.history):
        assert (getattr(graded.history, one.name) == getattr(plain.history, one.name)).all()


@pytest.mark.slow
def test_trials_leave_nothing_behind(lab):
    """A second test of the same rest state finds the same numbers to the last bit."""
    box = lab.rigid("box", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.0501])
    config = SolverConfig(push_directions=1, threads=2)
    start(2)
    drop = ImplicitDrop(Model((box, lab.floor()), np.array([0.0, 0.0, -lab.gravity])), config)
    rest = drop.approach(drop.start_state(), StepControl(config.step_seconds), None).state
    assert grade(drop, rest, 1.0, None) == grade(drop, rest, 1.0, None)


@pytest.mark.slow
def test_what_does_not_rest_is_not_graded(lab):
    """There is no rest state to push on a slope that is too steep."""
    box = lab.rigid("box", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.051])
    result = lab.drop(box, lab.floor(), gravity=(6.0, 0.0, -7.76), stability=True)
    assert result.verdict == "left_target"
    assert result.certificate.stability.done is False


@pytest.mark.long
@pytest.mark.slow
def test_a_ball_rolls_where_its_resistance_ends(lab):
    """F / W = b / R = 0.07; on the way it leans on the compliant spring of friction.py and comes back slowly."""
    ball = lab.rigid("ball", lab.Capsule(0.05, 0.0), [0, 0, 0.0501], rolling=3.5e-3, edge=0.003, spacing=0.0015)
    result = lab.drop(ball, lab.floor(rolling=3.5e-3), stability=True, push_directions=1)
    row = result.certificate.stability.bodies["ball"].directions[0]
    # its spring yields at the limit and damping's torque counts in it, so it may roll a little below: one step
    assert 0.07 - STEP <= row.held <= 0.07 + SLIDES


@pytest.mark.slow
@pytest.mark.long
def test_a_soft_cube_slides_at_friction_too(lab):
    """F / W = mu = 0.3, whatever its stiffness; lying on foam or being foam changes only how far it leans."""
    cube = lab.soft("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.0501], E=1e5, cell=0.025, mu=(0.3, 0.3))
    result = lab.drop(cube, lab.floor(mu=(0.3, 0.3)), stability=True, push_directions=1)
    row = result.certificate.stability.bodies["cube"].directions[0]
    assert 0.3 - STEP <= row.held <= 0.3 + SLIDES


@given(st.integers(1, 80), st.data())
def test_the_search_finds_every_threshold_within_its_bound_of_trials(most, data):
    """log2 rounded up, with a guess two more than twice that, two in all with a right one; nothing is tried twice."""
    true = data.draw(st.integers(0, most))
    guess = data.draw(st.none() | st.integers(0, most))
    tried: list[int] = []
    found = largest_held(lambda level: tried.append(level) or level <= true, most, guess)
    assert found == true
    assert len(set(tried)) == len(tried)
    assert all(1 <= level <= most for level in tried)
    halvings = int(np.ceil(np.log2(most + 1)))
    assert len(tried) <= (halvings if guess is None else 2 * halvings + 2)
    assert guess != true or len(tried) <= 2


@given(st.integers(1, 12), st.tuples(*[st.floats(-9.0, 9.0)] * 3).filter(lambda g: np.linalg.norm(g) > 0.1))
def test_directions_are_horizontal_and_even(count, gravity):
    """Unit vectors across gravity that add up to nothing from two on."""
    ways = directions(np.array(gravity), count)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(np.ones(count))
    # products of unit vectors: a few roundings of 1e-16, of gravity's own length
    assert np.abs(ways @ np.array(gravity)).max() < 1e-14 * 10
    if count > 1:
        assert np.abs(ways.sum(axis=0)).max() < 1e-13


def test_without_gravity_there_is_no_weight_to_grade(lab):
    """A push is a share of the weight; where there is none, the grade says so."""
    box = lab.rigid("box", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.0501])
    start(1)
    drop = ImplicitDrop(Model((box, lab.floor()), np.zeros(3)), SolverConfig(threads=1))
    graded, _ = grade(drop, drop.start_state(), 1.0, None)
    assert graded == NotDone(reason="without gravity there is no weight to compare a push with")
