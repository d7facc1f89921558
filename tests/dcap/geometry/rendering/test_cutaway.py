"""Walls in the way are cut, the others stay; dents are carried over to the scene's mesh."""

import numpy as np

from dcap.geometry.rendering.view_volume import cut_faces
from dcap.scene.types.mesh import Mesh


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
