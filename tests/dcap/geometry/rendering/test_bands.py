"""Bands: every pixel once, and the same bytes on any number of cores."""

import numpy as np
import pytest
import trimesh

from dcap.geometry.camera import looking_at
from dcap.geometry.rendering import surface
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import in_bands
from dcap.scene.types.mesh import Mesh


@pytest.mark.parametrize("cores", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 7, 8, 9, 64])
def test_each_is_worked_on_once(monkeypatch, cores, count):
    """The bands of a range cover it without overlap, whoever works on them."""
    monkeypatch.setattr(surface, "available_cores", lambda: cores)
    visits = np.zeros(count, dtype=int)

    def visit(band: slice) -> None:
        visits[band] += 1

    in_bands(visit, count, band=8)
    assert (visits == 1).all()


def test_what_a_band_raises_is_raised(monkeypatch):
    """An error in one band is not lost in its thread."""
    monkeypatch.setattr(surface, "available_cores", lambda: 2)

    def fail(band: slice) -> None:
        if band.start == 8:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        in_bands(fail, 32, band=8)


def test_a_picture_has_the_same_bytes_on_any_number_of_cores(monkeypatch):
    """192 x 192 pixels are three bands: one core takes them in turn, three at once."""
    ball = trimesh.creation.icosphere(3, 0.4)
    corner = [[-3, -3, -0.4], [3, -3, -0.4], [3, 3, -0.4], [-3, 3, -0.4]]
    meshes = [Mesh.of(corner, [[0, 1, 2], [0, 2, 3]]), Mesh.of(ball.vertices, ball.faces, (200, 60, 40))]
    camera = looking_at(np.array([1.5, -2.0, 1.0]), np.zeros(3), 192, 192)
    assert 2 * surface.BAND < 192 * 192
    taken = []
    for cores in (1, 3):
        monkeypatch.setattr(surface, "available_cores", lambda cores=cores: cores)
        taken.append(picture(meshes, camera))
    assert taken[0].rgb.tobytes() == taken[1].rgb.tobytes()
    assert taken[0].depth.tobytes() == taken[1].depth.tobytes()
