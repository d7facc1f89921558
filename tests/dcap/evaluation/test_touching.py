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


@pytest.mark.parametrize("height", [0.0, 1e-4, 0.0009, 0.0011, 0.05])
def test_a_box_over_a_slab(height):
    """What carries it once it has come down does not depend on how far it has to."""
    found = touching(box([0.2, 0.1, 0.1], [0.0, 0.0, 0.05 + height]), SLAB)
    assert found.gap == pytest.approx(height, abs=1e-6)
    assert found.penetration == pytest.approx(0.0, abs=1e-6)
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
