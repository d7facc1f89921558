"""Covers are layers of their own thickness over what carries them, by their role and not by what they are made of."""

import numpy as np
import pytest

from dcap.language.covers import cover_thickness
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part
from tasks.particles.layers import column_of, covers_of, edge_step, lies_under, owners

TOP = 0.5


def plate(x, y, z, count=30):
    """A level sheet over x = (low, high), y = (low, high) that looks up."""
    u, v = np.meshgrid(np.linspace(x[0], x[1], count), np.linspace(y[0], y[1], count), indexing="ij")
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh.of(np.stack([u, v, np.full_like(u, z)], -1).reshape(-1, 3), faces)


def box_of(low, high):
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    return OrientedBox((low + high) / 2, np.eye(3), (high - low) / 2)


def bed(step):
    """A mattress whose foot half lies under a blanket that is `step` [m] higher, and a pillow at the head."""
    pieces = [plate((-0.7, 0.7), (-1.0, 0.0), TOP), plate((-0.7, 0.7), (0.0, 1.0), TOP + step),
              plate((-0.3, 0.3), (-0.95, -0.6), TOP + 0.1)]  # fmt: skip
    part = np.repeat(np.arange(3, dtype=np.int32), [len(p.faces) for p in pieces])
    names = ("mattress", "blanket", "pillow")
    boxes = (box_of((-0.7, -1.0, 0.25), (0.7, 1.0, TOP)), box_of((-0.7, 0.0, 0.3), (0.7, 1.0, TOP + step)),
             box_of((-0.3, -0.95, TOP), (0.3, -0.6, TOP + 0.1)))  # fmt: skip
    parts = tuple(Part(name, box, 1.0) for name, box in zip(names, boxes, strict=True))
    return Instance("bed_0", "bed", boxes[0], parts, None), Mesh.concatenate(pieces), part


@pytest.mark.parametrize(
    "name",
    [
        "blanket",
        "wool blanket",
        "cotton sheets",
        "bath towels",
        "bath_towel",
        "Duvet",
        "seat cover",
        "rug",
        "tablecloth",
    ],
)
def test_covers_have_a_usual_thickness(name):
    """Between half a millimetre and ten centimetres."""
    thickness = cover_thickness(name)
    assert thickness is not None
    assert 5e-4 < thickness < 0.1


@pytest.mark.parametrize("name", ["mattress", "pillow", "blanket box", "towel rail", "seat", ""])
def test_other_things_are_no_covers(name):
    """What is named last decides."""
    assert cover_thickness(name) is None


@pytest.mark.parametrize("step", [0.012, 0.045])
def test_an_edge_shows_how_thick_a_cover_is(step):
    """The step from the mattress up to the blanket is its thickness."""
    base, mesh, part = bed(step)
    cover = covers_of(base, [0, 1, 2], mesh, part)[1]
    assert cover.measured
    assert cover.thickness == pytest.approx(step, abs=1e-6)


def test_without_an_edge_it_is_as_thick_as_usual():
    """A blanket level with the mattress shows no step; nor does one whose surroundings scatter."""
    base, mesh, part = bed(0.0)
    cover = covers_of(base, [0, 1, 2], mesh, part)[1]
    assert not cover.measured
    assert cover.thickness == cover_thickness("blanket")
    rough = Mesh.of(
        mesh.vertices + np.random.default_rng(0).normal(0, 0.02, mesh.vertices.shape) * [0, 0, 1], mesh.faces
    )
    assert edge_step(rough, part == 1, part == 0) is None


@pytest.mark.parametrize("hangs", [0.3, 0.05])
def test_what_carries_a_cover_may_end_higher_than_it(hangs):
    """A blanket that hangs down to the floor still lies on the mattress; the pillow on it does not carry it."""
    base, mesh, part = bed(0.03)
    low, high = np.array([-0.8, 0.0, hangs]), np.array([0.8, 1.1, TOP + 0.03])
    box = OrientedBox((low + high) / 2, np.eye(3), (high - low) / 2)
    pillow = box_of((-0.3, 0.2, TOP + 0.02), (0.3, 0.6, TOP + 0.15))
    parts = (base.parts[0], Part("blanket", box, 1.0), Part("pillow", pillow, 1.0))
    cover = covers_of(base, [0, 1, 2], mesh, part)[1]
    whole = Instance("bed_0", "bed", base.box, parts, None)
    assert lies_under(whole, 0, cover)
    assert not lies_under(whole, 2, cover)


def upright(x, y, z):
    """A sheet at x over y = (low, high), z = (low, high)."""
    flat = plate(z, y, 0.0)
    return Mesh.of(flat.vertices[:, [2, 1, 0]] + [x, 0.0, 0.0], flat.faces)


def test_faces_inside_bound_no_cover():
    """Where a modeller joined pieces by a sheet of the blanket's in the bed, the mattress is mattress still."""
    base, mesh, part = bed(0.03)
    pieces = [upright(-0.7, (0.0, 1.0), (0.25, TOP)), upright(0.7, (0.0, 1.0), (0.25, TOP)),
              upright(-0.1, (0.01, 0.99), (0.26, TOP + 0.01))]  # fmt: skip
    owner = np.concatenate([part, *(np.full(len(m.faces), p) for m, p in zip(pieces, (0, 0, 1), strict=True))])
    covers = covers_of(base, [0, 1, 2], mesh, part)
    depth = np.linspace(0.0, 0.2, 41)
    points = np.column_stack([np.full(41, -0.11), np.full(41, 0.5), TOP + 0.03 - depth])
    found = owners(base, covers, Mesh.concatenate([mesh, *pieces]), owner, points)
    assert (found[depth > 0.031] == 0).all()


def test_a_thing_that_is_a_cover_as_a_whole():
    """The one part of a rug is the rug, whatever the part is called."""
    sheet = plate((-1, 1), (-1, 1), 0.01)
    rug = Instance(
        "rug_1", "rug", box_of((-1, -1, 0), (1, 1, 0.01)), (Part("body", box_of((-1, -1, 0), (1, 1, 0.01)), 1.0),), None
    )
    part = np.zeros(len(sheet.faces), dtype=np.int32)
    assert covers_of(rug, [0], sheet, part)[0].thickness == cover_thickness("rug")


def test_below_a_cover_lies_what_carries_it():
    """Down to its thickness the blanket, deeper the mattress, though a pillow's faces may be nearer."""
    base, mesh, part = bed(0.03)
    covers = covers_of(base, [0, 1, 2], mesh, part)
    depth = np.linspace(0.0, 0.2, 201)
    x, y = -0.1, 0.05
    found = owners(base, covers, mesh, part, np.column_stack([np.full(201, x), np.full(201, y), TOP + 0.03 - depth]))
    assert (found[depth < 0.0299] == 1).all()
    assert (found[depth > 0.0301] == 0).all()
    column = column_of(found, depth, [("mattress", "foam"), ("blanket", "wool"), ("pillow", "down")])
    assert [(one.part, one.material) for one in column] == [("blanket", "wool"), ("mattress", "foam")]
    assert column[0].from_m == 0.0
    assert column[0].to_m == column[1].from_m == pytest.approx(0.03, abs=2e-3)
    assert column[1].to_m == pytest.approx(0.2)
