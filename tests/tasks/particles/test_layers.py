"""Covers are layers of their own thickness over what carries them, by their role and not by what they are made of."""

from collections.abc import Sequence

import numpy as np
import pytest
import trimesh
from benches import CLOTH, FOAM, WOOD, Named, cube_over, soft_layers
from box_rooms import block
from furnished import sheet

from dcap.knowledge.material_table import cover_thickness
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part
from tasks.particles.contact_layers import soft_bottoms
from tasks.particles.layers import UNEVEN, UNSEEN, BaseLayers, column_of, covers_beneath, covers_of, lies_under

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


def lying(base, mesh, part, seen=None):
    """What lies where in a base of soft parts, of which `seen` faces are in the crop."""
    soft = range(len(base.parts))
    covers = covers_of(base, soft, mesh, part)
    seen = np.arange(len(mesh.faces)) if seen is None else seen
    return BaseLayers.of(
        base, soft, covers, covers_beneath(base, covers, mesh, part), mesh.submesh(seen), part[seen]
    )  # fmt: skip


def down(x, y, top, deepest, count=201):
    """Depths and points straight down from a height [m]."""
    depth = np.linspace(0.0, deepest, count)
    return depth, np.column_stack([np.full(count, x), np.full(count, y), top - depth])


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


def test_an_edge_on_something_rigid_shows_it_too():
    """The step from a bench up to the towel on it is the towel's thickness, though the bench is not among the soft."""
    base, mesh, part = bed(0.03)
    assert covers_of(base, [1], mesh, part)[1].thickness == pytest.approx(0.03, abs=1e-6)


def test_without_an_edge_it_is_as_thick_as_usual():
    """A blanket level with the mattress shows no step; nor does one whose surroundings scatter; nor does one beside
    which nothing is seen: each says why."""
    base, mesh, part = bed(0.0)
    cover = covers_of(base, [0, 1, 2], mesh, part)[1]
    assert not cover.measured
    assert (cover.thickness, cover.why) == (cover_thickness("blanket"), UNEVEN)
    noise = np.random.default_rng(0).normal(0, 0.02, mesh.vertices.shape) * [0, 0, 1]
    assert covers_of(base, [1], Mesh.of(mesh.vertices + noise, mesh.faces), part)[1].why == UNEVEN
    alone = np.flatnonzero(part == 1)
    assert covers_of(base, [1], mesh.submesh(alone), part[alone])[1].why == UNSEEN


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


def test_a_thing_that_is_a_cover_as_a_whole():
    """The one part of a rug is the rug, whatever the part is called, as thick as its closed surface or the floor beside
    it show."""
    sheet = plate((-1, 1), (-1, 1), 0.01)
    rug = Instance(
        "rug_1", "rug", box_of((-1, -1, 0), (1, 1, 0.01)), (Part("body", box_of((-1, -1, 0), (1, 1, 0.01)), 1.0),), None
    )
    part = np.zeros(len(sheet.faces), dtype=np.int32)
    assert covers_of(rug, [0], sheet, part)[0].thickness == cover_thickness("rug")
    closed = trimesh.creation.box((2.0, 2.0, 0.03))
    solid = Mesh.of(closed.vertices, closed.faces)
    assert covers_of(rug, [0], solid, np.zeros(12, np.int32))[0].thickness == pytest.approx(0.03)
    floor = plate((-2, 2), (-2, 2), 0.01 - 0.022, 2)
    shelf = plate((-2, 2), (-2, 2), 0.5)  # hides nothing
    assert covers_of(rug, [0], sheet, part, [shelf, floor])[0].thickness == pytest.approx(0.022, abs=1e-6)


def test_below_a_cover_lies_what_carries_it():
    """Down to its thickness the blanket, deeper the mattress, though a pillow's faces may be nearer."""
    depth, points = down(-0.1, 0.05, TOP + 0.03, 0.2)
    found = lying(*bed(0.03)).owners(points)
    assert (found[depth < 0.0299] == 1).all()
    assert (found[depth > 0.0301] == 0).all()
    column = column_of(found, depth, [("mattress", "foam"), ("blanket", "wool"), ("pillow", "down")])
    assert [(one.part, one.material) for one in column] == [("blanket", "wool"), ("mattress", "foam")]
    assert column[0].from_m == 0.0
    assert column[0].to_m == column[1].from_m == pytest.approx(0.03, abs=2e-3)
    assert column[1].to_m == pytest.approx(0.2)


@pytest.mark.parametrize("step", [0.03, 0.0])
def test_what_carries_a_cover_need_not_be_seen_near_by(step):
    """In the middle of a blanket that hides all around it the mattress is below it still, as thick a blanket as the far
    edge shows or as is usual."""
    base, mesh, part = bed(step)
    near = np.flatnonzero(
        (part == 1) & (np.abs(mesh.triangles.mean(axis=1) - [0.0, 0.6, 0.0])[:, :2] < 0.2).all(axis=1)
    )
    depth, points = down(0.0, 0.6, TOP + step, 0.2)
    found = lying(base, mesh, part, near).owners(points)
    thick = step or cover_thickness("blanket")
    assert (found == np.where(depth < thick, 1, 0))[np.abs(depth - thick) > 1e-4].all()


def test_a_mattress_that_shows_its_head_end_only_carries_the_blanket():
    """Its box ends where the blanket begins; the step beside the blanket's edge shows what that lies on."""
    base, mesh, part = bed(0.03)
    head = Part("mattress", box_of((-0.7, -1.0, 0.25), (0.7, 0.0, TOP)), 1.0)
    base = Instance("bed_0", "bed", base.box, (head, *base.parts[1:]), None)
    cover = covers_of(base, [0, 1, 2], mesh, part)[1]
    assert cover.beside == 0
    assert lies_under(base, 0, cover)
    depth, points = down(0.0, 0.6, TOP + 0.03, 0.2)
    assert (lying(base, mesh, part).owners(points)[depth > 0.0301] == 0).all()


def stacked(names, order=(0, 1, 2)):
    """A mattress whose foot lies under a topper of 5 cm that is bare over 20 cm, and under a duvet of 4 cm on that."""
    pieces = [plate((-0.7, 0.7), (-1.0, -0.2), TOP), plate((-0.7, 0.7), (-0.2, 0.0), TOP + 0.05),
              plate((-0.7, 0.7), (0.0, 1.0), TOP + 0.09)]  # fmt: skip
    boxes = [box_of((-0.7, -1.0, 0.25), (0.7, 1.0, TOP)), box_of((-0.7, -0.2, TOP), (0.7, 1.0, TOP + 0.05)),
             box_of((-0.7, 0.0, TOP), (0.7, 1.0, TOP + 0.09))]  # fmt: skip
    part = np.concatenate([np.full(len(pieces[i].faces), k, np.int32) for k, i in enumerate(order)])
    parts = tuple(Part(names[i], boxes[i], 1.0) for i in order)
    return Instance("bed_0", "bed", boxes[0], parts, None), Mesh.concatenate([pieces[i] for i in order]), part


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_covers_over_covers_are_peeled_from_the_top(order):
    """Down through the duvet comes the topper, as thick as its own edge shows, then the mattress: in whichever order
    the parts are listed."""
    names = ("mattress", "topper", "duvet")
    base, mesh, part = stacked(names, order)
    depth, points = down(0.0, 0.6, TOP + 0.09, 0.2)
    found = np.array(order)[lying(base, mesh, part).owners(points)]
    clear = (np.abs(depth - 0.04) > 1e-3) & (np.abs(depth - 0.09) > 1e-3)
    assert (found == np.where(depth < 0.04, 2, np.where(depth < 0.09, 1, 0)))[clear].all()


@pytest.mark.parametrize("slope_deg", [0.0, 25.0])
def test_layers_of_a_cover_lie_along_its_open_surface(slope_deg):
    """Across a blanket that slopes the normal is that of its top, whatever the bed beneath is shaped like and however
    near its edge, but for where the edge is nearer than its thickness."""
    base, mesh, part = bed(0.03)
    slope = np.tan(np.radians(slope_deg))
    mesh = Mesh.of(mesh.vertices + slope * mesh.vertices[:, :1] * [0.0, 0.0, 1.0], mesh.faces)
    x, y = (a.ravel() for a in np.meshgrid([-0.66, -0.3, 0.0, 0.5, 0.66], [0.1, 0.5, 0.95]))
    points = np.column_stack([x, y, TOP + 0.03 + slope * x - 0.015])
    found = lying(base, mesh, part).normals(points, np.ones(len(points), dtype=np.int64), [1])
    upright = np.array([-np.sin(np.radians(slope_deg)), 0.0, np.cos(np.radians(slope_deg))])
    assert np.abs(found @ upright) == pytest.approx(1.0, abs=1e-6)


def test_an_edge_turns_layers_over_half_their_thickness_only():
    """Beside the upright rim of a mat its layers are level again within its thickness: not within half the depth of
    what it lies on."""
    mat = [plate((-0.5, 0.5), (-0.5, 0.5), 0.02), upright(0.5, (-0.5, 0.5), (0.0, 0.02))]
    mesh, part = Mesh.concatenate(mat), np.zeros(sum(len(m.faces) for m in mat), np.int32)
    base = Instance("mat_0", "mat", box_of((-0.5, -0.5, 0), (0.5, 0.5, 0.02)),
                    (Part("body", box_of((-0.5, -0.5, 0), (0.5, 0.5, 0.02)), 1.0),), None)  # fmt: skip
    points = np.column_stack([np.linspace(0.3, 0.5 - 0.03, 20), np.zeros(20), np.full(20, 0.012)])
    found = lying(base, mesh, part).normals(points, np.zeros(20, dtype=np.int64), [0])
    assert np.abs(found[:, 2]).min() > 0.999


SEAT, THICK, WAVE = 0.45, 0.008, 0.012
SIDE = 0.3


def wavy(mesh: Mesh) -> Mesh:
    """Raised by waves of 2 WAVE from crest to trough [m]."""
    lift = WAVE * (1.0 - np.cos(2.0 * np.pi * mesh.vertices[:, 0] / 0.2))
    return Mesh.of(mesh.vertices + lift[:, None] * [0.0, 0.0, 1.0], mesh.faces)


def bottoms(parts: Sequence[Named], height: float) -> dict[str, float]:
    """Bottom of each soft part [m]."""
    setup = cube_over(parts, height)
    layers = soft_layers(setup)
    found = soft_bottoms(setup, layers)
    return {parts[i][0]: float(found[layers.part == i].max()) for i in set(layers.part.tolist())}


BENCH = ("seat", block((-0.6, -0.4, 0.0), (0.6, 0.4, SEAT)), WOOD)
TOWEL = ("towel", wavy(sheet((-SIDE, SIDE), (-SIDE, SIDE), SEAT + THICK, 0.02)), CLOTH)


@pytest.mark.parametrize("parts", [[BENCH, TOWEL], [TOWEL, BENCH]])
def test_a_wavy_cloth_touches_what_is_rigid_in_its_troughs(parts: Sequence[Named]) -> None:
    """It reaches down by its thickness from its lowest place, not from its middle height, 12 mm above the bench."""
    found = bottoms(parts, SEAT + THICK + 2.0 * WAVE)
    assert found["towel"] == pytest.approx(SEAT)  # of waves of 24 mm no even step is seen: 8 mm, as is usual


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_carries_is_seen_to_before_what_is_carried(order: Sequence[int]) -> None:
    """A seat that is seen as a sheet is taken as 4 cm thick, and the throw on it ends there too, listed before or
    after."""
    foam = ("seat", sheet((-0.6, 0.6), (-0.4, 0.4), SEAT), FOAM)
    throw = ("throw", sheet((-SIDE, SIDE), (-SIDE, SIDE), SEAT + 0.02), CLOTH)
    found = bottoms([(foam, throw)[i] for i in order], SEAT + 0.02)
    assert found == pytest.approx({"seat": SEAT - 0.04, "throw": SEAT - 0.04})
