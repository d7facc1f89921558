"""Which things take part in the next drop, and where they start."""

from dataclasses import replace

import numpy as np
import pytest
from dented_bed import RADIUS, TOP, anchor, ball
from placed_folder import placed_folder, read_placed

from dcap.language.connect import connect
from dcap.language.protocol.client import LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.types.choices import Anchor
from dcap.scene.types.earlier import EarlierPlacements, PlacedThing
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.freed.stage import GAP, closed, freed, meet
from tasks.segment.stage import SegmentConfig, segment


@pytest.fixture(scope="module")
def dented(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scan, SegmentedScene]:
    """The ball in its dent, as the next placement reads it."""
    scan = read_placed(placed_folder(tmp_path_factory.mktemp("dented")))
    return scan, segment(scan, SegmentConfig(), connect(LanguageConfig(), Session()))


def beside(x: float, y: float, base: str = "bed") -> Anchor:
    """A ball 1 cm above the bed at a place."""
    one = anchor()
    pose = one.world_from_object.copy()
    pose[:2, 3] = x, y
    return replace(one, base_id=base, world_from_object=pose, surface_point=np.array([x, y, TOP]))


def test_a_near_thing_is_lifted_out_of_its_dent(dented: tuple[Scan, SegmentedScene]) -> None:
    """The bed is flat again, and the ball starts a gap above it."""
    found = freed(*dented, SegmentedObject(ball()), beside(0.25, 0.0))
    assert [one.id for one in found.things] == ["placed_1"]
    assert found.ground == "bed"
    bed, thing = (found.scene.instance_mesh(found.scene.index_of(one)) for one in ("bed", "placed_1"))
    assert bed.vertices[bed.vertices[:, 2] > 0.3, 2].min() > TOP - 2e-6
    # the lowest vertex of the ball is over the flat top; rays are good to 1e-6 of their length
    assert thing.bounds[0, 2] == pytest.approx(TOP + GAP, abs=1e-5)
    np.testing.assert_array_equal(found.anchor.world_from_object, beside(0.25, 0.0).world_from_object)


def test_the_object_starts_above_what_is_lifted(dented: tuple[Scan, SegmentedScene]) -> None:
    """On a ball that goes up by its dent the object starts as far above it as before: 1 cm."""
    resting = float(dented[1].instance_mesh(4).bounds[1, 2])
    start = beside(0.0, 0.0, base="placed_1")
    start.world_from_object[2, 3] = start.surface_point[2] = resting
    start.world_from_object[2, 3] += RADIUS + 0.01
    found = freed(*dented, SegmentedObject(ball()), start)
    top = found.scene.instance_mesh(found.scene.index_of("placed_1")).bounds[1, 2]
    lowest = ball().mesh.transformed(found.anchor.world_from_object).bounds[0, 2]
    assert top > resting + 0.02
    assert lowest - top == pytest.approx(0.01, abs=1e-4)  # two poles of balls with faces of 1 cm, one of them turned
    assert found.anchor.surface_point[2] == pytest.approx(top, abs=1e-4)


def test_what_rests_on_something_else_stays(dented: tuple[Scan, SegmentedScene]) -> None:
    """A thing in reach that another thing carries is no free body: its support is not simulated."""
    found = freed(*dented, SegmentedObject(ball()), beside(0.25, 0.0, base="floor"))
    assert found.things == ()
    assert any("rests on something else" in note for note in found.notes)


def test_reach_goes_on_through_contacts_and_dents() -> None:
    """What touches a thing in reach is in reach; a thing far off is not."""
    box = np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.1]])
    boxes = {"a": box, "b": box + 1.0, "c": box + 2.0, "d": box + 3.0}
    things = tuple(PlacedThing(one, 1.0, ("bed",)) for one in boxes)
    earlier = EarlierPlacements((), (), things, (("a", "b"), ("b", "bed")), ())
    assert closed({"a"}, earlier, boxes) == {"a", "b"}
    for way, near in ((0.104, True), (0.106, False)):
        assert meet(box, box + np.array([way, 0.0, 0.0]), 5e-3) is near
