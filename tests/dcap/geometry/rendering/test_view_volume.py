"""What is left out of a picture's rays, and what they need not be cast for again, changes no byte of it."""

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering import surface
from dcap.geometry.rendering.picture import Exposure, exposed
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.geometry.rendering.view_volume import cut_faces, in_view
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


def sheet(origin: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], noise: float = 0.0) -> Mesh:
    """A parallelogram of 12 x 12 quads with noise."""
    s, t = np.meshgrid(*[np.linspace(0, 1, 13)] * 2, indexing="ij")
    points = np.array(origin) + s[..., None] * np.array(u) + t[..., None] * np.array(v)
    points = points + noise * np.random.default_rng(0).standard_normal(points.shape)
    corner = np.arange(169).reshape(13, 13)
    a, b, c, d = (corner[k].ravel() for k in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    return Mesh.of(points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def room(yaw: float, noise: float) -> Mesh:
    """Floor, ceiling, south, north, west and east walls of a 4 x 4 x 2.5 m room, turned."""
    pieces = [
        sheet((0, 0, 0), (4, 0, 0), (0, 4, 0), noise), sheet((0, 0, 2.5), (4, 0, 0), (0, 4, 0), noise),
        sheet((0, 0, 0), (4, 0, 0), (0, 0, 2.5), noise), sheet((0, 4, 0), (4, 0, 0), (0, 0, 2.5), noise),
        sheet((0, 0, 0), (0, 4, 0), (0, 0, 2.5), noise), sheet((4, 0, 0), (0, 4, 0), (0, 0, 2.5), noise),
    ]  # fmt: skip
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    mesh = Mesh.concatenate(pieces)
    return Mesh.of(mesh.vertices @ turn.T, mesh.faces)


def test_only_the_wall_in_front_and_the_ceiling_are_cut() -> None:
    """A camera outside of the south wall: it and the ceiling go as a whole, noisy and turned or not."""
    for yaw, noise in ((0.0, 0.0), (0.5, 0.004)):
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        camera, target = turn @ [2.0, -1.5, 2.2], turn @ [2.0, 2.0, 0.5]
        mesh = room(yaw, noise)
        cut = cut_faces(mesh, np.ones(len(mesh.faces), dtype=bool), camera, target)
        assert cut.reshape(6, -1).mean(axis=1).tolist() == [0, 1, 1, 0, 0, 0]
        only_floor = np.arange(len(mesh.faces)) < 288
        assert not cut_faces(mesh, only_floor, camera, target).any()
