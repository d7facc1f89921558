"""The box about a shape, and the axis by which one tells whether it stands on end."""

import numpy as np
import pytest
from box_rooms import block
from scipy.spatial.transform import Rotation

from dcap.geometry.placement.resting_poses import end_axis, own_box
from dcap.scene.types.mesh import Mesh

TILTED = Rotation.from_euler("xyz", (20, 35, 50), degrees=True).as_matrix()


def slab(x: float, y: float, z: float) -> Mesh:
    """A block of that size, tilted as no file's axes are."""
    pose = np.eye(4)
    pose[:3, :3] = TILTED
    return block((0, 0, 0), (x, y, z)).transformed(pose)


@pytest.mark.parametrize("size", [(0.2, 0.14, 0.03), (0.03, 0.2, 0.14), (0.2, 0.02, 0.02), (0.2, 0.1, 0.0)])
def test_the_box_is_the_blocks_own(size):
    """However it lies in its file."""
    axes, found = own_box(slab(*size))
    assert found == pytest.approx(sorted(size, reverse=True), abs=1e-9)
    assert abs(axes[0] @ TILTED[:, int(np.argmax(size))]) == pytest.approx(1.0)
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-9)


@pytest.mark.parametrize(
    ("size", "on_edge", "expected"),
    [((0.2, 0.14, 0.03), False, (0, 0.0)), ((0.2, 0.14, 0.03), True, (2, 0.5 * np.pi)),
     ((0.4, 0.4, 0.02), False, (2, 0.5 * np.pi)), ((0.2, 0.02, 0.02), True, (0, 0.0))],
)  # fmt: skip
def test_long_things_stand_by_their_length_and_flat_ones_by_their_thickness(size, on_edge, expected):
    """A book both ways, a tray and a stick."""
    found = end_axis(slab(*size), on_edge=on_edge)
    assert found is not None
    assert abs(found[0] @ TILTED[:, expected[0]]) == pytest.approx(1.0)
    assert found[1] == expected[1]


def test_a_cube_has_no_end():
    """Nor has what is nearly one."""
    assert end_axis(slab(0.1, 0.09, 0.08), on_edge=False) is None
