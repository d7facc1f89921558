"""The contact query against closed forms and SciPy: where a point is in a body's start pose, how deep, which normal."""

import numpy as np
import pytest
from scipy import ndimage
from scipy.interpolate import RegularGridInterpolator

from solver.config import SolverConfig
from solver.kernels import query as kernels
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop

SIZE = np.array([0.2, 0.16, 0.12])
STRETCH = np.array([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.05], [0.0, 0.1, 0.8]])  # F, with shear and a turn


@pytest.fixture
def ask(lab):
    """Asks where points (n, 3) are in a soft box that is moved by a map; a rigid ball is the other body."""
    start(2)
    box = lab.soft("box", lab.Box(SIZE), [0, 0, 0], E=1e5, cell=0.02)
    one = ImplicitDrop(
        Model((box, lab.rigid("ball", lab.Capsule(0.02, 0.0), [0, 0, 1])), np.array([0, 0, -9.81])), SolverConfig()
    )

    def query(map_, points):
        state = one.start_state()
        state.x = map_(one.soft.rest)
        one.query.smooth[:] = 0.0
        one.query.find(state, one.query.begin(state, 1.0))  # averages the deformation at the nodes
        return box, one, state, one.query._locate(0, state, points, np.full((len(points), 3), np.nan))

    return query


def random_inside(count):
    """Points in the start pose, a cell and more away from edges, where the distance is that of one face."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (count, 3)) * (SIZE - 0.06)
    points[:, 2] = 0.5 * SIZE[2] - np.random.default_rng(1).uniform(0.001, 0.02, count)
    return points


def test_an_affine_map_is_inverted_exactly(ask):
    """Under x = F X the top is the plane with normal F^-T e_z; the distance to it is that of X over |F^-T e_z|."""
    X = random_inside(200)
    _, _, _, found = ask(lambda p: p @ STRETCH.T + 0.3, X @ STRETCH.T + 0.3)
    push = np.linalg.inv(STRETCH).T @ [0.0, 0.0, 1.0]
    assert found.material == pytest.approx(X, abs=2e-8)  # the inversion's tolerance is 1e-8 m
    assert found.gap == pytest.approx(
        (X[:, 2] - 0.5 * SIZE[2]) / np.linalg.norm(push), abs=1e-7
    )  # samples are single precision
    assert found.normal == pytest.approx(np.tile(push / np.linalg.norm(push), (200, 1)), abs=1e-5)
    assert found.weight.sum(axis=1) == pytest.approx(1.0)


def test_a_bent_grid_is_inverted_as_scipy_maps_it(ask):
    """The map back and forth; a point's weights and nodes give the place of the surface that is nearest to it."""

    def bend(p):
        return np.stack([p[:, 0] + 0.5 * p[:, 2] ** 2, p[:, 1] * (1 + p[:, 0]), p[:, 2] + 0.8 * p[:, 0] ** 2], axis=1)

    X = random_inside(100)
    _, one, state, _ = ask(bend, X[:1])
    soft = one.soft
    planes = soft.bodies[0].planes
    shape = tuple(len(p) for p in planes)
    lattice = np.full((*shape, 3), np.nan)
    index = [np.searchsorted(p, soft.rest[:, a] - 1e-9) for a, p in enumerate(planes)]
    lattice[tuple(index)] = state.x
    x = RegularGridInterpolator(planes, lattice)(X)
    assert np.isfinite(x).all()
    _, _, state, found = ask(bend, x)
    assert found.material == pytest.approx(X, abs=5e-8)
    assert RegularGridInterpolator(planes, lattice)(found.material) == pytest.approx(x, abs=2e-8)
    surface = np.einsum("ka,kai->ki", found.weight, state.x[found.node])
    assert surface + found.gap[:, None] * found.normal == pytest.approx(x, abs=5e-6)  # as far as three steps get


def test_the_distance_is_scipys_quadratic_spline(ask, lab):
    """Value and gradient of the samples, by map_coordinates without its prefilter and by central differences."""
    X = random_inside(50)
    box, _, _, found = ask(lambda p: p, X)
    grid = box.distance

    def spline(points):
        return ndimage.map_coordinates(
            grid.values.astype(float), (points - grid.origin).T / grid.spacing, order=2, prefilter=False
        )

    step = 1e-6 * np.eye(3)
    slope = np.stack([(spline(X + s) - spline(X - s)) / 2e-6 for s in step], axis=1)
    rigid, place, normal = np.zeros(len(X)), np.zeros_like(X), np.zeros_like(X)
    everywhere, nowhere = np.arange(len(X), dtype=np.int32), np.zeros(3)
    kernels.query_rigid(
        X, everywhere, np.eye(3), nowhere, nowhere, grid.origin, grid.spacing, grid.values, place, rigid, normal
    )
    assert rigid == pytest.approx(spline(X), abs=1e-12)
    assert found.gap == pytest.approx(rigid, abs=1e-9)  # of a soft body from its surface: samples are single precision
    assert found.normal == pytest.approx(slope / np.linalg.norm(slope, axis=1, keepdims=True), abs=1e-7)


@pytest.mark.parametrize("pushed", [0.015, 0.0205, 0.024])
def test_a_gap_does_not_jump_where_a_cell_folds_over(ask, pushed):
    """A node of the top is pushed down to its neighbour below it, and beyond, as under a sharp edge: points of the
    pocket are as deep as they are below its bottom."""
    middle = np.array([0.0, 0.0, 0.5 * SIZE[2]])

    def poke(p):
        moved = p.copy()
        moved[np.argmin(np.linalg.norm(p - middle, axis=1))] -= [0.0, 0.0, pushed]
        return moved

    below = np.arange(5e-5, 1e-3, 5e-5)
    _, _, _, found = ask(poke, middle - np.outer(pushed + below, [0.0, 0.0, 1.0]))
    assert found.unlocated == 0
    assert found.normal[:, 2] == pytest.approx(1.0, abs=0.05)
    assert found.gap == pytest.approx(-below, abs=2e-5)


def test_points_outside_are_no_contact(ask):
    """A point beyond the grid, and one in the plane of the top but beside it."""
    _, _, _, found = ask(lambda p: p, np.array([[0.0, 0.0, 0.3], [0.5, 0.0, 0.06]]))
    assert len(found.point) == 0
    assert found.unlocated == 0


def test_points_in_crushed_cells_are_counted(ask):
    """Where det F is below 1e-3 no place is found: no contact, and said so."""
    flat = np.diag([1.0, 1.0, 1e-4])
    _, _, _, found = ask(lambda p: p @ flat, random_inside(10) @ flat)
    assert (found.gap > 1.0).all()
    assert found.unlocated == 10


def test_contacts_say_what_could_not_be_located_even_if_nothing_touches(ask):
    """Counts of the query, which the certificate reports, survive where no point at all makes contact."""
    flat = np.diag([1.0, 1.0, 1e-4])
    _, one, state, _ = ask(lambda p: p @ flat, random_inside(10) @ flat)
    state.center[1] = 0.0  # the ball lies in the crushed box
    found = one.query.find(state, one.query.begin(state, 1.0))
    assert len(found.position) == 0
    assert found.unlocated > 0
