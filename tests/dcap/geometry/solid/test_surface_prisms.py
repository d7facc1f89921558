"""Surfaces as few triangles and prisms: a dent stays as it is, and prisms stay in the solid."""

import numpy as np
import pytest
import trimesh
from dented_bed import DEPTH, RADIUS, TOP, settled

from dcap.geometry.solid.convex_pieces import outside, volume_of
from dcap.geometry.solid.surface_prisms import THROUGH, TOLERANCE, prisms, thinned
from dcap.scene.types.mesh import Mesh


def soft_dent(count: int = 81) -> Mesh:
    """A bell-shaped dent 5 mm deep and some 10 cm wide in a plane 40 cm wide, in faces of 5 mm."""
    x, y = np.meshgrid(*[np.linspace(-0.2, 0.2, count)] * 2, indexing="ij")
    z = -0.005 * np.exp(-(x**2 + y**2) / 0.05**2)
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return Mesh.of(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces)


def test_a_thinned_dent_is_as_deep() -> None:
    """A tenth of the faces lies within the tolerance of the dent, at its bottom too, and the plane keeps its border."""
    dent = soft_dent()
    few = thinned(dent)
    assert len(few.mesh.faces) <= 0.1 * len(dent.faces)
    assert few.deviation <= TOLERANCE
    x, y, z = few.mesh.vertices.T
    np.testing.assert_allclose(z, -0.005 * np.exp(-(x**2 + y**2) / 0.05**2), atol=TOLERANCE)
    assert z.min() == pytest.approx(-0.005, abs=TOLERANCE)
    np.testing.assert_allclose(few.mesh.bounds[:, :2], dent.bounds[:, :2], atol=TOLERANCE)


def test_a_tolerance_that_no_budget_keeps_is_reported() -> None:
    """With eight faces for a dent the deviation is told."""
    assert thinned(settled().bodies[1].surface, budgets=(8,)).deviation > 1e-3


def test_prisms_lie_under_the_surface() -> None:
    """No prism of a dent reaches into the ball that made it by more than the chords of its mesh, and each stands on a
    face."""
    bed = thinned(settled().bodies[1].surface).mesh
    found = [one for one in prisms(bed, bed) if one is not None]
    assert len(found) == len(bed.faces)
    center = np.array([0.0, 0.0, TOP - DEPTH + RADIUS])
    rng = np.random.default_rng(0)
    for one in found:
        weight = rng.dirichlet(np.ones(len(one.vertices)), 30)
        depth = RADIUS - np.linalg.norm(weight @ one.vertices - center, axis=1)
        # a chord of 1.5 cm, the edges of the surface, bulges by edge^2 / (8 radius), those of faces by a third more
        assert depth.max() <= 4.0 / 3.0 * 0.015**2 / (8.0 * RADIUS) + TOLERANCE
        assert volume_of(one) > 0.0


def test_prisms_of_a_board_do_not_come_out_of_its_other_side() -> None:
    """Under either side of a board 2 cm thick they end before its middle."""
    mesh = trimesh.creation.box((0.3, 0.2, 0.02))
    board = Mesh.of(mesh.vertices, mesh.faces)
    for one in prisms(board, board):
        assert one is not None
        assert np.abs(one.vertices).max(axis=0) == pytest.approx(np.abs(np.clip(one.vertices, -0.15, 0.15)).max(axis=0))
        if np.ptp(one.vertices[:, 2]) < 0.0199:
            assert np.ptp(one.vertices[:, 2]) <= THROUGH * 0.02 + 1e-6


def test_a_fold_in_what_rests_on_the_surface_has_no_prism() -> None:
    """A face within the ball that looks away from its middle would fill it: it is left out."""
    sphere = trimesh.creation.icosphere(3, 0.1)
    ball = Mesh.of(sphere.vertices, sphere.faces)
    inner = Mesh.of([[0.09, 0, 0], [0.09, 0.01, 0], [0.09, 0, 0.01]], [[0, 1, 2]])
    below = Mesh.of([[-0.01, -0.01, -0.1], [0.01, -0.01, -0.1], [0, 0.01, -0.1]], [[0, 1, 2]])
    assert prisms(inner, inner, free=ball) == [None]
    (kept,) = prisms(below, below, free=ball)
    assert kept is not None
    assert outside(kept, np.zeros((1, 3)))[0] == pytest.approx(0.1, abs=1e-6)
