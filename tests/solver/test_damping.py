"""Material damping: a gradient of the step's own strain that no rotation enters."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.kernels.damping import add_drag, start_strains
from solver.kernels.elastic import cell_forces
from solver.reference import elastic as reference
from solver.reference.elastic import Cell, polar_rotation
from solver.runtime import start

MU, LAM = 4e4, 6e4
NODES = np.array(list(np.ndindex(2, 2, 2)), dtype=float)


@pytest.fixture(autouse=True)
def kernels():
    """One thread is enough for a cell."""
    start(1)


def unit_cell():
    """A full unit cell of eight particles that relieves its bending."""
    one, at = np.ones(8), 0.5 + np.array([-0.25, 0.25])
    xi = np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3)
    return Cell(np.ones(3), xi, one / 8, MU * one, LAM * one, 0.01 * MU * np.arange(1.0, 10.0))


def arrays(*cells):
    """Cells without common nodes as the kernels take them."""
    count = [len(one.xi) for one in cells]
    return {
        "cell_node": np.arange(8 * len(cells), dtype=np.int32).reshape(-1, 8),
        "cell_size": np.array([one.size for one in cells]),
        "cell_start": np.concatenate([[0], np.cumsum(count)]).astype(np.int32),
        "xi": np.concatenate([one.xi for one in cells]), "V": np.concatenate([one.volume for one in cells]),
        "mu": np.concatenate([one.mu for one in cells]), "lam": np.concatenate([one.lam for one in cells]),
        "relief": np.array([one.relief for one in cells]),
    }  # fmt: skip


def state(x, *cells):
    """Deformation and rotation of the particles and elastic forces (c, 8, 3) with the nodes at x."""
    given = arrays(*cells)
    count = len(given["xi"])
    R, F, force = np.tile(np.eye(3).ravel(), (count, 1)), np.zeros((count, 9)), np.zeros((len(cells), 8, 3))
    cell_forces(x=x, R=R, F_out=F, J_out=np.zeros(count), psi=np.zeros(count), force=force, **given)
    return F, R, force


def exact(x, *cells):
    """Deformation and rotation by singular values: the iteration for inverted particles is cut off early."""
    corner = x.reshape(len(cells), 8, 3)
    F = [at.T @ one.gradients(xi) for at, one in zip(corner, cells, strict=True) for xi in one.xi]
    return np.reshape(F, (-1, 9)), np.reshape([polar_rotation(f) for f in F], (-1, 9)), None


def drags(rate, x0, x1, *cells, strains=state):
    """Drag on the nodes (c, 8, 3) at the end of a step from x0 to x1."""
    given = arrays(*cells)
    F, R, _ = strains(x0, *cells)
    stretch, modes, force = np.zeros_like(F), np.zeros((len(cells), 6)), np.zeros((len(cells), 8, 3))
    start_strains(x0, given["cell_node"], given["cell_size"], F, R, stretch, modes)
    F, R, _ = strains(x1, *cells)
    add_drag(rate, x1, F_in=F, R=R, stretch=stretch, modes=modes, force=force, **given)
    return force


def drag(x0, x1, rate=1.0):
    """Drag on the nodes (8, 3) of the unit cell."""
    return drags(rate, x0, x1, unit_cell())[0]


def shaken(seed, size=0.1):
    """Node positions of a cell bent, stretched and sheared by about `size`."""
    return NODES + size * np.random.default_rng(seed).normal(size=(8, 3))


def random_cell(random, count, *, lam=True):
    """A cell of any sides, with `count` particles of different materials anywhere in it."""
    size = random.uniform(0.5, 2.0, 3)
    volume, mu = (random.uniform(0.1, 1.0, count) for _ in range(2))
    bulk = MU * random.uniform(0.0, 50.0, count) * float(lam)
    return Cell(size, random.uniform(0.0, 1.0, (count, 3)), volume, MU * mu, bulk, 0.1 * MU * random.normal(size=9))


@pytest.mark.parametrize("size", [1e-6, 0.05, 0.2])
@pytest.mark.parametrize("seed", range(3))
def test_drag_agrees_with_its_twin(seed, size):
    """Cells of any sides, fillings and materials, one without lambda, strained at the start and turned in the step."""
    random = np.random.default_rng(seed)
    cells = [random_cell(random, 8), random_cell(random, 1), random_cell(random, 5, lam=False), unit_cell()]
    x0 = [(NODES + 0.1 * random.normal(size=(8, 3))) * one.size for one in cells]
    turn = Rotation.from_rotvec(size * 5.0 * random.normal(size=3)).as_matrix()
    x1 = [(x + size * random.normal(size=(8, 3)) * one.size) @ turn.T for x, one in zip(x0, cells, strict=True)]
    found = drags(3.0, np.concatenate(x0), np.concatenate(x1), *cells)
    for one, a, b, force in zip(cells, x0, x1, found, strict=True):
        expected = reference.drag(3.0, one, a, b)
        # rotations are known to 1e-13; what is differenced, of order MU times volume, is rounded at 1e-15 of it
        assert force == pytest.approx(expected, rel=1e-8, abs=1e-9 * MU)
        assert np.abs(expected).max() > 0.01 * size * MU


@pytest.mark.parametrize("side", [-0.3, -0.499])
def test_drag_agrees_with_its_twin_in_an_inverted_cell(side):
    """A cell pressed through itself, and one whose rotation hangs on nothing because two stretches cancel."""
    flat = np.array([1.0, 0.5, side])
    skewed = flat * NODES + 0.002 * np.random.default_rng(1).normal(size=(8, 3))
    found = drags(1.0, NODES, skewed, unit_cell(), strains=exact)[0]
    expected = reference.drag(1.0, unit_cell(), NODES, skewed)
    assert found == pytest.approx(expected, rel=1e-8, abs=1e-9 * MU)


def test_drag_is_the_gradient_of_its_potential():
    """Force = -dD/dx by central differences of the definition, at large strains and turns."""
    x0, x1 = shaken(0), shaken(1) @ Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix().T
    force = drag(x0, x1)
    one = unit_cell()
    for node, axis in np.ndindex(8, 3):
        step = np.zeros((8, 3))
        step[node, axis] = 1e-6
        slope = (reference.potential(one, x0, x1 + step) - reference.potential(one, x0, x1 - step)) / 2e-6
        assert force[node, axis] == pytest.approx(-slope, abs=1e-5 * MU)


def test_no_drag_on_a_rigid_motion():
    """A strained cell that turns and moves as a whole feels nothing."""
    x0 = shaken(2)
    turn = Rotation.from_rotvec([1.0, 0.4, -0.7]).as_matrix()
    assert np.abs(drag(x0, x0 @ turn.T + [0.1, 0.2, 0.3])).max() < 1e-9 * MU


def test_drag_keeps_both_momenta():
    """Its forces have no sum and no torque, whatever the strains and turns of the step."""
    x0, x1 = shaken(3), shaken(4) @ Rotation.from_rotvec([0.1, 0.9, 0.2]).as_matrix().T
    force = drag(x0, x1)
    assert np.abs(force.sum(axis=0)).max() < 1e-9 * MU
    assert np.abs(np.cross(x1, force).sum(axis=0)).max() < 1e-9 * MU
    assert np.abs(force).max() > 1e-3 * MU


def test_small_steps_feel_the_elastic_stiffness_times_the_rate():
    """For a small step from rest the drag is the elastic force of that step times beta / dt."""
    move = 1e-5 * np.random.default_rng(5).normal(size=(8, 3))
    assert drag(NODES, NODES + move, 7.0) == pytest.approx(
        7.0 * state(NODES + move, unit_cell())[2][0], abs=1e-4 * MU * 7e-5
    )
