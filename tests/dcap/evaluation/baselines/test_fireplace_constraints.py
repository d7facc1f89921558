"""Every formula of the FirePlace* library against its value in closed form."""

import numpy as np
import pytest

from dcap.evaluation.baselines.fireplace import problem as formulas

SQUARE = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])


@pytest.mark.parametrize(("angle_deg", "value"), [(0.0, 0.0), (60.0, 0.5), (90.0, 1.0), (180.0, 0.0)])
def test_parallel_is_one_less_the_cosine_either_way_round(angle_deg: float, value: float) -> None:
    """1 - |cos| of the angle between the normals."""
    angle = np.radians(angle_deg)
    own = np.array([[np.cos(angle), np.sin(angle), 0.0]])
    assert formulas.parallel(own, np.array([1.0, 0.0, 0.0]))[0] == pytest.approx(value, abs=1e-12)


def test_contact_is_the_distance_over_the_height() -> None:
    """|z| / h, above and below alike; a sheet's height counts as LEAST_HEIGHT."""
    assert formulas.contact(np.array([0.0, 0.1, -0.05]), 0.2).tolist() == pytest.approx([0.0, 0.5, 0.25])
    sheet = formulas.contact(np.array([0.01]), 0.001)
    assert sheet[0] == pytest.approx(0.01 / formulas.LEAST_HEIGHT)


def test_distances_are_met_up_to_the_metres_and_grow_in_units_of_them() -> None:
    """close_to is 0 up to d, far_from from d on; both are 1 at one further d, and at no distance at all."""
    distance = np.array([0.0, 0.1, 0.2, 0.4])
    assert formulas.close_to(distance, 0.2).tolist() == pytest.approx([0.0, 0.0, 0.0, 1.0])
    assert formulas.far_from(distance, 0.2).tolist() == pytest.approx([1.0, 0.5, 0.0, 0.0])


def test_in_front_is_ahead_of_the_side_and_centred_on_it() -> None:
    """0 on the side's axis, else the lateral offset over the width, and what lies behind beside it."""
    points = np.array([[0.0, 3.0], [0.5, 1.0], [0.0, -1.0]])
    found = formulas.in_front_of(points, np.zeros(2), np.array([0.0, 1.0]), 2.0)
    assert found.tolist() == pytest.approx([0.0, 0.25, 0.5])


def test_facing_is_one_less_the_cosine() -> None:
    """0 towards it, 1 across, 2 away from it."""
    normals = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]])
    found = formulas.facing(np.zeros((3, 2)), normals, np.tile([2.0, 0.0], (3, 1)))
    assert found.tolist() == pytest.approx([0.0, 1.0, 2.0])


@pytest.mark.parametrize("ring", [SQUARE, SQUARE[::-1]])
def test_distance_from_a_polygon_is_none_inside_and_euclidean_outside(ring: np.ndarray) -> None:
    """Whichever way round it is wound."""
    points = np.array([[1.0, 0.5], [3.0, 0.5], [3.0, 2.0], [1.0, -0.25]])
    found = formulas.distance_to_polygon(points, ring)
    assert found.tolist() == pytest.approx([0.0, 1.0, np.sqrt(2.0), 0.25])


def test_an_upright_side_seen_from_above_is_a_line() -> None:
    """A polygon without area has an outside only."""
    side = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (0.0, 0.0)])
    found = formulas.distance_to_polygon(np.array([[1.0, 0.0], [1.0, 0.5], [3.0, 0.0]]), side)
    assert found.tolist() == pytest.approx([0.0, 0.5, 1.0])


def test_the_nearest_point_of_a_rim_is_the_foot_on_it() -> None:
    """Straight across to an edge, or a corner."""
    found = formulas.nearest_on_polygon(np.array([[1.0, -1.0], [3.0, 3.0]]), SQUARE)
    assert found.tolist() == [[1.0, 0.0], [2.0, 1.0]]
