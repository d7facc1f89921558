"""Textures where rays meet them: the right texel, on cut and moved faces too, smooth from afar."""

import numpy as np
import pytest
from textured import QUARTERS, plate, quarters

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering.painted import (
    own_paint,
    painted,
)
from dcap.geometry.rendering.picture import picture
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.srgb import linear_from_srgb, sampled
from dcap.scene.types.mesh import PaintedMesh

EVERYWHERE = np.array([[-9.0] * 3, [9.0] * 3])


def from_above(size: int = 80, height: float = 4.0) -> Camera:
    return looking_at(np.array([0.0, 0.0, height]), np.zeros(3), size, size, fov_deg=40.0, up=(0.0, 1.0, 0.0))


def hue(color: np.ndarray) -> int:
    """Which of the four colours a shaded one is most like."""
    known = np.array(QUARTERS) / np.linalg.norm(QUARTERS, axis=1, keepdims=True)
    return int(np.argmax(known @ (color / np.linalg.norm(color))))


def at(rgb: np.ndarray, camera: Camera, x: float, y: float) -> np.ndarray:
    column, row, _ = camera.project(np.array([[x, y, 0.0]]))[0]
    return rgb[int(row), int(column)].astype(float)


def test_each_quarter_of_a_plate_has_its_colour():
    surface, camera = plate(), from_above()
    rgb = picture([PaintedMesh(surface.mesh, own_paint(surface))], camera).rgb
    for number, (x, y) in enumerate([(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)]):
        assert hue(at(rgb, camera, x, y)) == number


@pytest.mark.parametrize(("wrap", "expected"), [("repeat", 0), ("mirror", 1), ("clamp", 1)])
def test_beyond_its_image_a_texture_repeats_is_mirrored_or_ends(wrap, expected):
    """A quarter of an image to the right of it: the left quarter again, the right one turned round, or its rim."""
    image = quarters()
    found = sampled(image, np.array([[1.25, 0.25]]), (wrap, "repeat"))
    assert found[0] == pytest.approx(linear_from_srgb(np.array(QUARTERS[expected])), abs=1e-6)
    upward = sampled(image, np.array([[0.25, -0.25]]), ("repeat", wrap))
    below = {"repeat": 2, "mirror": 0, "clamp": 0}[wrap]
    assert upward[0] == pytest.approx(linear_from_srgb(np.array(QUARTERS[below])), abs=1e-6)


def test_a_mesh_cut_from_the_surface_has_its_texture_coordinates():
    surface = plate()
    fine = subdivide_near(surface.mesh, EVERYWHERE, 0.11)
    assert len(fine.faces) > 100
    paint = painted(fine, surface).paint
    assert paint is not None
    assert (paint.texture == 0).all()
    expected = fine.vertices[fine.faces][..., :2] / 2 + 0.5
    assert np.abs(paint.corner_uv - expected).max() < 1e-6


def test_a_fine_pattern_from_afar_is_its_mean_and_does_not_flicker():
    """Ten thousand squares in eighty pixels: all of one even grey, as far as the light is even."""
    surface = plate(repeat=100.0)
    rgb = picture([PaintedMesh(surface.mesh, own_paint(surface))], from_above(), shadows=False).rgb
    inner = rgb[25:55, 25:55].reshape(-1, 3).astype(float)
    assert inner.std(axis=0).max() < 4.0
