"""Right place in raw units: hits, distances and angles with known answers; what nobody stated is left open."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.evaluation.metrics.right_place import PlaceMeasures, place_measures
from dcap.evaluation.outcome_table import ExpectedOutcome

TRUTH = ExpectedOutcome(base="bed", part="mattress", region="", feasible=True, reason="")
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def measured(truth: ExpectedOutcome, turn: Rotation | None = None, **options: object) -> PlaceMeasures:
    support = options.get("support", ("7", "bed", "mattress"))
    middle = np.array(options.get("middle", (0.5, 0.5, 0.4)))
    quaternion = (turn or Rotation.identity()).as_quat(scalar_first=True)
    return place_measures(support, middle, quaternion, truth, options.get("regions", ()))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("support", "hits"),
    [
        (("7", "bed", "mattress"), (True, True)),
        (("7", "bed", "frame"), (True, False)),
        (("9", "floor", "body"), (False, False)),
        (("", "", ""), (False, False)),
    ],
)
def test_hits(support: tuple[str, str, str], hits: tuple[bool, bool]) -> None:
    found = measured(TRUTH, support=support)
    assert (found.support_hit, found.part_hit) == hits


def test_an_id_tells_one_of_several_apart() -> None:
    assert measured(replace(TRUTH, base_id="8")).support_hit is False
    assert measured(replace(TRUTH, base_id="7")).support_hit is True


def test_what_nobody_stated_is_left_open() -> None:
    found = measured(ExpectedOutcome(base="", part="", region="", feasible=True, reason=""))
    assert found == PlaceMeasures()


@pytest.mark.parametrize(("middle", "distance"), [((0.5, 0.5, 0.0), 0.0), ((1.3, 0.5, 2.0), 0.3), ((-3, -4, 0), 5.0)])
def test_the_distance_to_a_region_is_in_plan(middle: tuple[float, ...], distance: float) -> None:
    found = measured(TRUTH, middle=middle, regions=(SQUARE + 100.0, SQUARE))
    assert found.region_distance_m == pytest.approx(distance)


@pytest.mark.parametrize(("top", "tilt", "error"), [
    ("up", 0, 0), ("up", 30, 30), ("up", 180, 180), ("down", 180, 0), ("sideways", 90, 0), ("sideways", 60, 30),
])  # fmt: skip
def test_the_angle_of_the_top(top: Literal["up", "down", "sideways"], tilt: float, error: float) -> None:
    found = measured(replace(TRUTH, top=top), Rotation.from_euler("x", tilt, degrees=True))
    assert found.orientation_error_deg == pytest.approx(error, abs=1e-6)


def test_the_angle_of_the_front_and_the_larger_of_both() -> None:
    """The front is +y as read; turned by 50 degrees about z it is 50 degrees off +y, 40 off -x."""
    turn = Rotation.from_euler("z", 50, degrees=True)
    assert measured(replace(TRUTH, front=(0.0, 1.0)), turn).orientation_error_deg == pytest.approx(50.0)
    assert measured(replace(TRUTH, front=(-2.0, 0.0), top="down"), turn).orientation_error_deg == pytest.approx(180.0)
