"""Layered material: kernels against the definition, the small-strain limit, objectivity, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.geometry.primitives import Box
from dcap.scene.types.materials import LayerConstants
from solver.errors import ModelError
from solver.kernels.elastic import cell_forces
from solver.kernels.layers import add_layer_drag, add_layer_forces, add_layer_tangents, start_layers
from solver.kernels.tangents import rest_tangents
from solver.model.bending import bending_relief, layered_relief
from solver.model.bodies import Interior, Model, SignedDistance, SoftBody
from solver.model.layers import Layers, frames, split, stiffness
from solver.model.soft import build as build_soft
from solver.model.soft import lame
from solver.reference.elastic import layered_energy, transverse_stiffness
from solver.runtime import start
from solver.tl.ghost import rest_stiffness, with_definite_relief

CLOTH = (2e4, 0.05, 4e5, 0.2, 2e3)  # E_t, nu_tp, E_p, nu_p, G_t
STIFF_BETWEEN = (4e5, 0.6, 2e5, 0.1, 3e5)  # shear between layers above that in them, nu_tp above 1/2
NEARLY_VOLUME = (1e5, 0.48, 1.1e5, 0.48, 2e4)  # resists a change of volume far more than one of shape
EVERY = [CLOTH, STIFF_BETWEEN, NEARLY_VOLUME]
NORMAL = np.array([0.36, -0.48, 0.8])
TURN = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()


@pytest.fixture(autouse=True)
def taichi():
    start(2)


def one_point(constants, normal=NORMAL):
    """mu, lambda, what layers add (1, 5) and their frame (1, 9) of one material point."""
    across, poisson, along, in_plane, shear = (np.array([value]) for value in constants)
    layers = Layers(along, in_plane, shear, normal[None])
    mu, lam, added = split(across, poisson, layers)
    return mu, lam, added, frames(layers.normal).reshape(1, 9)


def cell(x, constants, normal=NORMAL, points=1):
    """Energy, node forces (8, 3) and tangent at rest and at x (24, 24) of a unit cell with its nodes at x (8, 3)."""
    mu, lam, added, frame = one_point(constants, normal)
    one = np.ones(points)
    at = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    xi = np.full((1, 3), 0.5) if points == 1 else np.stack(np.meshgrid(at, at, at, indexing="ij"), -1).reshape(-1, 3)
    shape = {"cell_size": np.ones((1, 3)), "cell_start": np.array([0, points], np.int32), "xi": xi, "V": one / points}
    moduli = {"mu": mu * one, "lam": lam * one, "relief": np.zeros((1, 9))}
    layered = {"cells": np.zeros(1, np.int32), "added": added * one[:, None], "frame": frame * one[:, None]}
    F, psi, force = np.zeros((points, 9)), np.zeros(points), np.zeros((1, 8, 3))
    cell_forces(x=x, cell_node=np.arange(8, dtype=np.int32)[None], R=np.tile(np.eye(3).ravel(), (points, 1)),
                F_out=F, J_out=one.copy(), psi=psi, force=force, **shape, **moduli)  # fmt: skip
    add_layer_forces(F_in=F, psi=psi, force=force, **shape, **layered)
    K = np.zeros((1, 8, 8, 3, 3), dtype=np.float32)
    add_layer_tangents(F_in=F, K=K, **shape, **layered)
    rest = np.zeros_like(K)
    rest_tangents(B=np.zeros((1, 8, 3)), K=rest, **shape, **moduli)
    matrices = [block[0].transpose(0, 2, 1, 3).reshape(24, 24).astype(float) for block in (K, rest)]
    return psi.sum(), force[0], *matrices


CORNERS = np.array(list(np.ndindex(2, 2, 2)), dtype=float)
GRADIENT = (2.0 * CORNERS - 1.0) / 4.0
"""Of the shape functions in the middle of a unit cell."""
STRAINED = [np.eye(3) + 0.25 * np.random.default_rng(k).normal(size=(3, 3)) for k in range(5)]


@pytest.mark.parametrize("constants", EVERY)
@pytest.mark.parametrize("F", STRAINED)
def test_the_energy_is_that_of_its_definition(constants, F):
    """Stretch, distance, distortion and slip of layers by singular values and F^-T n; the tolerance is that of R."""
    mu, lam, added, _ = one_point(constants)
    energy = cell(CORNERS @ F.T, constants)[0]
    assert energy == pytest.approx(layered_energy(F, mu[0], lam[0], added[0], NORMAL), rel=1e-9)


@pytest.mark.parametrize("constants", EVERY)
@pytest.mark.parametrize("F", STRAINED)
def test_forces_are_the_derivative_of_the_energy(constants, F):
    """Central differences of the definition along F; their error is of order step^2 times a third derivative."""
    mu, lam, added, _ = one_point(constants)
    P = np.zeros((3, 3))
    for i, j in np.ndindex(3, 3):
        step = np.zeros((3, 3))
        step[i, j] = 1e-5
        ends = [layered_energy(F + sign * step, mu[0], lam[0], added[0], NORMAL) for sign in (1, -1)]
        P[i, j] = (ends[0] - ends[1]) / 2e-5
    largest = max(constants[0], constants[2])
    assert cell(CORNERS @ F.T, constants)[1] == pytest.approx(-GRADIENT @ P.T, abs=1e-5 * largest)


@pytest.mark.parametrize("constants", EVERY)
def test_small_strain_is_transverse_isotropy(constants):
    """The elasticity tensor is the inverse of the compliance of E_t, nu_tp, E_p, nu_p and G_t."""
    mu, lam, added, _ = one_point(constants, np.array([0.0, 0.0, 1.0]))
    C = stiffness(mu, lam, added, np.eye(3)[None])[0]
    voigt = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    matrix = np.array([[C[i, j, k, el] for k, el in voigt] for i, j in voigt])
    expected = transverse_stiffness(*constants)
    assert matrix == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("constants", EVERY)
def test_the_tangent_at_rest_is_the_second_derivative_of_the_energy(constants):
    """Layers oblique to the cell, eight points; turned as a whole it turns along, to single precision."""
    _, _, added, rest = cell(CORNERS, constants, points=8)
    columns = []
    for n in range(24):
        step = np.zeros(24)
        step[n] = 1e-6
        ends = [cell(CORNERS + sign * step.reshape(8, 3), constants, points=8)[1] for sign in (-1, 1)]
        columns.append((ends[0] - ends[1]).ravel() / 2e-6)
    numeric = np.stack(columns, axis=1)
    assert added + rest == pytest.approx(numeric, abs=2e-6 * np.abs(numeric).max())
    turned = cell(CORNERS @ TURN.T, constants, points=8)[2]
    whole = np.kron(np.eye(8), TURN)
    assert turned == pytest.approx(whole @ added @ whole.T, abs=1e-6 * np.abs(added).max())


@pytest.mark.parametrize("constants", EVERY)
@pytest.mark.parametrize("F", STRAINED)
def test_the_tangent_is_never_negative_and_lets_a_strained_cell_turn(constants, F):
    """No eigenvalue below rounding, and no force from a rotation of the cell as it is: single precision."""
    x = CORNERS @ F.T
    K = cell(x, constants, points=8)[2]
    largest = np.linalg.eigvalsh(K)[-1]
    assert np.linalg.eigvalsh(K)[0] > -1e-6 * largest
    for axis in np.eye(3):
        assert K @ np.cross(axis, x).ravel() == pytest.approx(np.zeros(24), abs=3e-6 * largest)


def drag(before, x, constants):
    """Node forces (24,) of the damping of layers with rate 1 in a unit cell of one point whose nodes go from `before`
    to x (8, 3)."""
    _, _, added, frame = one_point(constants)
    cells, start_ = np.zeros(1, np.int32), np.array([0, 1], np.int32)
    F, F0 = (np.einsum("na,nb->ab", nodes, GRADIENT).reshape(1, 9) for nodes in (x, before))
    measures, force = np.zeros((1, 6)), np.zeros((1, 8, 3))
    start_layers(cells=cells, cell_start=start_, frame=frame, F_in=F0, out=measures)
    add_layer_drag(rate=1.0, cells=cells, cell_size=np.ones((1, 3)), cell_start=start_, xi=np.full((1, 3), 0.5),
                   V=np.ones(1), added=added, frame=frame, F_in=F, before=measures, force=force)  # fmt: skip
    return force.ravel()


@pytest.mark.parametrize("constants", EVERY)
@pytest.mark.parametrize("F", STRAINED)
def test_damping_of_layers_is_their_tangent_times_the_rate_and_knows_no_rotation(constants, F):
    """The derivative of the drag where a step begins is the tangent there, strained as it may be; differences 1e-6, the
    tangent in single precision. A turn without strain is not resisted: to rounding."""
    x = CORNERS @ F.T
    K = cell(x, constants)[2]
    step = 1e-6 * np.random.default_rng(3).normal(size=(8, 3))
    change = 0.5 * (drag(x, x + step, constants) - drag(x, x - step, constants))
    assert change == pytest.approx(-K @ step.ravel(), abs=3e-6 * np.abs(K).max() * 1e-6)
    assert drag(x, x @ TURN.T, constants) == pytest.approx(np.zeros(24), abs=1e-9 * np.abs(K).max())


@pytest.mark.parametrize("constants", EVERY)
def test_energy_does_not_depend_on_a_rotation_and_forces_turn_with_it(constants):
    """psi(R F) = psi(F), f(R x) = R f(x), and a material that is turned with its layers is the same: to rounding."""
    x = CORNERS @ STRAINED[0].T
    energy, force, *_ = cell(x, constants)
    turned_energy, turned_force, *_ = cell(x @ TURN.T, constants)
    assert turned_energy == pytest.approx(energy, rel=1e-11)
    assert turned_force == pytest.approx(force @ TURN.T, abs=1e-9 * np.abs(force).max())
    other_side = cell(x, constants, normal=-NORMAL)[0]
    assert other_side == pytest.approx(energy, rel=1e-11)
    mu, lam, added, _ = one_point(constants)
    same = layered_energy(STRAINED[0] @ TURN.T, mu[0], lam[0], added[0], TURN @ NORMAL)
    assert same == pytest.approx(energy, rel=1e-9)


@pytest.mark.parametrize("nu", [-0.3, 0.0, 0.3, 0.49])
def test_isotropic_constants_give_the_isotropic_law(nu):
    """Layers that are as stiff along as across add nothing, and mu and lambda are Lame's."""
    E = 3e4
    mu, lam, added, _ = one_point((E, nu, E, nu, E / (2.0 * (1.0 + nu))))
    assert (mu[0], lam[0]) == pytest.approx(tuple(float(v[0]) for v in lame(np.array([E]), np.array([nu]))), rel=1e-12)
    assert not added.any()


def test_a_hundred_times_stiffer_along_the_split_keeps_every_part_positive():
    """mu and lambda are no more than the stiffness has: what remains has no negative eigenvalue."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        across, along, shear = 10.0 ** rng.uniform(3, 6, 3)
        in_plane = rng.uniform(-0.9, 0.9)
        poisson = rng.uniform(-0.999, 0.999) * np.sqrt(0.5 * (1.0 - in_plane) * across / along)
        mu, lam, added, _ = one_point((across, poisson, along, in_plane, shear))
        rest = np.array([[added[0, 0], added[0, 1]], [added[0, 1], added[0, 2]]])
        assert mu[0] > 0.0
        assert lam[0] >= 0.0
        assert np.linalg.eigvalsh(rest)[0] > -1e-9 * np.abs(rest).max()
        assert added[0, 3:].min() >= 0.0


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45])
def test_the_relief_of_bending_of_an_isotropic_material_is_the_same_by_tensors(nu):
    """The general formula with G = mu, D = 2 mu and plane stress E / (1 - nu^2)."""
    size = np.array([[0.02, 0.03, 0.01]])
    at = np.stack(np.meshgrid(*[[0.25, 0.75]] * 3, indexing="ij"), -1).reshape(-1, 3)
    start_, V, one = np.array([0, 8]), np.full(8, size.prod() / 8), np.ones(8)
    mu, lam = lame(2e4 * one, nu * one)
    expected = bending_relief(size, start_, at, V, mu, lam)
    frame = np.tile(np.eye(3).ravel(), (8, 1))
    own = layered_relief(np.array([0]), size, start_, at, V, mu, lam, np.zeros((8, 5)), frame)
    assert own == pytest.approx(expected, abs=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("constants", "word"),
    [
        ((2e4, 0.25, 4e5, 0.2, 2e3), "Poisson ratio across the layers is 0.25, must be below 0.141"),
        ((2e4, 0.0, 4e5, 1.0, 2e3), "Poisson ratio in the layers is 1"),
        ((2e4, 0.0, 4e5, 0.2, 0.0), "shear modulus between the layers is 0 Pa"),
        ((2e4, 0.0, -4e5, 0.2, 2e3), "Young's modulus in the layers is -400000 Pa"),
    ],
)
def test_a_material_that_is_not_positive_definite_is_refused_by_its_value(constants, word):
    """The table's check says which of the five constants, and how large it may be; the solver refuses the same."""
    across, poisson, along, in_plane, shear = constants
    assert word in LayerConstants(along, in_plane, shear).problem(across, poisson)
    layers = Layers(np.array([along]), np.array([in_plane]), np.array([shear]), NORMAL[None])
    with pytest.raises(ModelError, match=r"'block': stiffness of layers is not positive definite"):
        layers.check("block", np.array([across]), np.array([poisson]))


def test_the_limit_of_the_poisson_ratio_is_that_of_the_compliance():
    """Just below it the stiffness has no negative eigenvalue, just above it has one."""
    along, in_plane, shear, across = 4e5, 0.2, 2e3, 2e4
    most = np.sqrt(0.5 * (1.0 - in_plane) * across / along)
    for poisson, sound in ((0.999 * most, True), (1.001 * most, False)):
        assert (np.linalg.eigvalsh(transverse_stiffness(across, poisson, along, in_plane, shear))[0] > 0.0) == sound
        assert (LayerConstants(along, in_plane, shear).problem(across, poisson) == "") == sound


@pytest.mark.parametrize("angle", [0.0, 0.4, 0.8])
def test_relief_leaves_every_motion_of_a_cell_its_stiffness(lab_slab, angle):
    """Beside the six rigid motions nothing is without energy, however layers lie and however flat cells are."""
    soft = lab_slab(angle)
    spared = with_definite_relief(soft)
    before = np.linalg.eigvalsh(rest_stiffness(soft, soft.relief))
    value = np.linalg.eigvalsh(rest_stiffness(spared, spared.relief))
    whole = np.linalg.eigvalsh(rest_stiffness(soft, np.zeros_like(soft.relief)))
    assert (value[:, 6] > 0.1 * whole[:, 6]).all()
    assert (np.abs(value[:, :6]) < 1e-6 * value[:, -1:]).all()
    assert np.abs(spared.relief).sum() > 0.0
    assert angle == 0.0 or (before[:, 0] < -1e-6 * before[:, -1]).any()


@pytest.fixture
def lab_slab():
    """Builds a soft system of flat cells whose layers are inclined by an angle [rad] about y."""

    def build(angle):
        start(1)
        axes = (np.linspace(0, 0.4, 5), np.linspace(0, 0.2, 5), np.linspace(0, 0.02, 5))
        middle = [0.5 * (p[:-1] + p[1:]) for p in (np.linspace(0, a[-1], 2 * len(a) - 1) for a in axes)]
        points = np.stack(np.meshgrid(*middle, indexing="ij"), axis=-1).reshape(-1, 3)
        one = np.ones(len(points))
        normal = np.tile([np.sin(angle), 0.0, np.cos(angle)], (len(points), 1))
        layers = Layers(2e5 * one, 0.2 * one, 400.0 * one, normal)
        held = np.zeros(tuple(len(a) for a in axes), dtype=np.int8)
        interior = Interior(
            points, one * 0.4 * 0.2 * 0.02 / len(points), 100 * one, 1.2e4 * one, 0.02 * one, axes, held, False, layers
        )
        surface = Box(np.array([0.4, 0.2, 0.02])).surface(0.05)
        grid = SignedDistance(np.full(3, -0.1), 0.05, np.ones((14, 10, 6), dtype=np.float32))
        at = surface.vertices + np.array([0.2, 0.1, 0.01])
        body = SoftBody("slab", False, at, surface.faces, grid, 1.0, np.zeros(3), 0.5, 0.4, 0.0, interior)
        return build_soft(Model((body,), np.zeros(3)))

    return build
