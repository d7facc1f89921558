"""Gaussians on a moving surface: closed forms of where they go, what shape and colours they get, and what stays."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.splatting.carried import (
    CLOSE,
    FAR,
    CarriedSplats,
    SurfaceMotion,
    carried,
    strained,
)
from dcap.scene.types.gaussians import COEFFICIENTS, Gaussians, harmonics, turned_harmonics
from dcap.scene.types.mesh import Mesh

CELLS, WIDTH, DEPTH, SPREAD = 80, 0.8, 0.02, 0.08
EDGE = np.sqrt(2.0) * WIDTH / CELLS
FINE = 0.002
"""A deviation over which the dent hardly bends: sagitta (2 FINE)^2 / 2 DEPTH / SPREAD^2 = 0.025 mm."""


def sheet(height: float = 0.0) -> Mesh:
    """A square of fine cells that looks up."""
    x, y = np.meshgrid(*[np.linspace(-WIDTH / 2, WIDTH / 2, CELLS + 1)] * 2, indexing="ij")
    corner = np.arange((CELLS + 1) ** 2).reshape(CELLS + 1, CELLS + 1)
    a, b, c, d = (c.ravel() for c in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh.of(np.stack([x.ravel(), y.ravel(), np.full(x.size, height)], axis=1), faces)


def dent(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Downwards, and a quarter of it sideways, shape (n, 3)."""
    depth = DEPTH * np.exp(-(points[:, 0] ** 2 + points[:, 1] ** 2) / (2 * SPREAD**2))
    return np.stack([0.25 * depth, np.zeros(len(points)), -depth], axis=1)


def dent_slope(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """Its derivatives along x and y, shape (n, 3, 2)."""
    return -np.einsum("ni,nj->nij", dent(points), points[:, :2]) / SPREAD**2


def motion() -> SurfaceMotion:
    mesh = sheet()
    return SurfaceMotion(mesh, dent(mesh.vertices), np.ones(len(mesh.faces), dtype=bool))


def discs(position: NDArray[np.floating], size: float = FINE, degree: int = 0, seed: int = 0) -> Gaussians:
    """Flat discs across z, turned about it, with random harmonics."""
    random, n = np.random.default_rng(seed), len(position)
    spin = Rotation.from_rotvec(np.outer(random.uniform(0, 6, n), [0, 0, 1])).as_quat(scalar_first=True)
    return Gaussians(
        position.astype(np.float32), np.tile(np.log([size, 0.6 * size, 0.05 * size]), (n, 1)).astype(np.float32),
        spin.astype(np.float32), np.full(n, 2.0, np.float32), random.standard_normal((n, 3)).astype(np.float32),
        random.standard_normal((n, 3, COEFFICIENTS[degree])).astype(np.float32),
    )  # fmt: skip


def on_sheet(count: int, reach: float = 0.2, height: float = 0.0) -> NDArray[np.float64]:
    place = np.random.default_rng(1).uniform(-reach, reach, (count, 3))
    place[:, 2] = height
    return place


def covariance(splats: Gaussians) -> NDArray[np.float64]:
    half = splats.axes.astype(np.float64) * splats.scale[:, None, :]
    return np.asarray(half @ half.transpose(0, 2, 1))


def all_of(splats: Gaussians, found: CarriedSplats) -> Gaussians:
    return found.into(splats, 0)


def test_centres_and_shapes_follow_a_known_dent():
    """On the surface the displacement is the dent's own, and a disc gets F S F^T by the dent's derivatives."""
    splats = discs(on_sheet(300))
    found = all_of(splats, carried(splats, np.eye(4), motion()))
    bend = DEPTH / SPREAD**2
    # chords of the sheet's edges in two directions, and single precision
    assert np.abs(found.position - splats.position - dent(splats.position)).max() < 2 * EDGE**2 / 8 * bend + 1e-6
    F = np.tile(np.eye(3), (300, 1, 1))
    F[:, :, :2] += dent_slope(splats.position)
    flat = covariance(splats)
    flat[:, 2, :] = flat[:, :, 2] = 0.0
    expected = F @ flat @ F.transpose(0, 2, 1)
    # slopes are means over an edge to either side, by which they err by the third derivative and a chord, and the
    # disc's own thickness is left out
    off = EDGE**2 * bend / SPREAD + EDGE * bend / 2
    assert np.abs(covariance(found) - expected).max() < (2 * off + 0.05**2 * 4) * FINE**2
    assert np.abs(covariance(splats) - expected).max() > 3 * off * FINE**2


def test_a_turn_turns_shape_and_colours():
    """By a rotation F = R the covariance is R S R^T, and the colour seen along R d is the one that was seen along d."""
    splats = discs(on_sheet(40), degree=3)
    turns = Rotation.random(40, random_state=0).as_matrix()
    found = strained(splats, turns, np.zeros((40, 3)))
    assert np.abs(covariance(found) - turns @ covariance(splats) @ turns.transpose(0, 2, 1)).max() < 1e-5 * FINE**2
    assert np.abs(found.log_scale - splats.log_scale).max() < 1e-5  # in the order of the axes that there were
    ways = np.random.default_rng(2).standard_normal((20, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for i, turn in enumerate(turns):
        before = splats.rest[i] @ harmonics(ways, 3).T
        after = found.rest[i] @ harmonics(ways @ turn.T, 3).T
        assert np.abs(before - after).max() < 1e-5
    one = turned_harmonics(splats.rest, turns[0], 3)
    each = turned_harmonics(splats.rest, np.tile(turns[0], (40, 1, 1)), 3)
    assert np.abs(one - each).max() < 1e-5


def test_below_it_fades_as_in_a_half_space_and_above_into_air():
    """1 - d / sqrt(d^2 + L^2) of the surface's, L by the area that moved by more than half of the most: of
    exp(-r^2 / 2 s^2) that within r = s sqrt(2 ln 2); all within CLOSE above, nothing from FAR on; order is kept."""
    field = motion()
    length = SPREAD * np.sqrt(2 * np.log(2.0))
    assert abs(field.length / length - 1.0) < 2 * EDGE / length  # counted by whole faces
    depth = np.array([0.0, 0.01, 0.03, 0.1])
    shift = field.at(np.stack([0 * depth, 0 * depth, -depth], axis=1))
    assert np.allclose(shift[:, 2], -DEPTH * (1 - depth / np.hypot(depth, field.length)), atol=1e-6)
    above = field.at(np.array([[0, 0, 0.9 * CLOSE], [0, 0, 0.5 * (CLOSE + FAR)], [0, 0, 1.1 * FAR]]))
    assert np.allclose(above[:, 2], [-DEPTH, -DEPTH / 2, 0.0], atol=1e-6)
    line = np.linspace(-0.3, 0.1, 400)
    after = line + field.at(np.stack([0 * line, 0 * line, line], axis=1))[:, 2]
    assert (np.diff(after) > 0.0).all()


def test_what_stands_on_it_stays():
    """Gaussians nearest to a face that may not carry keep their place: a plate 1 cm above the middle of the dent."""
    below, plate = sheet(), sheet(0.01)
    mesh = Mesh.concatenate([below, plate])
    movable = np.arange(len(mesh.faces)) < len(below.faces)
    shift = np.concatenate([dent(below.vertices), 0 * plate.vertices])
    splats = discs(np.concatenate([on_sheet(20, 0.05), on_sheet(20, 0.05, 0.009)]))
    found = carried(splats, np.eye(4), SurfaceMotion(mesh, shift, movable))
    assert found.index.tolist() == list(range(20))


def test_any_frame_and_unit_gives_the_same():
    """Of a file in centimetres that lies on its side: what comes out, brought to the world, is what the world gives."""
    world_from_file = np.eye(4)
    world_from_file[:3, :3] = 0.01 * Rotation.from_euler("x", 90, degrees=True).as_matrix()
    world_from_file[:3, 3] = [0.1, -0.2, 0.3]
    mesh = sheet()
    there = Mesh(mesh.vertices + world_from_file[:3, 3], mesh.faces, mesh.colors)
    field = SurfaceMotion(there, dent(mesh.vertices), np.ones(len(mesh.faces), dtype=bool))
    world = discs(on_sheet(100) + world_from_file[:3, 3], 0.02, degree=2)
    own = world.transformed(np.asarray(np.linalg.inv(world_from_file)))
    a, b = carried(own, world_from_file, field), carried(world, np.eye(4), field)
    assert len(a.more) == len(b.more) > 0
    for one, two in ((a.splats, b.splats), (a.more, b.more)):
        moved = one.transformed(world_from_file)
        assert np.abs(moved.position - two.position).max() < 1e-5
        assert np.abs(covariance(moved) - covariance(two)).max() < 1e-3 * 0.02**2
        assert np.abs(moved.rest - two.rest).max() < 1e-3


def test_a_large_disc_follows_by_its_pieces():
    """One that spans the dent cannot; of its pieces each lies on the dented surface to within TOLERANCE and chords."""
    splats = discs(np.array([[0.02, 0.0, 0.0]]), 0.08)
    found = carried(splats, np.eye(4), motion())
    assert len(found.more) > 100
    x, y, z = found.more.position.astype(np.float64).T
    start = np.stack([x, y, 0 * z], axis=1)
    for _ in range(20):  # whence it came, by the dent's own sideways motion
        start[:, :2] = np.stack([x, y], axis=1) - dent(start)[:, :2]
    inside = np.abs(start[:, :2]).max(axis=1) < WIDTH / 2
    assert np.abs(z - dent(start)[:, 2])[inside].max() < 1e-4
    assert np.ptp(z) > 0.8 * DEPTH
