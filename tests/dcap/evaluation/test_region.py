"""Regions are polygons seen from above."""

import numpy as np
from box_rooms import ROOM
from hypothesis import given
from hypothesis import strategies as st

from dcap.evaluation.metrics.right_place import TOLERANCE_M, part_missed, region_missed

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
L_SHAPE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])


@given(st.floats(-1, 2), st.floats(-1, 2))
def test_square(x: float, y: float) -> None:
    """A point misses the unit square exactly if its distance to it exceeds the tolerance."""
    distance = float(np.hypot(max(-x, x - 1, 0.0), max(-y, y - 1, 0.0)))
    if abs(distance - TOLERANCE_M) > 1e-9:
        assert region_missed(np.array([x, y]), SQUARE) == (distance > TOLERANCE_M)


def test_concave() -> None:
    """The notch of an L is outside, its arms are inside."""
    assert region_missed(np.array([1.5, 1.5]), L_SHAPE)
    assert not region_missed(np.array([1.5, 0.5]), L_SHAPE)
    assert not region_missed(np.array([0.5, 1.5]), L_SHAPE)


def test_no_region() -> None:
    """Nothing asked, nothing missed."""
    assert not region_missed(np.zeros(2), np.zeros((0, 2)))


def test_what_rests_beside_the_part_asked_for_misses_it() -> None:
    """A contact sunk 8 cm into the mattress is on it; moved by half, or lying on a pillow, it is not; a dent's depth
    does not matter, as the first surface below the object's top is what gave way."""
    on_it = np.array([[x, -0.5, 0.42] for x in (-0.1, 0.0, 0.1)])
    assert not part_missed(ROOM, "bed", "mattress", on_it, top=0.6)
    assert part_missed(ROOM, "bed", "mattress", on_it + np.array([0.0, 1.2, 0.2]), top=0.9)
    assert not part_missed(ROOM, "bed", "pillow", on_it + np.array([-0.35, 1.2, 0.2]), top=0.9)
    assert part_missed(ROOM, "bed", "mattress", on_it + np.array([5.0, 0.0, 0.0]), top=0.6)
    assert not part_missed(ROOM, "bed", "mattress", np.zeros((0, 3)), top=0.6)
    assert part_missed(ROOM, "table", "top", on_it, top=0.6)
