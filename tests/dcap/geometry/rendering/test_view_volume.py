"""What is left out of a picture's rays, and what they need not be cast for again, changes no byte of it."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering import surface
from dcap.geometry.rendering.picture import Exposure, exposed
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.geometry.rendering.view_volume import in_view
from dcap.scene.types.mesh import Mesh


def cluttered() -> list[Mesh]:
    """A floor, 300 small balls all around the origin, and one in the middle, which comes last."""
    random = np.random.default_rng(0)
    ball = trimesh.creation.icosphere(1, 0.08)
    corner = [[-4, -4, -0.4], [4, -4, -0.4], [4, 4, -0.4], [-4, 4, -0.4]]
    places = random.uniform([-4, -4, -0.3], [4, 4, 2.0], (300, 3))
    colors = random.integers(30, 220, (300, 3))
    balls = [Mesh.of(ball.vertices + at, ball.faces, color) for at, color in zip(places, colors, strict=True)]
    middle = trimesh.creation.icosphere(3, 0.25)
    return [Mesh.of(corner, [[0, 1, 2], [0, 2, 3]]), *balls, Mesh.of(middle.vertices, middle.faces, (200, 60, 40))]


def cameras() -> list[Camera]:
    """From several sides, one with its principal point off the middle, one from within the clutter."""
    target = np.array([0.05, 0.0, 0.1])
    first = looking_at(np.array([1.2, -1.6, 0.9]), target, 160, 120)
    beside = Camera(first.position, target, first.world_from_camera, 160, 120, first.focal, (30.0, 90.0), 1.2)
    return [first, beside, looking_at(np.array([-0.5, 0.3, 2.5]), target, 120, 160, fov_deg=30.0)]


def same(one: Exposure, other: Exposure) -> bool:
    """Whether two pictures have the same bytes, with their smoothed edges and depth."""
    a, b = one.picture(), other.picture()
    return a.rgb.tobytes() == b.rgb.tobytes() and a.depth.tobytes() == b.depth.tobytes()


@pytest.mark.parametrize("low_light", [False, True])
def test_faces_that_no_ray_can_meet_are_left_out(monkeypatch, low_light):
    """Much of a room is left out before a camera, and the picture is the same as with all of it."""
    prepared = PreparedMeshes(cluttered())
    kept = []

    def counted(mesh: Mesh, camera: Camera, key: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
        near = in_view(mesh, camera, key, reach)
        kept.append(near.mean())
        return near

    for camera in cameras():
        monkeypatch.setattr(surface, "in_view", counted)
        some = exposed(prepared, camera, low_light=low_light)
        monkeypatch.setattr(surface, "in_view", lambda mesh, *_: np.ones(len(mesh.faces), dtype=bool))
        assert same(some, exposed(prepared, camera, low_light=low_light))
    assert max(kept) < 0.9
    assert min(kept) < 0.4


@pytest.mark.parametrize("low_light", [False, True])
def test_adding_faces_is_having_them_at_once(low_light):
    """A picture with a ball, made from that without it, has the bytes of one that was taken with it."""
    prepared = PreparedMeshes(cluttered())
    ball = prepared.mesh_of_face == len(prepared.things) - 1
    for camera in cameras():
        alone = exposed(prepared.showing(~ball), camera, low_light=low_light)
        whole = exposed(prepared, camera, low_light=low_light)
        assert not same(alone, whole)
        assert same(alone.adding(ball), whole)
        assert same(alone.adding(np.zeros_like(ball)), alone)
