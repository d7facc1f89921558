"""The predicted contact of an object with what lies beneath it."""

import numpy as np
import pytest
from box_rooms import ball, block

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from tasks.bodies.footprint import predicted_footprint


def test_an_object_on_a_slope_may_touch_with_all_of_its_underside() -> None:
    """A board that slopes by 2 mm over its length touches with an edge first; `wider` holds all of it."""
    board = block((-0.2, -0.05, 0.0), (0.2, 0.05, 0.02))
    slope = Mesh.of(
        board.vertices + np.array([0, 0, 0.01]) + 0.005 * board.vertices[:, :1] * np.array([0, 0, 1]), board.faces
    )
    floor = block((-1.0, -1.0, -0.1), (1.0, 1.0, 0.0))
    foot = predicted_footprint(slope, Raycaster(floor), 5.0, 1e-5, 0.0)
    assert foot.high[0] - foot.low[0] < 0.3
    assert foot.wider[:, 0] == pytest.approx([-0.2, 0.2], abs=0.4 / 40)


@pytest.mark.parametrize(
    ("item", "flat"),
    [
        (ball(0.1), False),
        (block((-0.1, -0.1, 0.0), (0.1, 0.1, 0.2)), True),
        (block((-0.1,) * 3, (0.1,) * 3), True),
    ],
)
def test_a_ball_that_sinks_deep_is_round_still(item: Mesh, flat: bool) -> None:
    """Pressed in by a third of its radius it shows no more of itself below its equator; a cube's face is flat at any
    depth."""
    ground = Raycaster(block((-1.0, -1.0, -1.2), (1.0, 1.0, -0.2)))
    for weight in (2.0, 30.0, 70.0):
        foot = predicted_footprint(item, ground, weight, 1.0 / 1.2e4, -0.2)
        assert foot.flat is flat
    assert flat or foot.depth > 0.03
