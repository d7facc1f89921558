"""Patches of a fused scan: tops at two heights that a ramp joins are two, one slope and one rough top are one."""

import numpy as np
import pytest

from dcap.arrays import Array
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.rooms.contacts import surfels_of
from dcap.geometry.segmentation.rooms.pieces import carrying_pieces
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import columns, line, sheet


def terrain(height: Array) -> Mesh:
    """A sheet of 1.6 x 0.6 m whose height runs along x as given."""
    xs = np.linspace(0.0, 1.6, 81)
    made = sheet(line(0, 1.6, 0.02), line(0, 0.6, 0.02), lambda u, v: columns(u, v, np.interp(u, xs, height)))
    return made if made.face_normals[:, 2].sum() > 0 else Mesh.of(made.vertices, made.faces[:, ::-1])


def levels_of(mesh: Mesh) -> list[float]:
    """Heights of the patches [m]."""
    table = FaceTable.of(mesh)
    pieces = carrying_pieces(surfels_of(table, np.arange(len(mesh.faces))), 0.0)
    return sorted(round(float(one), 2) for one in pieces.level)


def test_a_ramp_between_two_tops_parts_them() -> None:
    x = np.linspace(0.0, 1.6, 81)
    tops = 0.6 + 0.2 * np.clip((x - 0.6) / 0.5, 0.0, 1.0)
    assert levels_of(terrain(tops)) == pytest.approx([0.6, 0.8], abs=0.05)


def test_a_slope_stays_one() -> None:
    assert len(levels_of(terrain(0.5 + 0.3 * np.linspace(0.0, 1.0, 81)))) == 1


def test_a_rough_top_stays_one() -> None:
    rough = 0.5 + 0.04 * np.sin(np.linspace(0.0, 20.0, 81))
    assert len(levels_of(terrain(rough))) == 1
