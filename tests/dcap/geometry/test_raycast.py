"""Rays against meshes with known answers."""

import numpy as np

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

EPS = float(np.finfo(np.float32).eps)


def plate(height: float = 0.0) -> Mesh:
    """A unit square facing up."""
    return Mesh.of([[0, 0, height], [1, 0, height], [1, 1, height], [0, 1, height]], [[0, 1, 2], [0, 2, 3]])


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
