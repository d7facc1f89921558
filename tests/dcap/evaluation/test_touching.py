"""How an object and a scene touch: closed forms of boxes and balls over, on and in slabs."""

import numpy as np
import pytest
import trimesh

from dcap.evaluation.metrics.touching import TOUCHING, touching
from dcap.geometry.primitives import Box
from dcap.scene.types.mesh import Mesh


def box(size, middle) -> Mesh:
    """A closed box."""
    return Box(np.array(size, dtype=float)).surface(10.0).transformed(moved(middle))


def moved(by):
    matrix = np.eye(4)
    matrix[:3, 3] = by
    return matrix


def ball(radius, middle) -> Mesh:
    shape = trimesh.creation.icosphere(4, radius)
    return Mesh.of(np.asarray(shape.vertices) + middle, np.asarray(shape.faces))


SLAB = box([1.0, 1.0, 0.2], [0.0, 0.0, -0.1])
"""Its top is z = 0."""


@pytest.mark.parametrize("height", [-9e-4, -1e-4, -3e-5, 0.0, 1e-4, 0.0009, 0.0011, 0.05])
def test_a_box_over_a_slab(height):
    """What carries it once it has come down does not depend on how far it has to, nor on a hair that it is too low."""
    found = touching(box([0.2, 0.1, 0.1], [0.0, 0.0, 0.05 + height]), SLAB)
    assert found.gap == pytest.approx(max(height, 0.0), abs=1e-6)
    assert found.penetration == pytest.approx(max(-height, 0.0), abs=1e-6)
    touches = height <= TOUCHING
    assert found.contact_area == pytest.approx(0.02 if touches else 0.0, rel=0.05)
    assert found.margin == pytest.approx(0.05, abs=0.003)
    assert found.patch.mean(axis=0)[:2] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_box_in_a_slab():
    """2 cm deep: the bottom and as much of the sides touch; nothing has to come down."""
    found = touching(box([0.2, 0.1, 0.1], [0.0, 0.0, 0.03]), SLAB)
    assert found.penetration == pytest.approx(0.02, abs=1e-6)
    assert found.gap == 0.0
    assert found.contact_area == pytest.approx(0.02 + 0.02 * 0.6, rel=0.1)


def test_a_ball_in_a_slab():
    """A cap of 1 cm: depth below its middle, area 2 pi R h and what is within a millimetre above."""
    found = touching(ball(0.1, [0.0, 0.0, 0.09]), SLAB)
    assert found.penetration == pytest.approx(0.01, rel=0.02)
    assert found.contact_area == pytest.approx(2 * np.pi * 0.1 * 0.01, rel=0.15)


def test_a_box_that_is_wholly_inside():
    """Its top is 3 cm below the surface and it is 6 cm high: the bottom is 9 cm below."""
    found = touching(box([0.1, 0.1, 0.06], [0.0, 0.0, -0.06]), SLAB)
    assert found.penetration == pytest.approx(0.09, abs=1e-6)
    assert found.gap == 0.0


def test_a_box_that_is_wholly_inside_a_bed_that_stands_on_a_slab():
    """Their faces coincide below it: the bed's counts, whichever is met first."""
    bed = box([2.0, 1.6, 0.5], [0.0, 0.0, 0.25])
    for scene in (Mesh.concatenate([bed, SLAB]), Mesh.concatenate([SLAB, bed])):
        assert touching(box([0.2, 0.2, 0.2], [0.0, 0.0, 0.2]), scene).penetration == pytest.approx(0.4, abs=1e-6)


def test_the_rim_of_a_side_does_not_touch():
    """A cube of 20 cm stands on its bottom alone."""
    found = touching(box([0.2, 0.2, 0.2], [0.0, 0.0, 0.1]), SLAB)
    assert found.contact_area == pytest.approx(0.04, rel=1e-3)


def test_a_box_under_a_table_is_in_nothing():
    table = Mesh.concatenate([box([1.0, 1.0, 0.03], [0.0, 0.0, 0.7]), SLAB])
    found = touching(box([0.2, 0.2, 0.2], [0.0, 0.0, 0.1]), table)
    assert found.penetration == pytest.approx(0.0, abs=1e-6)
    assert found.gap == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("over", "margin"), [(0.02, 0.03), (0.08, -0.03)])
def test_a_box_over_an_edge(over, margin):
    """`over` of its 10 cm hang over: the contact ends at the edge, 5 cm - over inside of the centre."""
    found = touching(box([0.1, 0.2, 0.1], [0.5 - 0.05 + over, 0.0, 0.05]), SLAB)
    assert found.margin == pytest.approx(margin, abs=0.004)


def test_over_nothing():
    found = touching(box([0.1, 0.1, 0.1], [3.0, 0.0, 1.0]), SLAB)
    assert (found.gap, found.contact_area, found.penetration) == (np.inf, 0.0, 0.0)
    assert found.columns.nearest == -1


def together(*meshes: Mesh) -> Mesh:
    """Several meshes as one."""
    counts = np.cumsum([0, *(len(one.vertices) for one in meshes)])
    faces = [one.faces + count for one, count in zip(meshes, counts, strict=False)]
    return Mesh.of(np.concatenate([one.vertices for one in meshes]), np.concatenate(faces))


@pytest.mark.parametrize("height", [0.05, 0.0, -0.003])
def test_a_chair_whose_seat_is_under_a_desk(height):
    """The floor carries it, 5 cm below or 3 mm into it, and not the desk between its seat and its back's upper end."""
    seat, back = box([0.4, 0.4, 0.45], [0.0, 0.0, 0.225 + height]), box([0.4, 0.05, 0.9], [0.0, -0.3, 0.45 + height])
    desk = box([1.0, 0.45, 0.03], [0.0, 0.0, 0.735])
    found = touching(together(seat, back), together(SLAB, desk))
    assert found.gap == pytest.approx(max(height, 0.0), abs=1e-5)
    assert found.penetration == pytest.approx(max(-height, 0.0), abs=1e-5)
    assert found.columns.top[found.columns.nearest] == pytest.approx(0.0, abs=1e-5)
    assert found.margin > 0.0


def test_a_low_part_is_in_what_a_high_part_is_in():
    """A plate of 1 cm with a pole, 3 cm in a slab: 3 cm below its surface everywhere."""
    plate, pole = box([0.3, 0.3, 0.01], [0.0, 0.0, -0.025]), box([0.1, 0.1, 0.3], [0.0, 0.0, 0.13])
    found = touching(together(plate, pole), SLAB)
    assert found.columns.gap == pytest.approx(np.where(found.columns.gap < -0.025, -0.03, -0.02), abs=1e-5)
    assert (found.columns.gap < -0.025).mean() > 0.85


def test_the_middle_of_a_contact_does_not_depend_on_how_its_faces_are_cut():
    """A disc whose bottom is a fan about a point of its rim."""
    angle = 2 * np.pi * np.arange(96) / 96
    rim = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    below, above = (np.column_stack([rim, np.full(96, z)]) for z in (0.0, 0.02))
    fan = np.column_stack([np.zeros(94, dtype=int), np.arange(2, 96), np.arange(1, 95)])
    i, j = np.arange(96), np.roll(np.arange(96), -1)
    sides = np.concatenate([np.column_stack([i, j, j + 96]), np.column_stack([i, j + 96, i + 96])])
    disc = Mesh.of(np.concatenate([below, above]), np.concatenate([fan, fan[:, ::-1] + 96, sides]))
    found = touching(disc, SLAB)
    assert found.middle is not None
    assert found.middle == pytest.approx([0.0, 0.0, 0.0], abs=1e-4)


DEPTHS = np.array([0.1, 0.5, 2.0, 5.0, 15.0, 20.0, 25.0, 29.0, 29.9, 31.0, 45.0])
"""How far things are lowered into a slab [mm]."""


def book(depth: float) -> Mesh:
    return box([0.22, 0.15, 0.03], [0.0, 0.0, 0.015 - depth])


def cube(depth: float) -> Mesh:
    return box([0.1, 0.1, 0.1], [0.0, 0.0, 0.05 - depth])


def pen(depth: float) -> Mesh:
    """Upright: no way out sideways, though it is thin."""
    return box([0.008, 0.008, 0.15], [0.0, 0.0, 0.075 - depth])


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(book, marks=pytest.mark.long),
        cube,
        pytest.param(pen, marks=pytest.mark.long),
        lambda depth: ball(0.05, [0.0, 0.0, 0.05 - depth]),
    ],
)
def test_lowered_into_a_slab_it_is_as_deep_as_it_is_low(shape):
    """Also where its top is nearer to the surface than its bottom, and where it is below the surface as a whole."""
    for depth in 1e-3 * DEPTHS:
        assert touching(shape(depth), SLAB).penetration == pytest.approx(depth, rel=0.02, abs=2e-5)


def test_nearly_drowned_things_are_deep():
    """A cube and a ball of 10 cm, 99 and 99.9 mm of them below the surface."""
    assert touching(cube(0.099), SLAB).penetration == pytest.approx(0.099, rel=1e-3)
    assert touching(ball(0.05, [0.0, 0.0, 0.05 - 0.0999]), SLAB).penetration == pytest.approx(0.0999, rel=0.01)


def test_what_may_come_out_sideways_is_no_deeper_than_that():
    """A cupboard's edge in a ball's side, a wall beside a box, two walls at a box between them, half over an edge."""
    cupboard = box([1.0, 1.0, 1.0], [0.58, 0.0, -0.5])  # its face is at x = 8 cm, its top at z = 0
    assert touching(ball(0.1, [0.0, 0.0, 0.0]), cupboard).penetration == pytest.approx(0.02, abs=0.003)
    wall = together(SLAB, box([0.2, 2.0, 0.3], [0.145, 0.0, 0.15]))
    assert touching(box([0.1, 0.1, 0.1], [0.0, 0.0, 0.05]), wall).penetration == pytest.approx(0.005, abs=1e-3)
    vice = together(SLAB, box([0.2, 2.0, 0.06], [0.148, 0.0, 0.03]), box([0.2, 2.0, 0.06], [-0.148, 0.0, 0.03]))
    assert touching(box([0.1, 0.1, 0.1], [0.0, 0.0, 0.05]), vice).penetration == pytest.approx(0.002, abs=5e-4)
    half_over = touching(box([0.1, 0.1, 0.1], [0.5, 0.0, -0.045]), SLAB)
    assert half_over.penetration == pytest.approx(0.05, abs=2e-3)


def test_what_is_between_its_parts_is_not_in_it():
    """A low box between a seat and the bar below it."""
    chair = together(box([0.4, 0.4, 0.02], [0.0, 0.0, 0.45]), box([0.4, 0.4, 0.02], [0.0, 0.0, 0.1]))
    found = touching(chair, box([0.3, 0.3, 0.1], [0.0, 0.0, 0.3]))
    assert found.penetration == 0.0


@pytest.mark.parametrize("under", [-3e-3, 0.0, 5e-4, 3e-3])
def test_what_is_just_under_a_board_does_not_rest_on_it(under):
    """A cube whose top is that far below it, or inside it from below; the floor carries it."""
    board = box([1.0, 1.0, 0.03], [0.0, 0.0, 0.115 + under])
    found = touching(cube(0.0), together(SLAB, board))
    assert found.columns.top[found.columns.nearest] == pytest.approx(0.0, abs=1e-5)
    assert found.gap == pytest.approx(0.0, abs=1e-5)
    assert found.penetration == pytest.approx(max(-under, 0.0), abs=1e-4)
