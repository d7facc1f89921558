"""The face nearest to a point, whatever the sizes of the faces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from solver.contact.nearest_face import NearestFace, distances


def uneven(seed):
    """A strip of large triangles beside small ones, wavy, and a label for each face: small ones alternate."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([[-1.0, -0.4], np.linspace(0.0, 0.2, 9)])
    grid = np.stack(np.meshgrid(x, np.linspace(0.0, 0.5, 6), indexing="ij"), axis=-1).reshape(-1, 2)
    vertices = np.column_stack([grid, 0.02 * rng.standard_normal(len(grid))])
    corner = np.arange(len(grid)).reshape(len(x), 6)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)
    middle = vertices[faces].mean(axis=1)
    return vertices, faces, (middle[:, 0] > 0.0) * (1 + (middle[:, 1] > 0.25)).astype(np.int64)


@given(st.integers(0, 50))
def test_labels_are_those_of_the_nearest_of_all_faces(seed):
    """The same as when the distance to every face is looked at, on the surface and away from it."""
    vertices, faces, label = uneven(seed)
    rng = np.random.default_rng(seed)
    share = rng.dirichlet(np.ones(3), 200)
    on = np.einsum("nk,nki->ni", share, vertices[faces[rng.integers(0, len(faces), 200)]])
    points = np.concatenate([on, on + 0.05 * rng.standard_normal(on.shape)])
    every = np.stack([distances(points, np.broadcast_to(one, (len(points), 3, 3))) for one in vertices[faces]], axis=1)
    found = NearestFace.of(vertices, faces, label)
    mine = found.nearest(points)
    assert every[np.arange(len(points)), mine] == pytest.approx(every.min(axis=1), abs=1e-12)
    chosen, best = found.label_at(points), every.min(axis=1)
    nearest_of_label = np.array([every[i, label == chosen[i]].min() for i in range(len(points))])
    assert nearest_of_label == pytest.approx(best, abs=1e-12)


def test_distance_to_a_triangle():
    """Above its middle, beyond an edge and beyond a corner, and of a triangle without area."""
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points = np.array([[0.2, 0.2, 0.3], [0.5, -0.4, 0.3], [-3.0, -4.0, 0.0]])
    assert distances(points, np.tile(flat, (3, 1, 1))) == pytest.approx([0.3, 0.5, 5.0])
    line = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    assert distances(np.array([[1.5, 0.7, 0.0]]), line) == pytest.approx([0.7])


def test_a_large_face_counts_where_the_vertices_of_a_small_one_are_nearer():
    """In the middle of a floor of two triangles, beside a small plate whose corners are near: it is the floor."""
    floor = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    plate = np.array([[0.02, 0, 0.01], [0.1, 0, 0.01], [0.1, 0.1, 0.01]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32)
    found = NearestFace.of(np.concatenate([floor, plate]), faces, np.array([0, 0, 1]))
    assert found.label_at(np.array([[0.0, 0.0, 1e-4], [0.09, 0.04, 0.0095]])).tolist() == [0, 1]
