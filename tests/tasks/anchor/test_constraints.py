"""Excluded places and distances hold for where the object starts, and what cannot hold is refused."""

import numpy as np
import pytest
from box_rooms import CUBE, HALL, ROOM, Things, block, segmentation, thing
from stage_chain import Stages

from dcap.geometry.placement.named_regions import ViewerFrame, edge_at
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.segmentation import Segmentation

OFFLINE = Stages()
SLACK = 0.005
"""A distance holds to the grid of places, 3 mm apart [m]."""


def plan(prompt: str, room: Segmentation = ROOM) -> tuple[str, np.ndarray, np.ndarray]:
    """What carries the cube, and the lowest and highest corner of its plan."""
    _, _, found = OFFLINE.placed(prompt, CUBE, room)
    low, high = CUBE.mesh.transformed(found.world_from_object).bounds
    return found.part, low[:2], high[:2]


def gap(low: np.ndarray, high: np.ndarray, other: tuple[float, float, float, float]) -> float:
    """Distance of the plan from a rectangle x0, y0, x1, y1 [m]."""
    apart = np.maximum(np.maximum(np.array(other[:2]) - high, low - np.array(other[2:])), 0.0)
    return float(np.linalg.norm(apart))


PILLOWS = ((-0.65, 0.5, -0.05, 0.9), (0.05, 0.5, 0.65, 0.9))


@pytest.mark.parametrize(
    ("words", "axis", "edge", "metres"),
    [
        # who looks at the bed's front stands at -y: left is -x
        ("20 cm from the left edge", 0, -0.75, 0.2), ("30 cm from the right edge", 0, 0.75, 0.3),
        ("50cm from the front edge", 1, -0.95, 0.5),
    ],
)  # fmt: skip
def test_distances_from_edges_are_free_gaps(words: str, axis: int, edge: float, metres: float) -> None:
    """The object's near side is as far from the edge as was asked."""
    _, low, high = plan(f"put the cube on the bed, {words}")
    near = low[axis] - edge if edge < 0 else edge - high[axis]
    assert near == pytest.approx(metres, abs=SLACK)


@pytest.mark.parametrize(
    ("words", "axis", "half"),
    [
        ("a short edge", 0, 0.6), ("the shorter edge", 0, 0.6), ("an end", 0, 0.6), ("a long edge", 1, 0.4),
        ("the end nearest the bench", 0, 0.6), ("the long edge nearest the door", 1, 0.4),
        ("the end that is nearest the door", 0, 0.6), ("the long edge on the door side", 1, 0.4),
    ],
)  # fmt: skip
def test_edges_are_told_by_their_length(words: str, axis: int, half: float) -> None:
    """The table is 1.2 m along x and 0.8 m along y: its short edges lie at x, its long ones at y, whatever is near."""
    _, low, high = plan(f"put the cube on the table, 12 cm from {words}", HALL)
    assert min(half - high[axis], low[axis] + half) == pytest.approx(0.12, abs=SLACK)


def test_a_distance_from_the_middle_is_that_of_the_middles() -> None:
    """A free gap to a point that the object may cover says little."""
    _, low, high = plan("put the cube on the table, 20 cm from its centre", HALL)
    assert np.linalg.norm(0.5 * (low + high)) == pytest.approx(0.2, abs=SLACK)


def test_under_a_thing_is_below_it_or_nowhere() -> None:
    """The middle of the cube is below the table; the bench stands flat on the floor, and next to it is not under it."""
    _, low, high = plan("put the cube under the table", HALL)
    assert (np.abs(0.5 * (low + high)) <= (0.6, 0.4)).all()
    found = OFFLINE.tried("put the cube under the bench", CUBE, HALL)
    assert isinstance(found, Infeasible)


def test_below_what_hangs_on_a_wall_is_before_it() -> None:
    """No middle of a cube is right below a picture of 2 cm; the cube's plan meets that of the picture."""
    front = (0.0, -1.0, 0.0)
    bench = ("bench", front, [("seat", block((-0.5, 1.5, 0.0), (0.5, 2.0, 0.45)))])
    picture = ("picture", front, [("body", block((-0.2, 1.98, 1.0), (0.2, 2.0, 1.5)))])
    things: Things = {"bench": bench, "picture": picture}
    _, low, high = plan("put the cube on the bench below the picture", segmentation(things))
    assert high[1] >= 1.98 - 0.03 - SLACK
    assert abs(low[0] + high[0]) / 2 <= 0.2 + 0.03 + SLACK


@pytest.mark.parametrize(("words", "half", "told"), [("in", 0.2, True), ("on", 0.2, False), ("in", 0.1, False)])
def test_what_does_not_go_into_a_vessel_is_told(words: str, half: float, told: bool) -> None:
    """A box 40 cm wide lies on the rim of an open crate 30 cm wide, as "on the crate" may mean; one of 20 cm is in."""
    walls = [block((-0.15, -0.15, 0.0), (0.15, 0.15, 0.01))]
    walls += [block((x, -0.15, 0.01), (x + 0.01, 0.15, 0.3)) for x in (-0.15, 0.14)]
    walls += [block((-0.14, y, 0.01), (0.14, y + 0.01, 0.3)) for y in (-0.15, 0.14)]
    crate = segmentation({"crate": ("crate", None, [("body", Mesh.concatenate(walls))])})
    box = thing("box", block((-half, -half, 0.0), (half, half, 0.2)))
    _, _, found = OFFLINE.placed(f"put the box {words} the crate", box, crate)
    assert any("on the rim" in note for note in found.notes) == told


def test_a_sheet_carries_however_it_is_wound() -> None:
    """A table top of two triangles that face down is the top all the same; the boxes below it are the legs."""
    sheet = Mesh.of(
        np.array([(-0.6, -0.4, 0.7), (0.6, -0.4, 0.7), (0.6, 0.4, 0.7), (-0.6, 0.4, 0.7)]), [(0, 2, 1), (0, 3, 2)]
    )
    legs = [("leg", block((x, -0.05, 0.0), (x + 0.1, 0.05, 0.7))) for x in (-0.5, 0.4)]
    part, low, high = plan(
        "put the cube on the table", segmentation({"table": ("table", None, [("top", sheet), *legs])})
    )
    assert part == "top"
    np.testing.assert_allclose(0.5 * (low + high), 0.0, atol=0.05)


def test_nothing_rests_on_a_ceiling() -> None:
    """Its upper side is outside the room."""
    below: Things = {"floor": ("floor", None, [("floor", block((-2, -2, -0.1), (2, 2, 0.0)))]),
             "ceiling": ("ceiling", None, [("ceiling", block((-2, -2, 2.5), (2, 2, 2.6)))])}  # fmt: skip
    found = OFFLINE.tried("put the cube on the ceiling", CUBE, segmentation(below))
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.NO_SUPPORT_HIT
    assert "ceiling" in found.message


@pytest.mark.parametrize("words", ["nearest the lamp", "facing the lamp", "closest to the lamp"])
def test_the_edge_at_a_thing_is_one_of_them(words: str) -> None:
    """The lamp stands to the right of the bed, the wall behind it; "15 cm in from" is "from"."""
    _, _, high = plan(f"put the cube on the bed, 15cm in from the edge {words}")
    assert 0.75 - high[0] == pytest.approx(0.15, abs=SLACK)


def test_the_edge_at_a_thing_is_the_one_that_it_stands_at() -> None:
    """A lamp behind one end of a long desk is at the back edge, though the short edge's middle is nearer."""
    desk = ViewerFrame(np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, -1.0]), np.array([1.0, 0.3]))
    lamp = OrientedBox(np.array([-0.75, 0.45, 0.9]), np.eye(3), np.array([0.1, 0.1, 0.2]))
    outward = np.array(edge_at(desk, [lamp]), dtype=float)
    np.testing.assert_allclose(desk.world(outward) - desk.center, [0.0, 0.3], atol=1e-9)


def test_a_distance_reaches_as_far_as_it_says() -> None:
    """In front of a thing on the floor is a hand's reach, unless a distance is given."""
    _, low, high = plan("put the cube on the floor in front of the bench, 70 cm away from it", HALL)
    assert low[1] - -1.5 == pytest.approx(0.7, abs=SLACK)
    assert high[0] > -0.5
    assert low[0] < 0.5


def test_bounds_of_a_distance() -> None:
    """At least is no less, within is no more."""
    _, low, high = plan("put the cube on the bed, at least 60 cm from the pillows")
    assert min(gap(low, high, one) for one in PILLOWS) >= 0.6 - SLACK
    _, low, high = plan("put the cube on the bed within 5 cm of the headboard")
    assert 1.0 - high[1] <= 0.05 + SLACK


def test_farthest_is_at_the_other_end() -> None:
    """As far as possible from the pillows is a corner at the foot: no place of the bed is farther."""
    _, low, high = plan("put the cube on the bed, as far as possible from the pillows")
    best = gap(np.array([0.75 - 0.06, -0.95]), np.array([0.75, -0.95 + 0.06]), PILLOWS[1])
    assert min(gap(low, high, one) for one in PILLOWS) == pytest.approx(best, abs=0.06)


@pytest.mark.parametrize(
    "words", ["at the head of the bed, but not on the pillow", "on the bed near the headboard, not on a pillow"]
)
def test_excluded_parts_are_kept_free(words: str) -> None:
    """The cube lies on the mattress, over no pillow."""
    part, low, high = plan(f"put the cube {words}")
    assert part == "mattress"
    assert min(gap(low, high, one) for one in PILLOWS) > 0.0


@pytest.mark.parametrize(
    ("words", "side"), [("beside the table", None), ("near the table", None), ("in front of the bench", (1, -1.5))]
)
def test_beside_is_neither_over_nor_under(words: str, side: tuple[int, float] | None) -> None:
    """On the floor within a hand's reach, off the thing's plan, in front of it before its front."""
    bounds = (-0.6, -0.4, 0.6, 0.4) if "table" in words else (-0.5, -1.9, 0.5, -1.5)
    part, low, high = plan(f"put the cube {words}", HALL)
    assert part in ("floor", "body")
    assert -1e-9 < gap(low, high, bounds) <= 0.6
    assert not ((low < bounds[2:]) & (high > bounds[:2])).all()
    assert side is None or low[side[0]] >= side[1] - 1e-9


def test_at_the_foot_is_on_the_floor_and_on_the_foot_on_the_bed() -> None:
    """The bed ends at y = -1 where its viewer stands."""
    part, _, high = plan("put the cube at the foot of the bed")
    assert (part, bool(high[1] <= -1.0)) == ("floor", True)
    part, low, _ = plan("put the cube on the foot of the bed")
    assert (part, bool(low[1] >= -0.95 - 1e-6)) == ("mattress", True)


def test_what_cannot_hold_is_refused() -> None:
    """A table of 0.8 m has no place 70 cm from the lamp in its middle; the sentence's words say which."""
    found = OFFLINE.tried("put the cube on the table, 70 cm from the lamp", CUBE)
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.NO_SUPPORT_HIT
    assert "70 cm from the lamp" in found.message
