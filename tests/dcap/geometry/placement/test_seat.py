"""Whether a figure sits is told by what is under its centre of mass and by how low that is."""

import numpy as np
import pytest
from box_rooms import block, toy

from dcap.geometry.placement.resting_poses import sits
from dcap.scene.types.mesh import Mesh

UP = np.array([0.0, 0.0, 1.0])
LEGS = [block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.16)) for x in (-0.05, 0.05) for y in (-0.12, 0.12)]
ON_FOURS = Mesh.concatenate([block((-0.08, -0.16, 0.14), (0.08, 0.16, 0.28)), *LEGS])
ON_TWO = Mesh.concatenate(
    [block((-0.08, -0.05, 0.2), (0.08, 0.05, 0.4)), block((-0.06, -0.04, 0.0), (0.06, 0.04, 0.2))]
)
BEGGING = Mesh.concatenate([block((-0.1, -0.1, 0.0), (0.1, 0.1, 0.12)), block((-0.05, -0.05, 0.12), (0.05, 0.05, 0.3))])


@pytest.mark.parametrize(
    ("mesh", "seated"), [(toy(), True), (BEGGING, True), (ON_FOURS, False), (ON_TWO, False)],
)  # fmt: skip
@pytest.mark.parametrize("turn", [np.eye(3), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])])
def test_what_bears_on_its_body_sits(mesh, seated, turn):
    """Legs before it, or a broad seat; not on four legs with 0.14 of air under a centre at about 0.2, nor on two closed
    legs, where the centre is at 0.22 of 0.4 and over. The file's axes do not matter."""
    pose = np.eye(4)
    pose[:3, :3] = turn
    assert sits(mesh.transformed(pose), turn @ UP) == seated


def test_a_hollow_seat_is_a_seat():
    """A seam or a recess of a tenth of the height under the middle is passed by."""
    recessed = Mesh.concatenate(
        [block((-0.1, -0.1, 0.03), (0.1, 0.1, 0.12)), block((-0.1, -0.1, 0.0), (-0.06, 0.1, 0.05)),
         block((0.06, -0.1, 0.0), (0.1, 0.1, 0.05)), block((-0.05, -0.05, 0.12), (0.05, 0.05, 0.3))]
    )  # fmt: skip
    assert sits(recessed, UP)
