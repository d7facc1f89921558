"""Parts of furniture: the seat of an armchair is what is free between arms and back, the ledge of a window the sill."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.primitives import Box
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.parts.instance_surface import InstanceSurface, instance_surface
from dcap.geometry.segmentation.parts.rules import find_parts
from dcap.geometry.segmentation.parts.seating import sofa_parts
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import joined, moved

LEVEL, FREE = 0.42, 0.6 * 0.6
"""Height of the sitting surface [m] and its area between arms and back [m^2]."""
Corner = tuple[float, float, float]


def block(low: Corner, high: Corner) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    return moved(Box(b - a).surface(0.02), *(0.5 * (a + b)))


def armchair(*more: Mesh) -> tuple[InstanceSurface, NDArray[np.object_]]:
    """0.9 x 0.8 x 0.85 m, its back at +y, and the names of its faces."""
    base = block((-0.45, -0.4, 0.0), (0.45, 0.4, LEVEL))
    arms = [block((x, -0.4, LEVEL), (x + 0.15, 0.4, 0.66)) for x in (-0.45, 0.3)]
    table = FaceTable.of(joined([base, *arms, block((-0.3, 0.2, LEVEL), (0.3, 0.4, 0.85)), *more]))
    box = OrientedBox(np.array([0.0, 0.0, 0.425]), np.eye(3), np.array([0.45, 0.4, 0.425]))
    surface = instance_surface(table, np.arange(len(table.area)), box)
    return surface, sofa_parts(surface).names


def seat_area(surface: InstanceSurface, names: NDArray[np.object_]) -> float:
    """Of the seat cushion's upward faces [m^2]."""
    return float(surface.area[(names == "seat cushion") & surface.open_up].sum())


def test_a_crumb_at_the_height_of_the_seat_is_not_the_seat() -> None:
    """0.25 x 0.15 m of the seat are a piece of their own: all that is free is the seat."""
    surface, names = armchair(block((0.0, 0.0, LEVEL - 0.03), (0.25, 0.15, LEVEL + 0.002)))
    assert abs(seat_area(surface, names) - FREE) < 0.15 * FREE  # faces of 0.02 m on its four edges, and their cells


def test_a_cushion_that_is_most_of_the_seat_is_the_seat_alone() -> None:
    """0.55 x 0.55 m on the base: nothing of the base is called so."""
    surface, names = armchair(block((-0.275, -0.37, LEVEL), (0.275, 0.18, LEVEL + 0.1)))
    named = names == "seat cushion"
    assert abs(seat_area(surface, names) - 0.55**2) < 0.1 * 0.55**2
    assert surface.center[named, 2].min() > LEVEL - 0.01


def test_both_wings_of_a_corner_sofa_have_a_back() -> None:
    """What stands up beside the seat, 0.2 m over it, is back or arm, and never what the seat stands on."""
    shape = joined([
        block((-1.2, -0.4, 0.0), (1.2, 0.5, LEVEL)), block((-1.2, -1.3, 0.0), (-0.4, -0.4, LEVEL)),
        block((-1.2, 0.3, LEVEL), (1.2, 0.5, 0.85)), block((-1.2, -1.3, LEVEL), (-1.0, 0.3, 0.85)),
    ])  # fmt: skip
    table = FaceTable.of(shape)
    box = OrientedBox(np.array([0.0, -0.4, 0.425]), np.eye(3), np.array([1.2, 0.9, 0.425]))
    surface = instance_surface(table, np.arange(len(table.area)), box)
    names = sofa_parts(surface.with_pieces(np.zeros(len(table.area), dtype=np.int64))).names
    assert set(names[surface.center[:, 2] > LEVEL + 0.1]) <= {"back", "arm"}


def slab(size: Corner, center: Corner) -> Mesh:
    """A closed box."""
    return moved(Box(np.array(size)).surface(0.1), *center)


def parts_of_window(*, with_sill: bool) -> dict[str, float]:
    """Name and top [m] of each part of a window of 1.2 x 1.2 m over z = 0.8 m, or of a bare pane."""
    bars = [
        slab((1.2, 0.06, 0.06), (0.0, 0.05, 0.85)),
        slab((1.2, 0.06, 0.06), (0.0, 0.05, 1.97)),
        slab((0.06, 0.06, 1.06), (-0.57, 0.05, 1.41)),
        slab((0.06, 0.06, 1.06), (0.57, 0.05, 1.41)),
    ]
    sill = [slab((1.3, 0.2, 0.03), (0.0, -0.02, 0.8))]
    mesh = joined(bars + sill if with_sill else [slab((1.2, 0.01, 1.2), (0.0, 0.05, 1.4))])
    table = FaceTable.of(mesh)
    parts = find_parts(table, np.arange(len(mesh.faces)), "window", np.eye(3), [])[1]
    return {part.name: float(part.box.corners[:, 2].max()) for part in parts}


def test_the_ledge_is_the_sill():
    found = parts_of_window(with_sill=True)
    assert set(found) == {"sill", "frame"}
    assert abs(found["sill"] - 0.815) < 0.02


def test_a_bare_pane_has_none():
    assert "sill" not in parts_of_window(with_sill=False)
