"""Kernels against their numpy twins, and properties of the elastic law."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.geometry.primitives import Box
from dcap.geometry.solid.fill import octants
from solver.config import SolverConfig
from solver.kernels.elastic import cell_forces
from solver.kernels.tangents import rest_tangents, strained_tangents
from solver.model.bodies import Interior, Model, SignedDistance, SoftBody
from solver.reference.elastic import energy, polar_rotation, stress
from solver.runtime import start
from solver.settle import ImplicitDrop

MU, LAM = 4e4, 6e4


@pytest.fixture(autouse=True)
def taichi():
    start(2)


def one_cell(deformation, relief=None):
    """Arrays of a unit cell with one particle at its centre, nodes moved by x = F X."""
    nodes = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
    arrays = {
        "x": nodes @ deformation.T,
        "cell_node": np.arange(8, dtype=np.int32)[None],
        "cell_size": np.ones((1, 3)),
        "cell_start": np.array([0, 1], dtype=np.int32),
        "xi": np.full((1, 3), 0.5),
        "V": np.ones(1),
        "mu": np.full(1, MU),
        "lam": np.full(1, LAM),
        "relief": np.zeros((1, 9)) if relief is None else relief,
        "R": np.eye(3).reshape(1, 9).copy(),
        "F_out": np.zeros((1, 9)),
        "J_out": np.zeros(1),
        "psi": np.zeros(1),
        "force": np.zeros((1, 8, 3)),
    }
    cell_forces(**arrays)
    return arrays


CASES = [np.eye(3) + 0.3 * np.random.default_rng(k).normal(size=(3, 3)) for k in range(6)] + [np.diag([1.0, 1.0, -0.4])]


@pytest.mark.parametrize("F", CASES)
def test_kernel_equals_its_twin(F):
    """Rotation, energy and stress agree with the definition to 1e-9, the tolerance of the iterated rotation."""
    out = one_cell(F)
    assert out["F_out"].reshape(3, 3) == pytest.approx(F, abs=1e-12)
    assert out["psi"][0] == pytest.approx(energy(F, MU, LAM), rel=1e-9)
    gradient = np.array([[2 * i - 1, 2 * j - 1, 2 * k - 1] for i, j, k in np.ndindex(2, 2, 2)]) / 4.0
    assert out["force"][0] == pytest.approx(-gradient @ stress(F, MU, LAM).T, abs=1e-6 * MU)
    if np.linalg.det(F) > 0:
        assert out["R"].reshape(3, 3) == pytest.approx(polar_rotation(F), abs=1e-9)


@pytest.mark.parametrize("F", CASES[:4])
def test_stress_is_the_derivative_of_the_energy(F):
    """P = d psi / d F by central differences; error of order step^2 = 1e-10 relative to the second derivative 1e5."""
    numeric = np.zeros((3, 3))
    for i, j in np.ndindex(3, 3):
        step = np.zeros((3, 3))
        step[i, j] = 1e-5
        numeric[i, j] = (energy(F + step, MU, LAM) - energy(F - step, MU, LAM)) / 2e-5
    assert stress(F, MU, LAM) == pytest.approx(numeric, abs=1e-3 * MU)


def full_cell(x):
    """Node forces (8, 3) of a unit cell of eight particles with its nodes at x, and what its tangent needs."""
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    one = np.ones(8)
    cell = {"cell_size": np.ones((1, 3)), "cell_start": np.array([0, 8], dtype=np.int32),
            "xi": np.stack(np.meshgrid(at, at, at, indexing="ij"), axis=-1).reshape(-1, 3),
            "V": one / 8, "mu": MU * one, "lam": LAM * one}  # fmt: skip
    R, F, force = np.tile(np.eye(3).ravel(), (8, 1)), np.zeros((8, 9)), np.zeros((1, 8, 3))
    nodes = np.arange(8, dtype=np.int32)[None]
    cell_forces(x=x, cell_node=nodes, relief=np.zeros((1, 9)), R=R, F_out=F, J_out=one.copy(), psi=one.copy(),
                        force=force, **cell)  # fmt: skip
    return force[0], cell | {"F_in": F, "R": R}


def tangents(x):
    """(as the kernel has it, second derivative of the energy by central differences), (24, 24) each."""
    K = np.zeros((1, 8, 8, 3, 3), dtype=np.float32)
    strained_tangents(limit=0.0, first=0, late=np.ones(1, np.int32), K=K, **full_cell(x)[1])
    columns = []
    for n in range(24):
        step = np.zeros(24)
        step[n] = 1e-6
        columns.append((full_cell(x - step.reshape(8, 3))[0] - full_cell(x + step.reshape(8, 3))[0]).ravel() / 2e-6)
    return K[0].transpose(0, 2, 1, 3).reshape(24, 24).astype(float), np.stack(columns, axis=1)


CORNERS = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
TURN = Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()


@pytest.mark.parametrize("stretch", [(1.3, 1.25, 1.2), (1.2, 1.2, 1.1), (1.2, 1.2, 1.2)])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_the_tangent_of_a_stretched_cell_is_the_second_derivative_of_its_energy(stretch, noise):
    """Nothing is negative there, so nothing is left out, also where singular values coincide; single precision."""
    x = CORNERS @ (TURN @ np.diag(stretch)).T + noise * np.random.default_rng(0).normal(size=(8, 3))
    own, numeric = tangents(x)
    assert own == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max())


@pytest.mark.parametrize("stretch", [(1.0, 1.0, 0.6), (0.7, 1.2, 0.9), (0.5, 0.5, 0.5), (1.0, 0.4, -0.2)])
def test_the_tangent_of_a_squeezed_cell_is_never_negative(stretch):
    """There the energy's own second derivative is: conjugate gradients would fail. What is left out is what is negative
    in single particles, so the tangent is the larger of the two."""
    own, numeric = tangents(CORNERS @ (TURN @ np.diag(stretch)).T)
    scale = float(np.abs(own).max())
    assert own == pytest.approx(own.T, abs=1e-6 * scale)
    assert np.linalg.eigvalsh(own).min() > -1e-6 * scale
    assert np.linalg.eigvalsh(numeric).min() < -1e-3 * scale
    if min(stretch) > 0.0:
        assert np.linalg.eigvalsh(own - numeric).min() > -1e-5 * scale


@pytest.mark.parametrize(("limit", "late", "changed"), [(0.1, True, True), (0.3, True, False), (0.1, False, False)])
def test_only_strained_cells_that_are_late_get_their_own_tangent(limit, late, changed):
    """A stretch of 0.2 lies between the limits."""
    K = np.zeros((1, 8, 8, 3, 3), dtype=np.float32)
    cell = full_cell(CORNERS @ (TURN @ np.diag([1.2, 1.0, 1.0])).T)[1]
    strained_tangents(limit=limit, first=0, late=np.full(1, late, np.int32), K=K, **cell)
    assert K.any() == changed


def test_energy_does_not_depend_on_rigid_rotation():
    """psi(Q F) = psi(F)."""
    F = CASES[0]
    Q = Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    assert energy(Q @ F, MU, LAM) == pytest.approx(energy(F, MU, LAM), rel=1e-12)


def test_tangent_is_the_derivative_of_the_forces_at_rest():
    """At F = I the warped tangent is exact: K = -d f / d x by central differences (float32 storage: 1e-6 relative)."""
    F = np.eye(3)
    relief = 0.01 * MU * np.arange(1.0, 10.0)[None]
    arrays = one_cell(F, relief)
    K = np.zeros((1, 8, 8, 3, 3), dtype=np.float32)
    names = ("cell_size", "cell_start", "xi", "V", "mu", "lam", "relief")
    rest_tangents(*[arrays[n] for n in names], np.zeros((1, 8, 3)), K)
    h = 1e-6
    for node, axis in ((0, 0), (3, 2), (6, 1)):
        sides = []
        for sign in (1.0, -1.0):
            moved = one_cell(F, relief)
            moved["x"][node, axis] += sign * h
            cell_forces(**moved)
            sides.append(moved["force"][0].copy())
        numeric = -(sides[0] - sides[1]) / (2 * h)
        column = K[0, :, node, :, axis]
        assert column == pytest.approx(numeric, abs=1e-4 * MU)


def block(rotation, stretch, nu=0.3):
    """A soft box of 4 x 3 x 3 unequal cells under the affine map x = R S X."""
    planes = (np.array([0.0, 0.02, 0.05, 0.07, 0.1]), np.linspace(0, 0.06, 4), np.array([0.0, 0.01, 0.04, 0.06]))
    solid = Box(np.array([0.1, 0.06, 0.06]))
    points, size = octants(planes)
    volume, one = size.prod(axis=1), np.ones(len(points))
    state = np.zeros(tuple(len(p) for p in planes), np.int8)
    surface = solid.surface(0.02)
    vertices = surface.vertices + np.array([0.05, 0.03, 0.03])
    grid = SignedDistance(np.zeros(3) - 0.1, 0.02, np.ones((16, 14, 14), dtype=np.float32))
    interior = Interior(points, volume, 100 * one, 1e5 * one, nu * one, planes, state, loaded=False)
    body = SoftBody("block", False, vertices, surface.faces, grid, 1.0, np.zeros(3), 0.5, 0.4, 0.0, interior)
    start(1)
    model = Model((body,), np.zeros(3))
    drop = ImplicitDrop(model, SolverConfig())
    state0 = drop.start_state()
    state0.x = drop.soft.rest @ (rotation @ stretch).T
    return drop, drop.stepper.elastic.forces(state0)


def test_patch_an_affine_map_leaves_inner_nodes_in_balance():
    """Constant strain gives constant stress: no force on nodes all of whose cells are full of material."""
    drop, force = block(np.eye(3), np.diag([1.1, 0.95, 0.9]) + 0.03)
    rest = drop.soft.rest
    inner = ((rest > 1e-9) & (rest < np.array([0.1, 0.06, 0.06]) - 1e-9)).all(axis=1)
    assert inner.sum() == 3 * 2 * 2
    # the fictitious layer around the body holds 0.1 % of the stiffness, and none of it at inner nodes
    assert np.abs(force[inner]).max() < 1e-9 * np.abs(force).max()


def test_energy_does_not_depend_on_a_rotation_and_forces_turn_with_it():
    """psi(R F) = psi(F), f(R x) = R f(x): to rounding."""
    stretch = np.diag([1.2, 0.9, 0.8]) + 0.05
    turn = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    plain, force = block(np.eye(3), stretch)
    turned, turned_force = block(turn, stretch)
    assert turned.stepper.elastic.energy.sum() == pytest.approx(plain.stepper.elastic.energy.sum(), rel=1e-11)
    assert turned_force == pytest.approx(force @ turn.T, abs=1e-10 * np.abs(force).max())
