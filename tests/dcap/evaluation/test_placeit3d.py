"""PlaceIt3D's rules: each on both sides of its printed threshold, on boxes whose overlaps are known in closed form."""

import numpy as np
import pytest

from dcap.evaluation.metrics.placeit3d import (
    AskedConstraint,
    ConstraintKind,
    FinalBox,
    asked_constraints,
    between,
    box_distance,
    facing,
    interval_iom,
    met,
    on,
    physical,
    plan_iom,
    room_size,
    upright_box,
)
from dcap.evaluation.metrics.touching import TOUCHING
from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.segmentation import Instance, Part

EPS = 1e-4
"""How far beside a threshold [m or -]; rounding is 1e-9."""
ROOM = 5.0


def box(low, high) -> OrientedBox:
    """Along the world's axes."""
    return upright_box(np.array([low, high], dtype=float))


def turned(middle, half, degrees) -> OrientedBox:
    """A box turned about the vertical."""
    a = np.radians(degrees)
    axes = np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]])
    return OrientedBox(np.array(middle, dtype=float), axes, np.array(half, dtype=float))


CUBE = box([0, 0, 0], [1, 1, 1])


def final(where: OrientedBox, front=(0.0, 1.0), support="a", dz=0.0) -> FinalBox:
    return FinalBox(where, np.array(front), support, dz)


def holds(kind: ConstraintKind, one: FinalBox, room: float = ROOM, **boxes: OrientedBox) -> bool:
    return met(AskedConstraint(kind, tuple(boxes)), one, boxes, room)


def test_distances_are_those_of_boxes():
    """Inside; across a corner and up, where 3, 4, 12 gives 13; a corner of a square turned by 45 degrees reaches out by
    half its diagonal."""
    assert box_distance(CUBE, box([0.2, 0.2, 0.2], [0.4, 0.4, 3.0])) == 0.0
    assert box_distance(CUBE, box([4, 5, 13], [5, 6, 14])) == pytest.approx(13.0)
    assert box_distance(CUBE, turned([3, 0.5, 0.5], [0.5, 0.5, 0.5], 45)) == pytest.approx(2.0 - np.sqrt(0.5))


def test_iom_is_over_the_smaller():
    """A quarter of a small box on a large one; of a large one turned by 45 degrees the middle holds the small one."""
    assert plan_iom(box([-1, -1, 5], [1, 1, 6]), box([0, 0, 0], [9, 9, 1])) == pytest.approx(0.25)
    assert plan_iom(turned([0, 0, 0], [2, 2, 1], 45), box([-1, -1, 0], [1, 1, 1])) == pytest.approx(1.0)
    assert plan_iom(CUBE, box([0, 0, 0], [0, 1, 1])) == 0.0
    assert interval_iom((0.0, 10.0), (9.0, 11.0)) == pytest.approx(0.5)
    assert interval_iom((0.0, 1.0), (2.0, 3.0)) == 0.0


def test_near_is_a_hundredth_of_the_room_and_adjacent_three_centimetres():
    """A room of 3 m by 4 m has the size 5 m: 5 cm. Any of several references will do, an unknown one never."""
    assert room_size(np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 2.5]])) == pytest.approx(ROOM)
    for kind, reach in ((ConstraintKind.NEAR, 0.05), (ConstraintKind.ADJACENT, 0.03)):
        for gap, yes in ((reach, True), (reach - EPS, True), (reach + EPS, False)):
            beside = final(box([1 + gap, 0, 0], [2 + gap, 1, 1]))
            assert holds(kind, beside, a=CUBE) is yes
            assert holds(kind, beside, b=box([9, 9, 9], [10, 10, 10]), a=CUBE) is yes
        assert not met(AskedConstraint(kind, ("gone",)), final(CUBE), {"a": CUBE}, ROOM)
    assert holds(ConstraintKind.NEAR, final(box([1.09, 0, 0], [2, 1, 1])), 10.0, a=CUBE)


@pytest.mark.parametrize(("over", "dz", "yes"), [(0.5, 0.0, True), (0.5 - EPS, 0.0, False), (1.0, 0.01, True),
                                                  (1.0, 0.01 + EPS, False)])  # fmt: skip
def test_on_is_half_over_and_a_centimetre(over, dz, yes):
    """The box's top plays no part: a headboard reaches a metre over the mattress."""
    thing, bed = box([1 - over, 0, 0.5], [2 - over, 1, 0.7]), box([0, 0, 0], [1, 1, 1.5])
    assert on(thing, bed, dz) is yes
    assert holds(ConstraintKind.ON, final(thing, dz=dz), a=bed) is yes
    assert not holds(ConstraintKind.ON, final(thing, support="floor", dz=dz), a=bed)


def test_what_lies_under_a_table_is_not_on_it():
    """It is over the table's box in plan and touches the floor: the floor carries it."""
    table, floor, thing = (
        box([0, 0, 0], [1, 1, 0.7]),
        box([-2, -2, -0.1], [2, 2, 0]),
        box([0.4, 0.4, 0], [0.6, 0.6, 0.2]),
    )
    under = final(thing, support="floor")
    boxes = {"table": table, "floor": floor}
    assert not met(AskedConstraint(ConstraintKind.ON, ("table",)), under, boxes, ROOM)
    assert met(AskedConstraint(ConstraintKind.ON, ("table", "floor")), under, boxes, ROOM)


LEFT = box([-1.0, 0, 0], [0, 1, 1])


def gapped(apart: float) -> OrientedBox:
    """The other anchor, that far from the left one."""
    return box([apart, 0, 0], [apart + 1, 1, 1])


@pytest.mark.parametrize(
    ("thing", "apart", "yes"),
    [
        (box([0.2, 0, 0], [0.8, 1, 1]), 1.0, True),
        (box([0.2, 0.5, 0], [0.8, 1.5, 1]), 1.0, True),  # half of it beside the spanned box
        (box([0.2, 0.5 + EPS, 0], [0.8, 1.5 + EPS, 1]), 1.0, False),
        (box([0.2, 0, 0.5], [0.8, 1, 1.5]), 1.0, True),  # half of it above
        (box([0.2, 0, 0.5 + EPS], [0.8, 1, 1.5 + EPS]), 1.0, False),
        (box([-0.3, 0, 0], [0.7, 1, 1]), 1.0, True),  # 0.3 of it over an anchor
        (box([-0.3 - EPS, 0, 0], [0.7, 1, 1]), 1.0, False),
        (box([0.4, 0, 0], [0.8, 1, 1]), 1.5, True),
        (box([0.4, 0, 0], [0.8, 1, 1]), 1.5 + EPS, False),
    ],
)
def test_between_is_in_the_spanned_box_and_over_neither(thing, apart, yes):
    """Of any two of several anchors; one alone is nothing to be between."""
    assert between(thing, LEFT, gapped(apart)) is yes
    assert between(thing, gapped(apart), LEFT) is yes
    far = box([50, 50, 50], [51, 51, 51])
    assert holds(ConstraintKind.BETWEEN, final(thing), far=far, a=LEFT, b=gapped(apart)) is yes
    assert not holds(ConstraintKind.BETWEEN, final(thing), a=LEFT)


THING = box([-0.1, -0.1, 0], [0.1, 0.1, 0.2])


@pytest.mark.parametrize(("degrees", "yes"), [(0, True), (29.9, True), (-29.9, True), (30.1, False), (180, False)])
def test_facing_is_within_a_cone(degrees, yes):
    """To either side of the front, however long that is given; the target is wide enough to overlap across it."""
    a = np.radians(90.0 + degrees)
    assert facing(THING, 3.0 * np.array([np.cos(a), np.sin(a)]), box([-1, 1, 0], [1, 3, 1])) is yes


def test_facing_is_near_and_overlaps_across_the_front():
    """2 m from box to box; half of the 20 cm lies behind each other; a front that points up faces nothing."""
    north = np.array([0.0, 1.0])
    for away, yes in ((2.0, True), (2.0 + EPS, False)):
        assert facing(THING, north, box([-1, 0.1 + away, 0], [1, 3 + away, 0.2])) is yes
    for shift, yes in ((0.1, True), (0.1 + EPS, False)):
        assert facing(THING, north, box([shift - 0.1, 1, 0], [shift + 0.1, 1.2, 0.2])) is yes
    ahead = box([-1, 1, 0], [1, 2, 1])
    assert not facing(THING, np.zeros(2), ahead)
    assert not holds(ConstraintKind.FACING, final(THING, (0.0, -1.0)), a=ahead)
    assert holds(ConstraintKind.FACING, final(THING), a=ahead)


def test_physical_has_no_intersection_and_rests():
    """A millimetre deep and a centimetre up are the last that count; over nothing nothing rests."""
    assert physical(TOUCHING, 0.01)
    assert physical(0.0, 0.0)
    assert not physical(TOUCHING + EPS, 0.0)
    assert not physical(0.0, 0.01 + EPS)
    assert not physical(0.0, None)


def instance(name: str, label: str) -> Instance:
    return Instance(name, label, CUBE, (Part("body", CUBE, 1.0),), None)


def reading(names=(), references=(), facing_to="") -> Intent:
    """Of a sentence whose base is instance 1."""
    return Intent(
        "1", "bed", "ball", np.ones(3), 1.0, False, 1.0, OrientationRequest("any", facing_to, ""),
        RegionRequest("", names, references, ""), (), (),
    )  # fmt: skip


THINGS = [instance("1", "bed"), instance("2", "lamp"), instance("3", "lamp")]


def truth(base: str, base_id: str = "") -> ExpectedOutcome:
    return ExpectedOutcome(base=base, part="", region="", feasible=True, reason="", base_id=base_id)


@pytest.mark.parametrize(
    ("stated", "anchors"),
    [
        (None, ("1",)),
        (truth("lamp"), ("2", "3")),
        (truth("lamp", "3"), ("3",)),
        (truth("sofa"), ()),
        (truth(""), None),
    ],
)
def test_the_base_is_that_of_the_truth(stated, anchors):
    """Its id, else the instances of its label, which may be none; the reading's where there is no truth, and no such
    constraint where the truth leaves it open."""
    expected = () if anchors is None else (AskedConstraint(ConstraintKind.ON, anchors),)
    assert asked_constraints(THINGS, reading(), stated) == expected


def test_relations_are_those_of_the_reading():
    """Words with a counterpart and instances of the scene; parts, walls, sides and one anchor of between are none."""
    asked = asked_constraints(THINGS, reading(("left", "near", "next_to"), ("part:pillow", "2", "9"), "3"), truth(""))
    assert asked == (
        AskedConstraint(ConstraintKind.NEAR, ("2",)),
        AskedConstraint(ConstraintKind.ADJACENT, ("2",)),
        AskedConstraint(ConstraintKind.FACING, ("3",)),
    )
    two = asked_constraints(THINGS, reading(("between",), ("2", "3"), "wall"), truth(""))
    assert two == (AskedConstraint(ConstraintKind.BETWEEN, ("2", "3")),)
    assert asked_constraints(THINGS, reading(("between", "under"), ("2",), "part:pillow"), truth("")) == ()
    assert asked_constraints(THINGS, reading(("near", "edge"), ("part:pillow",), "away:2"), truth("")) == ()
