"""Rays pass where a texture is clear, in every pass alike, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from textured import plate, quarters

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering.painted import caster_of, own_paint
from dcap.geometry.rendering.picture import exposed
from dcap.scene.types.mesh import AlphaMode, Mesh, PaintedMesh, SourceSurface, SurfaceMaterial

MASK = SurfaceMaterial("leaf", AlphaMode.MASK, 0.5)
GREEN = (20, 200, 40)


def half_clear(said: SurfaceMaterial = MASK, alpha: int = 0, height: float = 0.5) -> SourceSurface:
    """A plate whose left half has this alpha."""
    surface = plate(height=height)
    image = np.dstack([quarters(), np.full((64, 64), 255, np.uint8)])
    image[:, :32, 3] = alpha
    paint = replace(surface.paint, textures=(image,), face_material=np.zeros(2, np.int32), materials=(said,))
    return replace(surface, paint=paint)


def look(surface: SourceSurface) -> PaintedMesh:
    return PaintedMesh(surface.mesh, own_paint(surface))


def ground() -> PaintedMesh:
    return PaintedMesh(Mesh.of(plate(3.0).mesh.vertices, plate().mesh.faces, GREEN))


def from_above(size: int = 64) -> Camera:
    return looking_at(np.array([0.0, 0.0, 4.0]), np.zeros(3), size, size, fov_deg=20.0, up=(0.0, 1.0, 0.0))


def test_colour_depth_and_ids_are_those_of_what_lies_behind():
    """Seen from above the whole picture shows the plate: its left half is clear, the ground is 0.5 m below."""
    camera = from_above()
    exposure = exposed([ground(), look(half_clear())], camera)
    index = exposure.surface.mesh_index.reshape(64, 64)
    assert (index[:, :32] == 0).all()
    assert (index[:, 32:] == 1).all()
    assert exposure.depth[:, :32] == pytest.approx(4.0, abs=1e-4)
    assert exposure.depth[:, 32:] == pytest.approx(3.5, abs=1e-4)
    shown = exposure.picture().rgb[:, :31].reshape(-1, 3).astype(float)
    assert (shown[:, 1] > 1.5 * shown[:, [0, 2]].max(axis=1)).all()


def test_light_passes_where_it_is_clear():
    """Rays from below straight up: those under the clear half are open, whatever their length."""
    caster = caster_of([look(half_clear())])
    x = np.linspace(-0.95, 0.95, 20)
    start = np.column_stack([x, np.full((20, 2), [0.1, 0.0])])
    up = np.tile([0.0, 0.0, 1.0], (20, 1))
    assert np.array_equal(caster.occluded(start, up, np.full(20, 1.0)), x > 0)
    assert not caster.occluded(start, up, np.full(20, 0.4)).any()
    hits = caster.cast(start, up)
    assert np.array_equal(hits.face >= 0, x > 0)


@pytest.mark.parametrize(
    ("said", "alpha", "clear"),
    [(MASK, 127, True), (MASK, 128, False), (replace(MASK, alpha_cutoff=0.25), 70, False),
     (replace(MASK, alpha=0.5), 200, True), (SurfaceMaterial("", AlphaMode.BLEND), 100, True),
     (SurfaceMaterial("", AlphaMode.BLEND), 140, False), (SurfaceMaterial("", AlphaMode.BLEND, alpha=0.2), 255, False),
     (SurfaceMaterial("", AlphaMode.OPAQUE), 0, False)],
)  # fmt: skip
def test_what_counts_as_clear(said, alpha, clear):
    caster = caster_of([look(half_clear(said, alpha))])
    found = caster.cast(np.array([[-0.5, 0.2, 2.0]]), np.array([[0.0, 0.0, -1.0]]))
    assert bool(found.face[0] < 0) == clear
