"""Light that reaches pixels: the filter against a slow twin, and shares that are known."""

import numpy as np

from dcap.geometry.camera import looking_at
from dcap.geometry.rendering import shading as module
from dcap.geometry.rendering.shading import PLANE_TOLERANCE, WINDOW, Lights, gather
from dcap.geometry.rendering.surface import PreparedMeshes, RenderScene, SurfaceHits
from dcap.geometry.rendering.view_volume import SKY_REACH
from dcap.scene.types.mesh import Mesh

HEIGHT, WIDTH = 13, 11
SHAPE = (HEIGHT, WIDTH)


def bumpy() -> SurfaceHits:
    """Pixels 1 cm apart on a surface whose height and normal vary by about the filter's tolerances; one is empty."""
    random = np.random.default_rng(0)
    count = HEIGHT * WIDTH
    surface = SurfaceHits.empty(count)
    row, column = np.divmod(np.arange(count), WIDTH)
    surface.position[:] = np.stack([0.01 * column, 0.01 * row, random.normal(0.0, PLANE_TOLERANCE, count)])
    normal = np.stack([*random.normal(0.0, 0.2, (2, count)), np.ones(count)])
    surface.smooth[:] = normal / np.linalg.norm(normal, axis=0)
    surface.distance[:] = random.uniform(0.5, 1.5, count)
    surface.mesh_index[:] = 0
    surface.mesh_index[40], surface.distance[40] = -1, np.inf
    surface.smooth[:, 40] = 0.0
    return surface


def slowly_gathered(light: np.ndarray, surface: SurfaceHits) -> np.ndarray:
    """The filter as its docstring says, pixel by pixel in double precision."""
    position = surface.position.astype(float).reshape(3, *SHAPE)
    normal = surface.smooth.astype(float).reshape(3, *SHAPE)
    depth = np.where(np.isfinite(surface.distance), surface.distance, 1.0).astype(float).reshape(SHAPE)
    for way in ((0, 1), (1, 0)):
        result = np.zeros_like(light)
        for y, x in np.ndindex(SHAPE):
            total, weights = light[:, y, x].copy(), 1.0
            for k in range(-WINDOW, WINDOW + 1):
                v, u = y + k * way[0], x + k * way[1]
                if k == 0 or not (0 <= v < HEIGHT and 0 <= u < WIDTH):
                    continue
                away = normal[:, y, x] @ (position[:, v, u] - position[:, y, x]) / (PLANE_TOLERANCE * depth[y, x])
                turn = np.clip(normal[:, v, u] @ normal[:, y, x], 0.0, 1.0)
                weight = turn**8 * np.exp(-(away**2)) * (0.5 if abs(k) == WINDOW else 1.0)
                total += weight * light[:, v, u]
                weights += weight
            result[:, y, x] = total / weights
        light = result
    return light


def test_gathered_light_is_the_twins(monkeypatch):
    """Whole or cut into bands of two rows, the filter gives the slow twin's means, and every cut the same bytes."""
    surface = bumpy()
    light = np.random.default_rng(1).uniform(0.0, 1.0, (2, *SHAPE))
    wanted = slowly_gathered(light, surface)
    whole = gather(light.astype(np.float32).reshape(2, -1), surface, SHAPE)
    monkeypatch.setattr(module, "BAND", 2 * WIDTH)
    cut = gather(light.astype(np.float32).reshape(2, -1), surface, SHAPE)
    assert whole.tobytes() == cut.tobytes()
    # single precision: exp(-away^2) loses up to 2 away^2 eps of the largest away that still counts (about 4), 18 terms
    assert np.allclose(whole.reshape(2, *SHAPE), wanted, atol=18 * 32 * np.finfo(np.float32).eps)


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
