"""The linear systems of a step: true derivatives of its residual, a symmetric preconditioner, and what solves them."""

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.errors import UnstableStep
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop
from solver.tl.linear import conjugate_gradient
from solver.tl.simulation import StepControl

DOWN, ASIDE, DT = 2e-5, 1e-4, 4e-3  # penetration and slip [m] at which every point slides; step [s]


@pytest.fixture
def sliding(lab):
    """A foam block that is pressed into the floor and slides on it: its stepper, a step's problem, the state
    after it, and its trial."""
    start(2)
    block = lab.soft("block", lab.Box(np.array([0.1, 0.08, 0.06])), [0, 0, 0.03], E=1e5, cell=0.02)
    one = ImplicitDrop(Model((block, lab.floor()), np.array([0.0, 0.0, -lab.gravity])), SolverConfig(threads=2))
    before, after = one.start_state(), one.start_state()
    problem = one.stepper.problem(before, DT)
    after.x = before.x + np.array([ASIDE, 0.3 * ASIDE, -DOWN])
    trial = one.stepper._linearise(after, problem)
    assert all(t.sliding.all() for t in trial.contacts.active)
    return one.stepper, problem, after, trial


def test_the_matrix_is_the_derivative_of_the_residual(sliding):
    """Central differences along a random motion, where points stick; where they slide what is missing is that their
    limits follow the normal force, mu k of every point beside its own k: a tenth of the largest entry and more."""
    stepper, problem, after, trial = sliding
    assert off_by(stepper, problem, after, trial) > 0.1
    stuck = after.copy()
    stuck.x = problem.before.x + np.array([0.01 * ASIDE, 0.0, -DOWN])
    trial = stepper._linearise(stuck, problem)
    assert not any(t.sliding.any() for t in trial.contacts.active)
    assert off_by(stepper, problem, stuck, trial) < 1e-3


def off_by(stepper, problem, after, trial):
    """Largest error of the matrix along a random motion over the largest entry of its product [-]."""
    direction = 1e-7 * np.random.default_rng(0).standard_normal(trial.system.size)  # keeps every point in contact
    sides = [stepper._linearise(stepper._move(after, trial.system, s * direction), problem).right for s in (1, -1)]
    expected = 0.5 * (sides[1] - sides[0])
    stepper.prepare(trial)
    return np.abs(trial.system.multiply(direction) - expected).max() / np.abs(expected).max()


def test_the_preconditioner_is_symmetric(sliding):
    """Conjugate gradients need it; single precision is what its sweeps are exact to."""
    stepper, _, _, trial = sliding
    stepper.prepare(trial)
    system = trial.system
    r, s = np.random.default_rng(1).standard_normal((2, system.size))
    one, other = r @ system.precondition(s), s @ system.precondition(r)
    assert one == pytest.approx(other, abs=1e-5 * np.sqrt((r @ system.precondition(r)) * (s @ system.precondition(s))))


def test_solutions_solve(sliding):
    """What is left of the right side: conjugate gradients go by its preconditioned norm, which weighs the block's slow
    modes ten times as much at most."""
    stepper, _, _, trial = sliding
    stepper.prepare(trial)
    y, iterations = conjugate_gradient(trial.system, trial.right, 1e-4, 400)
    left = trial.system.multiply(y) - trial.right
    assert 0 < iterations < 400
    assert np.linalg.norm(left) < 1e-3 * np.linalg.norm(trial.right)


@pytest.mark.slow
def test_newton_converges_where_every_point_slides(sliding):
    """A block thrown along the floor: friction limits follow its bounce, and each step is solved to its tolerance."""
    stepper, problem, _, _ = sliding
    state = problem.before.copy()
    state.v = np.tile([0.3, 0.1, -0.05], (len(state.x), 1))
    for _ in range(8):
        state, report = stepper.step(state, DT, 1e-3)
        assert report.residual <= 1e-3


def test_a_state_that_is_not_finite_names_its_body(sliding):
    """A number lost on the way ends the drop at once, whatever the other bodies do."""
    stepper, problem, _, _ = sliding
    state = problem.before.copy()
    state.v[5] = np.nan
    with pytest.raises(UnstableStep, match=r"positions of body 'block' .* are not finite"):
        stepper.step(state, DT, 1e-3)


def test_a_long_move_is_cut_before_it_is_searched(sliding):
    """Else its shares would all be as long as allowed, and the same."""
    stepper, _, after, trial = sliding
    capped = stepper._capped(trial.system, np.full(trial.system.size, 0.2))
    assert capped == pytest.approx(SolverConfig().longest_move, rel=1e-12)
    short = np.full(trial.system.size, 1e-3)
    assert stepper._capped(trial.system, short) == pytest.approx(short, abs=0)
    moved = [stepper._move(after, trial.system, share * capped).x - after.x for share in (1.0, 0.5)]
    assert moved[0] == pytest.approx(2.0 * moved[1], rel=1e-9)


def test_a_step_that_cannot_be_solved_says_where_and_by_how_much(lab):
    """Body, place, bound and the knob that sets it; the block lies on a floor that is in balance whatever happens."""
    block = lab.soft("block", lab.Box(np.array([0.1, 0.08, 0.06])), [0.2, 0, 0.03], E=1e5, cell=0.02)
    with pytest.raises(UnstableStep, match=r"body 'block' weighs .* at \[0\.\d+, .* m, .* acceptable_residual = 1e-14"):
        lab.drop(block, lab.floor(), acceptable_residual=1e-14)


def test_the_same_state_steps_to_the_same_state(lab):
    """All that a step starts from is in its arguments: friction's anchors, what touched, the speed before it."""
    start(2)
    box = lab.rigid("box", lab.Box(np.array([0.1, 0.08, 0.06])), [0, 0, 0.03], velocity=np.array([0.3, 0.1, 0.0]))
    one = ImplicitDrop(Model((box, lab.floor()), np.array([0.0, 0.0, -lab.gravity])), SolverConfig(threads=2))
    state, control = one.start_state(), StepControl(DT)
    for _ in range(3):
        step = one.step(state, control)
        state, control = step.state, step.control
    ends = []
    for _ in range(2):
        end, following = state, control
        for _ in range(5):
            step = one.step(end, following)
            end, following = step.state, step.control
        ends.append(end)
    assert any(memory.sliding.any() for memory in state.memory.points.values())
    assert (ends[0].center == ends[1].center).all()
    assert (ends[0].rotation == ends[1].rotation).all()
