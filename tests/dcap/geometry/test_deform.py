"""A picture's mesh follows the simulated surface: as closely as that bends, and no finer."""

import numpy as np

from dcap.geometry.deform import COARSE, FLAT, displaced, edge_lengths
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

CELLS, WIDTH, DEPTH, SPREAD = 60, 1.2, 0.02, 0.08
EDGE = np.sqrt(2.0) * WIDTH / CELLS


def simulated() -> Mesh:
    """A square of fine cells at height 0."""
    x, y = np.meshgrid(*[np.linspace(-WIDTH / 2, WIDTH / 2, CELLS + 1)] * 2, indexing="ij")
    corner = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, CELLS + 1)
    a, b, c, d = (c.ravel() for c in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh.of(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1), faces)


def plate() -> Mesh:
    """Two triangles under it, a little smaller."""
    half = 0.45 * WIDTH
    return Mesh.of([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]], [[0, 1, 2], [0, 2, 3]])


def moved(depth: np.ndarray) -> tuple[Mesh, np.ndarray]:
    """The plate after the simulated surface sank by depths (n,), and where its faces come from."""
    surface, displacement = simulated(), np.zeros(((CELLS + 1) ** 2, 3))
    displacement[:, 2] = -depth
    end = Mesh(surface.vertices + displacement, surface.faces, surface.colors)
    found = displaced(plate(), np.ones(2, dtype=bool), end, displacement)
    return found.mesh, found.origin


def dent(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A round dent off the middle."""
    return DEPTH * np.exp(-((x - 0.2) ** 2 + (y + 0.1) ** 2) / (2 * SPREAD**2))


def test_a_dent_is_followed_everywhere():
    """Rays from above meet the plate at the dent's depth, up to what edges of 1.5 cells leave out."""
    place = simulated().vertices
    found, _ = moved(dent(place[:, 0], place[:, 1]))
    at = np.random.default_rng(0).uniform(-0.5, 0.5, (4000, 2))
    hits = Raycaster(found).cast(np.column_stack([at, np.ones(4000)]), np.tile([0.0, 0.0, -1.0], (4000, 1)))
    # chords of a curve with second derivative DEPTH / SPREAD^2: h^2 / 8 of it along each of two directions, for the
    # plate's edges and once more for the simulated ones; and FLAT for edges left whole, of up to five rounds
    allowed = 2 * ((1.5 * EDGE) ** 2 + EDGE**2) / 8 * DEPTH / SPREAD**2 + 5 * FLAT
    assert np.abs(hits.position[:, 2] + dent(*at.T)).max() < allowed < DEPTH / 5


def test_what_does_not_bend_stays_coarse():
    """A tilt moves the plate without a bend: its edges are halved only until no dent could hide between their ends;
    a dent refines its neighbourhood and little else."""
    place = simulated().vertices
    tilted, origin = moved(0.01 + 0.02 * place[:, 0])
    assert edge_lengths(tilted).min() > COARSE * EDGE / 2 / np.sqrt(2.0) - 1e-9
    assert np.allclose(tilted.vertices[:, 2], -0.01 - 0.02 * tilted.vertices[:, 0], atol=1e-6)
    assert set(origin) == {0, 1}
    dented, _ = moved(dent(place[:, 0], place[:, 1]))
    lengths, middle = edge_lengths(dented), dented.triangles.mean(axis=1)
    away = np.hypot(middle[:, 0] - 0.2, middle[:, 1] + 0.1)
    assert np.median(lengths[away < SPREAD]) < 1.5 * EDGE < np.median(lengths[away > 5 * SPREAD])


def test_faces_that_may_not_move_stay():
    """A second plate beside the first keeps its corners, and gets no hole where the first was split."""
    one, half = plate(), 0.45 * WIDTH
    other = Mesh(one.vertices + np.array([2 * half, 0.0, 0.0]), one.faces, one.colors)
    surface, displacement = simulated(), np.zeros(((CELLS + 1) ** 2, 3))
    displacement[:, 2] = -dent(surface.vertices[:, 0], surface.vertices[:, 1])
    end = Mesh(surface.vertices + displacement, surface.faces, surface.colors)
    found = displaced(Mesh.concatenate([one, other]), np.arange(4) < 2, end, displacement)
    both, origin = found.mesh, found.origin
    still = np.unique(both.faces[origin >= 2])
    assert np.abs(both.vertices[still, 2]).max() == 0.0
    assert np.isclose(both.face_areas[origin >= 2].sum(), (2 * half) ** 2)
    assert (np.diff(origin) >= 0).all()
