"""Discs on an object's surface: where they lie, how they look, and that nothing shines through."""

import numpy as np
import pytest
import trimesh

from dcap.geometry.camera import looking_at
from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.splatting.discs import disc_spacing, discs_on
from dcap.geometry.splatting.render import Splatter
from dcap.scene.types.mesh import Mesh
from solver.runtime import start

RADIUS, SPACING = 0.1, 0.005


def ball() -> Mesh:
    """Half red, half blue."""
    mesh = trimesh.creation.icosphere(4, RADIUS)
    return Mesh.of(mesh.vertices, mesh.faces, np.where(mesh.vertices[:, 2:] > 0, [200, 30, 30], [30, 30, 200]))


def test_discs_lie_flat_on_the_surface_in_its_colours():
    mesh = ball()
    found = discs_on(mesh, SPACING)
    assert abs(len(found) / (4 * np.pi * (RADIUS / SPACING) ** 2) - 1.0) < 0.01
    assert MeshDistance(mesh).unsigned(found.position.astype(np.float64)).max() < 1e-6
    outwards = found.position / np.linalg.norm(found.position, axis=1, keepdims=True)
    # faces of the icosphere lean by up to its edge over its diameter
    assert np.einsum("ni,ni->n", found.axes[:, :, 2], outwards).min() > np.cos(0.07)
    assert found.scale[:, 2].max() < 0.2 * found.scale[:, 0].min()
    upper = found.position[:, 2] > 0.01
    assert (found.color[upper] == [200, 30, 30]).all()
    assert found.degree == 0


@pytest.mark.slow
def test_nothing_shines_through():
    """Of the near half alone less than 1 % of the light passes on average, and nowhere a half."""
    start(2)
    mesh = ball()
    found = discs_on(mesh, disc_spacing(mesh))
    camera = looking_at(np.array([0.6, 0.2, 0.2]), np.zeros(3), 160, 160, fov_deg=25.0)
    near = found.subset(np.einsum("ni,ni->n", found.axes[:, :, 2], found.position - camera.position) < 0)
    ways = camera.directions(camera.pixel_centers)
    within = Raycaster(ball()).cast(np.broadcast_to(camera.position, ways.shape), ways).face.reshape(160, 160) >= 0
    light = Splatter(near).view(camera).light[within]
    assert within.sum() > 4000
    assert light.mean() < 0.01
    assert light.max() < 0.5


def test_colours_may_come_from_elsewhere():
    """A sampler is asked for faces and weights; it may be a texture."""
    mesh = ball()

    def by_height(face, weight):
        height = np.einsum("nk,nk->n", weight, mesh.vertices[mesh.faces[face], 2])
        return np.repeat((0.5 + height / (4 * RADIUS))[:, None], 3, axis=1)

    found = discs_on(mesh, SPACING, by_height)
    assert np.abs(found.color[:, 0] / 255.0 - (0.5 + found.position[:, 2] / (4 * RADIUS))).max() < 0.003
