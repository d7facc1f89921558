"""The parts of a Newton step's system against products multiplied out: contacts, the coarse matrix, the tangent."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import cho_solve

from solver.config import SolverConfig
from solver.kernels import sparse as products
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop


@pytest.fixture(params=["face in a plane of the grid", "cells with slivers"])
def pressed(request, lab):
    """A rigid ball pressed into a slab: stepper, a step's problem and a prepared trial."""
    start(2)
    across, up = np.linspace(-0.1, 0.1, 11), np.linspace(-0.05, 0.0, 4)
    if request.param == "cells with slivers":
        up = np.append(np.linspace(-0.05, -1e-4, 4), 0.0166)
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.05])), [0, 0, -0.025], E=2e4, cell=0.02,
                    planes=(across, across, up), held=np.s_[:, :, 0], fixed=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(0.04, 0.0), [0.011, 0.003, 0.038])
    one = ImplicitDrop(Model((ball, slab), np.array([0.0, 0.0, -lab.gravity])), SolverConfig(threads=2))
    before = one.start_state()
    problem = one.stepper.problem(before, 4e-3)
    trial = one.stepper._linearise(before.copy(), problem)
    one.stepper.prepare(trial)
    assert len(trial.contacts.a) > 10
    return one.stepper, problem, trial


def columns(function, size):
    return np.stack([function(unit) for unit in np.eye(size)], axis=1)


def test_the_coarse_matrix_is_that_of_the_whole_system(pressed):
    """P^T A P with every term: elasticity, inertia, contacts on nodes and on the ball."""
    _, _, trial = pressed
    second = trial.system.second
    P = second.space.all_unknowns(1).toarray()
    whole = P.T @ columns(trial.system.multiply, trial.system.size) @ P
    inverse = cho_solve(second.factor, np.eye(len(whole)))
    single = float(np.finfo(np.float32).eps) * np.linalg.cond(whole)  # products with the stencil are as exact as that
    assert single < 0.1
    assert inverse @ whole == pytest.approx(np.eye(len(whole)), abs=single)


def test_contacts_on_the_lattice_are_added_block_by_block():
    """sum_k G_ki T_k G_kj, into the lower triangle of what is there."""
    rng = np.random.default_rng(0)
    G = sparse.random(7, 4, 0.6, "csr", rng=rng)
    half = rng.standard_normal((7, 3, 3))
    T = half + half.transpose(0, 2, 1)
    there = rng.standard_normal((14, 14))
    out, by_column = there.copy(), G.T.tocsr()
    products.add_contacts(
        by_column.indptr, by_column.indices, by_column.data, G.indptr, G.indices, G.data, T, out
    )  # fmt: skip
    wanted = np.einsum("ki,kab,kj->iajb", G.toarray(), T, G.toarray()).reshape(12, 12)
    blocks = np.kron(np.tril(np.ones((4, 4))), np.ones((3, 3))) == 1.0
    assert (out - there)[:12, :12][blocks] == pytest.approx(wanted[blocks], abs=1e-12)
    assert (out[:12, :12][~blocks] == there[:12, :12][~blocks]).all()
    assert (out[12:] == there[12:]).all()


def test_a_tangent_rebuilt_where_it_is_late_is_near_the_whole(pressed):
    """Cells that have not changed keep theirs: after a local dent those far from it have the same bytes, those in it
    what a rebuild of all gives, and none is off by more than the change that is let pass."""
    stepper, problem, trial = pressed
    tangent, state = stepper.tangent, trial.state.copy()
    before = tangent.cells.copy()
    soft = stepper.soft
    dent = 0.01 * np.exp(-((np.linalg.norm(soft.rest, axis=1) / 0.03) ** 2)) * ~soft.held
    state.x = state.x - dent[:, None] * [0.0, 0.0, 1.0]
    stepper.prepare(stepper._linearise(state, problem))
    part = tangent.cells.copy()
    rows = tangent.stencil.copy()
    tangent.bodies = [replace(body, built=None) for body in tangent.bodies]
    tangent.refresh(state, stepper.elastic.deformation)
    kept = (part == before).reshape(len(part), -1).all(axis=1)
    assert 0.2 < kept.mean() < 0.9
    assert (part[~kept] == tangent.cells[~kept]).all()
    size = np.abs(before).max()
    assert np.abs(part - tangent.cells).max() < 2.0 * stepper.config.tangent_refresh * size
    assert np.abs(rows - tangent.stencil).max() < 8.0 * stepper.config.tangent_refresh * size


def test_a_place_that_was_evaluated_gives_its_rotations_to_any_state_there(pressed):
    """Forces find the particles' rotations; a state at the same place that has others gets those."""
    stepper, _, trial = pressed
    state = trial.state.copy()
    state.x = state.x @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    stepper.elastic.forces(state)
    other = trial.state.copy()
    other.x = state.x.copy()
    stepper.elastic.evaluate(other)
    assert other.polar == pytest.approx(state.polar, abs=0.0)
    assert other.polar is not state.polar
    assert not np.allclose(other.polar, trial.state.polar)
