"""How objects tilt onto what they come down on."""

import numpy as np
import pytest
from box_rooms import block

from dcap.scene.types.mesh import Mesh
from tasks.bodies.footprint import levelling, slope_below
from tasks.bodies.plan_contact import Heights

X, Y = np.linspace(-0.1, 0.1, 21), np.linspace(-0.05, 0.05, 11)


def grid(gap: np.ndarray) -> np.ndarray:
    """Gaps at the places X, Y."""
    return np.broadcast_to(gap, (len(X), len(Y))).copy()


def test_a_plane_has_its_own_slope() -> None:
    """Although its points span no volume."""
    gap = grid(0.02 + 0.1 * X[:, None] - 0.3 * Y[None, :])
    assert slope_below(X, Y, gap, np.array([0.013, -0.007])) == pytest.approx([0.1, -0.3], abs=1e-6)


def test_beside_all_that_carries_there_is_no_facet() -> None:
    """The centre of mass hangs over the edge."""
    gap = grid(np.where(X < 0.0, 0.01, np.nan)[:, None])
    assert slope_below(X, Y, gap, np.array([0.05, 0.0])) is None
    assert slope_below(X, Y, np.full((len(X), len(Y)), np.nan), np.zeros(2)) is None


@pytest.mark.parametrize("slope", [(0.2, 0.0), (0.0, -0.2), (0.1, 0.15)])
def test_a_board_over_a_slope_turns_flush_with_it(slope: tuple[float, float]) -> None:
    """Seen from the board: after the turn its underside is as far from the slope everywhere."""
    board = block((-0.2, -0.1, 0.1), (0.2, 0.1, 0.12))

    def heights_of(turned: Mesh) -> Heights:
        low = turned.vertices[board.vertices[:, 2] < 0.11]
        plane = np.linalg.lstsq(np.column_stack([low[:, :2], np.ones(len(low))]), low[:, 2], rcond=None)[0]
        return lambda plan: (plan @ plane[:2] + plane[2], plan @ np.array(slope))

    lying = board.transformed(levelling(board, np.array([0.0, 0.0, 0.11]), heights_of))
    low = lying.vertices[board.vertices[:, 2] < 0.11]
    assert np.ptp(low[:, 2] - low[:, :2] @ np.array(slope)) < 1e-3
