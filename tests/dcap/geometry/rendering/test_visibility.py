"""Light that reaches pixels: the filter against a slow twin, and shares that are known."""

import numpy as np

from dcap.geometry.camera import looking_at
from dcap.geometry.rendering.shading import Lights
from dcap.geometry.rendering.surface import PreparedMeshes, RenderScene
from dcap.geometry.rendering.view_volume import SKY_REACH
from dcap.scene.types.mesh import Mesh


def test_a_lid_leaves_the_share_of_the_sky_that_its_distance_says():
    """An open plate has all light. Under a wide lid at height d it has none of the key light, and of the sky what of
    rays of length R s^2, s uniform, at an angle with cosine c of density 2 c, ends below the lid:
    E[sqrt(d / (R c))] = 4/3 sqrt(d / R) for d << R."""
    corner, faces, height = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]), [[0, 1, 2], [0, 2, 3]], 0.01
    plate, lid = Mesh.of(corner, faces), Mesh.of(corner + np.array([0.0, 0.0, height]), faces)
    camera = looking_at(np.array([0.0, -2.0, 0.8 * height]), np.array([0.0, 0.0, -0.1]), 64, 64)
    for meshes, key, sky in ([plate], 1.0, 1.0), ([plate, lid], 0.0, 4 / 3 * np.sqrt(height / (SKY_REACH * 2.0))):
        scene = RenderScene(PreparedMeshes(meshes), camera)
        surface = scene.look(camera.pixel_centers)
        rays = Lights(scene.light, scene.reach, (64, 64)).arriving(scene.caster, surface)
        light = rays.shares.reshape(2, 64, 64)[:, 40:]
        assert (surface.mesh_index.reshape(64, 64)[40:] == 0).all()
        assert (light[0] == key).all()
        # 192 directions and lengths of a low-discrepancy sequence: their mean is off by about log(192) / 192
        assert abs(light[1].mean() - sky) < 0.03
