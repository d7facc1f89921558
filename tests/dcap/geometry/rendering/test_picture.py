"""Pictures: geometry of the camera, visibility, determinism, and that light falls as it should."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering import surface
from dcap.geometry.rendering.picture import picture
from dcap.scene.types.mesh import Mesh


def plate(size: float = 4.0, color: tuple[int, int, int] = (200, 200, 200)) -> Mesh:
    """A square on z = 0."""
    corner = 0.5 * size * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return Mesh.of(corner, [[0, 1, 2], [0, 2, 3]], color)


def ball(center: tuple[float, float, float], radius: float, color: tuple[int, int, int] = (200, 60, 40)) -> Mesh:
    """A sphere."""
    mesh = trimesh.creation.icosphere(3, radius)
    return Mesh.of(mesh.vertices + center, mesh.faces, color)


def small(
    position: tuple[float, float, float], target: tuple[float, float, float] = (0, 0, 0), size: int = 96
) -> Camera:
    """A camera for fast tests."""
    return looking_at(np.array(position, float), np.array(target, float), size, size)


@settings(max_examples=40, deadline=None)
@given(st.tuples(*[st.floats(-2, 2)] * 3), st.tuples(*[st.floats(-3, 3)] * 2), st.floats(0.5, 4))
def test_project_is_the_inverse_of_directions(
    target: tuple[float, ...], place: tuple[float, ...], height: float
) -> None:
    """A point along a pixel's ray projects back into that pixel, at the depth it was put."""
    camera = small((place[0], place[1], height), (target[0], target[1], target[2] - 3.0))
    pixel = np.array([[10.5, 80.5], [48.0, 48.0], [90.2, 3.7]])
    rays = camera.directions(pixel)
    depth = np.array([0.5, 2.0, 7.0])
    along = depth / (rays @ camera.world_from_camera[:, 2])
    found = camera.project(camera.position + along[:, None] * rays)
    assert np.allclose(found[:, :2], pixel, atol=1e-9)
    assert np.allclose(found[:, 2], depth, rtol=1e-6)


def test_depth_and_index_of_a_plate_with_a_ball() -> None:
    """Depth is measured along the axis: constant over a plate seen from above; the nearer mesh wins; background is
    inf, -1.
    """
    found = picture([plate(1.0), ball((0, 0, 0.2), 0.1)], small((0, 0, 2)), samples=1, shadows=False)
    center = found.mesh_index[48, 48]
    assert center == 1
    on_plate = found.mesh_index == 0
    assert np.allclose(found.depth[on_plate], 2.0, atol=1e-5)
    assert found.depth[48, 48] == pytest.approx(1.7, abs=2e-3)  # sagitta of the sphere's facets
    assert (found.mesh_index[0] == -1).all()
    assert np.isinf(found.depth[0]).all()
    # the plate of side 1 at distance 2 spans 1 / (2 * 2 tan(27.5 deg)) of the picture
    width = on_plate[30].sum()
    assert abs(width - 96 / (4 * np.tan(np.radians(27.5)))) <= 1


def test_same_input_same_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """No random numbers, no dependence on what was rendered before, and on any number of cores: 192 x 192 pixels are
    three bands, one core takes them in turn, three at once."""
    meshes, camera = [plate(), ball((0, 0, 0.3), 0.3)], small((1.5, -2, 1.5), size=192)
    assert 2 * surface.BAND < 192 * 192
    taken = []
    for cores in (1, 3):
        monkeypatch.setattr(surface, "available_cores", lambda cores=cores: cores)
        taken.append(picture(meshes, camera))
        picture([plate()], camera)
    assert taken[0].rgb.tobytes() == taken[1].rgb.tobytes()
    assert taken[0].depth.tobytes() == taken[1].depth.tobytes()


def test_a_ball_darkens_the_floor_beside_it_and_nothing_far_away() -> None:
    """The floor near a ball is darker than without it; two metres off the picture is the same within one grey level."""
    camera = small((0, -3, 2.5), size=128)
    alone, together = picture([plate(6.0)], camera).rgb, picture([plate(6.0), ball((0, 0, 0.3), 0.3)], camera)
    floor = together.mesh_index == 0
    points = camera.position + together.depth[..., None] * (
        camera.directions(camera.pixel_centers)
        / (camera.directions(camera.pixel_centers) @ camera.world_from_camera[:, 2])[:, None]
    ).reshape(128, 128, 3)
    away = np.linalg.norm(points[..., :2], axis=-1)
    change = together.rgb.astype(int).mean(axis=-1) - alone.astype(int).mean(axis=-1)
    assert change[floor & (away < 0.4)].min() < -25
    assert np.abs(change[floor & (away > 2.0)]).max() <= 1


def test_edges_are_smoothed_and_flats_are_not_touched() -> None:
    """Along a slanted edge there are shades between the two sides; without supersampling there are none."""
    sheet = plate(1.0, (40, 40, 40))
    camera = small((0.3, -0.2, 2))
    smooth = picture([sheet], camera, samples=3, shadows=False).rgb.astype(int).sum(axis=-1)
    plain = picture([sheet], camera, samples=1, shadows=False)
    hard, index = plain.rgb.astype(int).sum(axis=-1), plain.mesh_index
    dark, light = hard[index == 0].max(), hard[index < 0].min()
    assert not ((hard > dark + 30) & (hard < light - 30)).any()
    assert ((smooth > dark + 30) & (smooth < light - 30)).sum() > 60
