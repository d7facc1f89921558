"""Textures of the page: what a surface shows of them stays as it was, and all together are within the budget."""

from dataclasses import replace

import numpy as np
import pytest
from textured import plate, quarters

from dcap.geometry.rendering.painted import own_paint, surface_colors
from dcap.scene.srgb import CLAMP, MIRROR, REPEAT
from dcap.scene.types.mesh import CornerPaint, MaterialMap, PaintedMesh, SurfaceMaterial
from flows.view import looks
from flows.view.looks import fitted, largest_share, trimmed


def painted_plate(low: float, high: float, wrap: str) -> PaintedMesh:
    """A plate whose texture coordinates run from `low` to `high` along both axes."""
    surface = plate()
    paint = own_paint(surface)
    uv = (low + (high - low) * paint.corner_uv).astype(np.float32)
    return PaintedMesh(surface.mesh, replace(paint, corner_uv=uv, wraps=((wrap, wrap),)))


def shown(thing: PaintedMesh) -> np.ndarray:
    """Colours at places all over the two faces."""
    share = np.random.default_rng(0).dirichlet(np.ones(3), 200)
    return surface_colors(thing, np.arange(200) % 2, share)


@pytest.mark.parametrize("wrap", [REPEAT, MIRROR, CLAMP])
@pytest.mark.parametrize(("low", "high"), [(0.1, 0.4), (0.8, 1.3), (-3.2, -2.9), (1.9, 2.2), (-0.5, 2.5)])
def test_a_cut_texture_shows_the_same(wrap: str, low: float, high: float) -> None:
    """Within 0..1, over its border, far beyond it, and over more than one round, however it goes on there."""
    before = painted_plate(low, high, wrap)
    assert before.paint is not None
    after = trimmed(before.paint)
    assert shown(PaintedMesh(before.mesh, after)) == pytest.approx(shown(before), abs=1.5 / 255)  # steps of a byte
    if high - low < 0.5:
        assert after.textures[0].shape[0] <= (high - low) * 64 + 4
    else:
        assert after.textures[0].shape[0] <= 64


def test_textures_that_no_face_has_are_left_alone() -> None:
    """Indices stay; what is not used is not cut."""
    paint = own_paint(plate())
    two = replace(paint, textures=(quarters(8), *paint.textures), texture=paint.texture + 1, wraps=())
    assert [one.shape[0] for one in trimmed(two).textures] == [8, 64]


def test_the_largest_give_way_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 1, 2 and 9 with room for 7 the last keeps 4; with room for all, all."""
    assert largest_share(np.array([9.0, 1.0, 2.0]), 20.0) == float("inf")
    monkeypatch.setattr(looks, "LEAST", 0)
    assert largest_share(np.array([9.0, 1.0, 2.0]), 7.0) == 4.0


def test_all_images_are_within_the_budget() -> None:
    """Four copies of two images of 64 x 64 with room for 8192 pixels: 1024 each; the small one stays."""
    paint = own_paint(plate())
    small = replace(paint, textures=(quarters(8),))
    found = fitted([paint, None, paint, small], 4, 4 * (2 * 1024 + 64))
    sides = [None if one is None else one.textures[0].shape[0] for one in found.paints]
    assert sides == [32, None, 32, 8]
    assert (found.reduced, found.largest) == (2, 32)


def test_no_side_is_longer_than_the_page_takes(monkeypatch: pytest.MonkeyPatch) -> None:
    """A long image is scaled by its longer side."""
    monkeypatch.setattr(looks, "LARGEST_SIDE", 32)
    paint = replace(own_paint(plate()), textures=(quarters(64)[:, :16].copy(),))
    found = fitted([paint], 1, 10**6).paints[0]
    assert isinstance(found, CornerPaint)
    assert found.textures[0].shape == (32, 8, 3)


def test_further_maps_are_left_out() -> None:
    """A map is in the coordinates of the whole texture, of which the page has a part."""
    used = MaterialMap(0)
    said = SurfaceMaterial(normal_map=used, emissive_map=used, emission=(1.0, 1.0, 1.0), roughness=0.3)
    paint = replace(own_paint(plate()), materials=(said,))
    assert trimmed(paint).materials == (SurfaceMaterial(roughness=0.3),)
