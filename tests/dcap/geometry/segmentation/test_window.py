"""Parts of windows: the ledge that one puts things on is the sill."""

import numpy as np

from dcap.geometry.primitives import Box
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.parts.rules import find_parts
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import joined, moved


def bar(size: tuple[float, float, float], center: tuple[float, float, float]) -> Mesh:
    """A closed box."""
    return moved(Box(np.array(size)).surface(0.1), *center)


def parts_of_window(*, with_sill: bool) -> dict[str, float]:
    """Name and top [m] of each part of a window of 1.2 x 1.2 m over z = 0.8 m, or of a bare pane."""
    bars = [
        bar((1.2, 0.06, 0.06), (0.0, 0.05, 0.85)),
        bar((1.2, 0.06, 0.06), (0.0, 0.05, 1.97)),
        bar((0.06, 0.06, 1.06), (-0.57, 0.05, 1.41)),
        bar((0.06, 0.06, 1.06), (0.57, 0.05, 1.41)),
    ]
    sill = [bar((1.3, 0.2, 0.03), (0.0, -0.02, 0.8))]
    mesh = joined(bars + sill if with_sill else [bar((1.2, 0.01, 1.2), (0.0, 0.05, 1.4))])
    table = FaceTable.of(mesh)
    parts = find_parts(table, np.arange(len(mesh.faces)), "window", np.eye(3), [])[1]
    return {part.name: float(part.box.corners[:, 2].max()) for part in parts}


def test_the_ledge_is_the_sill():
    found = parts_of_window(with_sill=True)
    assert set(found) == {"sill", "frame"}
    assert abs(found["sill"] - 0.815) < 0.02


def test_a_bare_pane_has_none():
    assert "sill" not in parts_of_window(with_sill=False)
