"""Material damping: a gradient of the step's own strain that no rotation enters."""

import numpy as np
import pytest
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from solver.kernels.damping import add_drag, start_strains
from solver.kernels.elastic import cell_forces
from solver.runtime import start

MU, LAM = 4e4, 6e4
AT = 0.5 + np.array([-0.25, 0.25])
NODES = np.array(list(np.ndindex(2, 2, 2)), dtype=float)


@pytest.fixture(autouse=True)
def kernels():
    """One thread is enough for a cell."""
    start(1)


def cell():
    """A full unit cell of eight particles that relieves its bending."""
    one = np.ones(8)
    return {
        "cell_node": np.arange(8, dtype=np.int32)[None], "cell_size": np.ones((1, 3)),
        "cell_start": np.array([0, 8], dtype=np.int32),
        "xi": np.stack(np.meshgrid(AT, AT, AT, indexing="ij"), axis=-1).reshape(-1, 3),
        "V": one / 8, "mu": MU * one, "lam": LAM * one, "relief": 0.01 * MU * np.arange(1.0, 10.0)[None],
    }  # fmt: skip


def state(x):
    """Deformation and rotation of the particles and elastic forces with the nodes at x."""
    R, F, force = np.tile(np.eye(3).ravel(), (8, 1)), np.zeros((8, 9)), np.zeros((1, 8, 3))
    cell_forces(x=x, R=R, F_out=F, J_out=np.zeros(8), psi=np.zeros(8), force=force, **cell())
    return F, R, force[0]


def drag(x0, x1, rate=1.0):
    """Drag on the nodes (8, 3) at the end of a step from x0 to x1."""
    F, R, _ = state(x0)
    stretch, modes = np.zeros((8, 9)), np.zeros((1, 6))
    start_strains(x0, cell()["cell_node"], cell()["cell_size"], F, R, stretch, modes)
    F, R, _ = state(x1)
    force = np.zeros((1, 8, 3))
    add_drag(rate, x1, F_in=F, R=R, stretch=stretch, modes=modes, force=force, **cell())
    return force[0]


def shaken(seed, size=0.1):
    """Node positions of a cell bent, stretched and sheared by about `size`."""
    return NODES + size * np.random.default_rng(seed).normal(size=(8, 3))


def potential(x0, x1):
    """The D whose gradient the drag is said to be, from its definition."""
    gradients = []
    for xi in cell()["xi"]:
        w = np.stack([1.0 - xi, xi])
        gradients.append(
            [[np.prod([(2 * n[a] - 1) if a == d else w[n[a], a] for a in range(3)]) for d in range(3)]
             for n in np.ndindex(2, 2, 2)]
        )  # fmt: skip

    def strains(x):
        F = [x.T @ np.array(g) for g in gradients]
        side = 2.0 * NODES - 1.0
        f = [side[:, i] @ x / 4.0 for i in range(3)]
        pairs = ((1, 0), (2, 0), (0, 1), (2, 1), (0, 2), (1, 2))
        q = [f[i] @ ((side[:, i] * side[:, j]) @ x) / 8.0 for i, j in pairs]
        return [polar(one)[1] for one in F], np.mean([np.linalg.det(one) for one in F]), np.array(q)

    (S0, J0, q0), (S1, J1, q1) = strains(x0), strains(x1)
    c, q = cell()["relief"][0], q1 - q0
    relief = -0.5 * (c[:6] * q**2).sum() - sum(c[6 + j] * q[2 * j] * q[2 * j + 1] for j in range(3))
    shear = np.mean([MU * ((a - b) ** 2).sum() for a, b in zip(S0, S1, strict=True)])
    return shear + 0.5 * LAM * (J1 - J0) ** 2 + relief


def test_drag_is_the_gradient_of_its_potential():
    """Force = -dD/dx by central differences of the definition, at large strains and turns."""
    x0, x1 = shaken(0), shaken(1) @ Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix().T
    force = drag(x0, x1)
    for node, axis in np.ndindex(8, 3):
        step = np.zeros((8, 3))
        step[node, axis] = 1e-6
        slope = (potential(x0, x1 + step) - potential(x0, x1 - step)) / 2e-6
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
    assert drag(NODES, NODES + move, 7.0) == pytest.approx(7.0 * state(NODES + move)[2], abs=1e-4 * MU * 7e-5)
