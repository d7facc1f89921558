"""Rays against meshes with known answers."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

EPS = float(np.finfo(np.float32).eps)


def plate(height: float = 0.0) -> Mesh:
    """A unit square facing up."""
    return Mesh.of([[0, 0, height], [1, 0, height], [1, 1, height], [0, 1, height]], [[0, 1, 2], [0, 2, 3]])


@settings(max_examples=30, deadline=None)
@given(st.floats(0.05, 0.95), st.floats(0.05, 0.95), st.floats(0.1, 5.0))
def test_hit_lies_where_the_ray_meets_the_plane(x: float, y: float, height: float) -> None:
    """A vertical ray meets the plane z = 0 at its own x, y after its own height."""
    hits = Raycaster(plate()).cast(np.array([[x, y, height]]), np.array([[0, 0, -1.0]]))
    # origins are rounded to single precision before the cast
    assert abs(hits.distance[0] - height) < 4 * EPS * max(height, 1.0)
    assert np.allclose(hits.position[0], [x, y, 0], atol=8 * EPS * max(height, 1.0))
    corners = plate().triangles[hits.face[0]]
    assert np.allclose(hits.barycentric[0] @ corners, [x, y, 0], atol=8 * EPS)


def test_both_sides_are_hit_and_the_normal_stays_as_wound() -> None:
    """The normal is the face's own, whichever side the ray comes from."""
    hits = Raycaster(plate()).cast(np.array([[0.5, 0.4, 1], [0.5, 0.4, -1]]), np.array([[0, 0, -1.0], [0, 0, 1.0]]))
    assert np.allclose(hits.normal, [[0, 0, 1], [0, 0, 1]], atol=EPS)


def test_a_miss_is_infinite() -> None:
    """Nothing hit: distance inf, face -1; an empty mesh is never hit."""
    away = (np.array([[2.0, 2.0, 1.0]]), np.array([[0, 0, -1.0]]))
    for mesh in (plate(), Mesh.of(np.zeros((0, 3)), np.zeros((0, 3)))):
        hits = Raycaster(mesh).cast(*away)
        assert np.isinf(hits.distance[0])
        assert hits.face[0] == -1
        assert not Raycaster(mesh).occluded(*away)[0]


def test_occlusion_ends_at_the_given_distance() -> None:
    """A plate 1 m away hides what is farther than 1 m and not what is nearer, for one limit and for one per ray."""
    origins, directions = np.tile([0.5, 0.4, 1.0], (2, 1)), np.tile([0, 0, -1.0], (2, 1))
    caster = Raycaster(plate())
    assert caster.occluded(origins, directions, 1.01).all()
    assert not caster.occluded(origins, directions, 0.99).any()
    assert caster.occluded(origins, directions, np.array([0.99, 1.01])).tolist() == [False, True]


def test_some_faces_keep_their_numbers() -> None:
    """A caster of some faces of a mesh hits these alone, and says which of the mesh they are."""
    steps = [plate(height) for height in (0.0, 1.0, 2.0)]
    whole = Mesh.concatenate(steps)
    middle = np.array([2, 3])
    origin, down = np.array([[0.1, 0.2, 3.0], [5.0, 5.0, 3.0]]), np.tile([0.0, 0.0, -1.0], (2, 1))
    hits = Raycaster(whole, middle).cast(origin, down)
    assert hits.face[0] in middle
    assert hits.face[1] == -1
    assert abs(hits.distance[0] - 2.0) < 4 * EPS * 3.0


def test_a_solid_is_left_where_another_stands_flush_on_it() -> None:
    """Whichever of the coinciding faces comes first in the mesh; from outside nothing is left."""
    flipped = plate().faces[:, ::-1]
    low = Mesh.concatenate([plate(1.0), Mesh.of(plate(-1.0).vertices, flipped)])
    high = Mesh.concatenate([plate(3.0), Mesh.of(plate(1.0).vertices, flipped)])
    start = np.array([[0.5, 0.4, 0.0], [0.5, 0.4, 2.0], [2.0, 2.0, 0.0]])
    ways = np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 1.0]])
    for pair in ([low, high], [high, low]):
        left = Raycaster(Mesh.concatenate(pair)).left_at(start, ways)
        assert np.allclose(left, [1.0, 1.0, np.inf], atol=4 * EPS)
    assert np.isinf(Raycaster(plate(1.0)).left_at(start[1:2], ways[1:2])).all()


def test_a_sheet_with_two_sides_is_no_solid() -> None:
    """It is left by no ray, alone or as both walls of a lampshade; a stack of flush things is."""
    up, down = plate(1.0), Mesh.of(plate(1.0).vertices, plate(1.0).faces[:, ::-1])
    start, way = np.array([[0.5, 0.4, 0.0]]), np.array([[0, 0, 1.0]])
    shade = [up, down, plate(2.0), Mesh.of(plate(2.0).vertices, down.faces)]
    assert np.isinf(Raycaster(Mesh.concatenate([up, down])).left_at(start, way)).all()
    assert np.isinf(Raycaster(Mesh.concatenate(shade)).left_at(start, way)).all()
    stack = Raycaster(Mesh.concatenate([*shade, plate(3.0)]))
    assert np.allclose(stack.left_at(start, way), 1.0, atol=4 * EPS)
