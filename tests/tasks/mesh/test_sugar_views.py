"""Pictures for SuGaR: one pixel by every description of a camera, and splats that look like the mesh they lie on."""

from typing import Any

import numpy as np
import pytest

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import psnr, unlit
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.sugar import cameras_json
from dcap.synthetic.shapes import joined, moved, rounded_box
from tasks.mesh.sugar_views import colmap_model, names, pictures

PLACE = np.array([0.3, -0.2, 0.9])


def one_white_dot() -> Gaussians:
    """A small opaque Gaussian at PLACE."""
    return Gaussians(
        PLACE[None].astype(np.float32), np.full((1, 3), np.log(0.005), np.float32),
        np.array([[1.0, 0, 0, 0]], np.float32), np.array([9.0], np.float32),
        np.full((1, 3), 0.5 / DC, np.float32), np.zeros((1, 3, 0), np.float32),
    )  # fmt: skip


def some_cameras(count: int = 6) -> list[Camera]:
    """Around PLACE, which is in the picture but not in its middle."""
    random = np.random.default_rng(0)
    places = PLACE + 2.0 * random.standard_normal((count, 3)) * [1, 1, 0.4]
    return [looking_at(p, PLACE + random.uniform(-0.15, 0.15, 3), 160, 100, fov_deg=69.0) for p in places]


def test_all_descriptions_of_a_camera_agree() -> None:
    """A place appears at the same pixel by our camera, by cameras.json (camera to world), by COLMAP (world to camera)
    and in the picture itself."""
    cameras, splats = some_cameras(), one_white_dot()
    model = colmap_model(splats, cameras)
    entries: Any = cameras_json(model)
    for camera, entry, image, picture in zip(cameras, entries, model.images, pictures(splats, cameras, 1), strict=True):
        x, y, z = camera.world_from_camera.T @ (PLACE - camera.position)
        own = np.array([camera.focal * x / z + 80, camera.focal * y / z + 50])
        world_from_camera = np.eye(4)
        world_from_camera[:3, :3], world_from_camera[:3, 3] = entry["rotation"], entry["position"]
        a = np.linalg.inv(world_from_camera) @ [*PLACE, 1.0]
        sugar = np.array(
            [entry["fx"] * a[0] / a[2] + entry["width"] / 2, entry["fy"] * a[1] / a[2] + entry["height"] / 2]
        )
        b, pinhole = image.camera_from_world @ PLACE + image.translation, model.camera_of(image)
        colmap = np.array(pinhole.focal) * b[:2] / b[2] + pinhole.center
        assert sugar == pytest.approx(own, abs=1e-6)
        assert colmap == pytest.approx(own, abs=1e-6)
        light = picture.astype(float).sum(axis=2)
        rows, columns = np.mgrid[:100, :160] + 0.5
        drawn = np.array([(columns * light).sum(), (rows * light).sum()]) / light.sum()
        assert drawn == pytest.approx(own, abs=0.1)  # pixels of a dot add up to its middle
        assert entry["img_name"] + ".png" == image.name
    assert [image.name for image in model.images] == names(len(cameras))
    assert model.points == pytest.approx(PLACE[None], abs=1e-6)
    assert model.colors.tolist() == [[255, 255, 255]]


def test_pictures_of_splats_look_like_the_mesh_they_lie_on() -> None:
    """27 dB or more with splats of 2 cm in a room with stripes of 0.5 m. They differ at edges, which are blurred over
    about 2 OVERLAP 2 cm = 3 cm, 6 % of what is striped. A linear ramp there is off by (d / 2)^2 / 3 on the mean square
    from a step of d = 110 / 255: -10 log10(0.06 d^2 / 12) = 30 dB. Twice as many edges, with those of the box and the
    walls: 27 dB."""
    cube = moved(rounded_box((3.0, 3.0, 3.0), 0.02, 0.1), z=1.5)
    stripes = np.where(np.floor(cube.vertices[:, :1] / 0.5) % 2 == 0, 90, 200) * np.ones((1, 3))
    walls = Mesh(cube.vertices, np.ascontiguousarray(cube.faces[:, ::-1]), stripes.astype(np.uint8))
    mesh = joined([walls, moved(rounded_box((1.0, 0.8, 0.5), 0.02, 0.05), x=0.3, y=0.2, z=0.25)])
    splats = splats_on_mesh(mesh, 0.02, seed=0)
    cameras = [looking_at(np.array(p), np.array([0.3, 0.2, 0.5]), 160, 120, fov_deg=74.0)
               for p in ([-1.0, -1.0, 1.6], [1.1, -1.0, 2.0], [-0.9, 1.1, 0.9])]  # fmt: skip
    caster = Raycaster(mesh)
    likeness = [
        psnr(picture.astype(np.float32) / np.float32(255), unlit(mesh, camera, caster))
        for camera, picture in zip(cameras, pictures(splats, cameras, 2), strict=True)
    ]
    assert len(likeness) == 3
    assert min(likeness) > 27.0
    # another camera's picture is not this one's
    wrong = psnr(unlit(mesh, cameras[0], caster), unlit(mesh, cameras[2], caster))
    assert wrong < 20.0


def test_a_picture_without_light_has_the_colours_of_the_mesh() -> None:
    """Interpolated between corners, black where nothing is; the ratio of noise by its formula."""
    mesh = Mesh(
        np.array([[1.0, -1, -1], [1.0, 1, -1], [1.0, 1, 1], [1.0, -1, 1]]), np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.array([[0, 0, 0], [0, 0, 0], [255, 255, 255], [255, 255, 255]], np.uint8),
    )  # fmt: skip
    camera = looking_at(np.zeros(3), np.array([1.0, 0, 0]), 40, 40, fov_deg=2 * np.degrees(np.arctan(2.0)))
    image = unlit(mesh, camera)
    assert not image[:10].any()
    assert not image[:, :10].any()
    # row r of the 20 that show the square is at z = 1 - (r + 1/2) / 10: half of that plus a half in brightness
    assert image[10:30, 20, 0] == pytest.approx(1.0 - (np.arange(20) + 0.5) / 20, abs=1e-5)
    assert psnr(image, image) == np.inf
    assert psnr(np.zeros((2, 2, 3), np.float32), np.full((2, 2, 3), 0.1, np.float32)) == pytest.approx(20.0)
