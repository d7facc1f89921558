"""The certificate's estimate of what the grid takes from the depth."""

from dataclasses import replace

import numpy as np
import pytest

from solver.model.bodies import Model
from solver.model.layers import stiffness
from solver.model.soft import build
from solver.model.state import start_state
from solver.runtime import start
from solver.tl.measure import depth_error, squared_error, twice_energy


def slab(lab, **interior):
    """A block of foam on its grid."""
    return lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.1])), [0, 0, 0.05], E=1e5, rho=60.0, cell=0.025, **interior)


def at(model, place):
    """Soft system and state of a model whose nodes are moved by a map."""
    start(1)
    soft = build(model)
    state = start_state(model, soft)
    state.x = place(soft.rest)
    return soft, state


def test_uniform_strain_has_no_error(lab):
    """A grid holds an affine map exactly, however strained and turned."""
    stretch = np.diag([1.1, 0.9, 0.8]) @ np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    soft, state = at(Model((slab(lab),), np.zeros(3)), lambda x: x @ stretch.T)
    assert depth_error(soft, state, 1.0) < 1e-12


def test_strain_that_varies_has_one_that_falls_with_the_square_of_the_cell(lab):
    """Of a quadratic displacement the energy of the error is that of strains linear in a cell: h^2."""
    found = []
    for cell in (0.025, 0.0125):
        body = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.1])), [0, 0, 0.05], E=1e5, rho=60.0, cell=cell)

        def squeezed(x):
            return x + np.stack([0 * x[:, 0], 0 * x[:, 0], -0.5 * x[:, 2] ** 2], axis=1)

        soft, state = at(Model((body,), np.zeros(3)), squeezed)
        inner = np.abs(soft.rest[soft.cell_node].mean(axis=1) - [0.0, 0.0, 0.05]).max(axis=1) < 0.03
        found.append(squared_error(soft, state)[np.repeat(inner, np.diff(soft.cell_start))].sum())
    assert found[0] / found[1] == pytest.approx(4.0, rel=0.15)


def test_layers_of_two_materials_are_no_error(lab):
    """Strain jumps where a hard layer is bonded to a soft one; that is no error of the grid."""
    hard = lab.soft("hard", lab.Box(np.array([0.2, 0.2, 0.1])), [0, 0, 0.05], E=1e5, nu=0.0, rho=60.0, cell=0.025)
    interior = hard.interior
    above = interior.position[:, 2] > 0.05
    interior.youngs_modulus[above] *= 10.0
    soft, state = at(
        Model((hard,), np.zeros(3)),
        lambda x: x * [1.0, 1.0, 0.9] + np.outer(np.maximum(x[:, 2] - 0.05, 0.0), [0.0, 0.0, 0.09]),
    )
    assert depth_error(soft, state, 1.0) < 1e-12


def test_the_energy_of_layers_is_that_of_their_tensor(lab):
    """e : C : e of any strain, with layers and without: the sum over the tensor's 81 entries."""
    soft, _ = at(Model((slab(lab),), np.zeros(3)), lambda x: x)
    count = len(soft.volume)
    frame = np.tile(np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0].ravel(), (count, 1))
    strain = 0.01 * np.random.default_rng(0).normal(size=(count, 7))
    strain[:, :3] -= strain[:, :3].mean(axis=1, keepdims=True)
    e = strain[:, [0, 5, 4, 5, 1, 3, 4, 3, 2]].reshape(-1, 3, 3) + strain[:, 6, None, None] / 3.0 * np.eye(3)
    for added in (np.zeros((count, 5)), np.tile([3e4, 1e4, 2e4, 1e3, 5e3], (count, 1))):
        layered = replace(soft, added=added, frame=frame)
        C = stiffness(soft.mu, soft.lam, added, frame.reshape(-1, 3, 3)).reshape(count, 9, 9)
        expected = np.einsum("pi,pij,pj->p", e.reshape(-1, 9), C, e.reshape(-1, 9))
        assert twice_energy(layered, strain) == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("cell", [pytest.param(0.016, marks=pytest.mark.long), 0.008])
def test_the_estimate_bounds_the_error_of_the_reference_drop(lab, tmp_path, cell):
    """Depth too small by no more than the estimate, which is within four times of it where the grid is coarse."""
    result, depth = lab.reference_drop(tmp_path, 1.0, 2e4, cell)
    short = lab.known_depth[2e4] - depth
    estimate = result["certificate"]["depth_error_m"]
    assert short <= 1.1 * estimate
    assert cell < 0.016 or estimate < 4.0 * short
