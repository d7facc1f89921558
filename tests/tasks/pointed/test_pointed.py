"""A point or a box of the file's own frame decides what carries; values that mean nothing are refused in one line."""

from dataclasses import replace

import pytest
from box_rooms import bedroom, block, segmentation, thing
from scans import scan_of

from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import GivenPlace
from dcap.scene.types.segmentation import Pointed, Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.pointed.stage import point, point_out
from tasks.rotation.stage import RotationConfig, rotation

ROOM = bedroom()
CUBE = thing("block", block((-0.05, -0.05, -0.05), (0.05, 0.05, 0.05)))


def unsure(scene: Segmentation, name: str, label: str = "thing", confidence: float = 0.0) -> Segmentation:
    """The scene with one thing that was only guessed."""
    index = scene.index_of(name)
    guessed = replace(scene.instances[index], label=label, confidence=confidence)
    return replace(scene, instances=tuple(guessed if i == index else one for i, one in enumerate(scene.instances)))


def pointed_at(place: GivenPlace, prompt: str = "put it there", scene: Segmentation = ROOM, up: str = "z") -> Pointed:
    return point(scan_of(scene, up), SegmentedScene(scene), place, prompt)


def placed(place: GivenPlace, prompt: str, scene: Segmentation = ROOM) -> tuple[Segmentation, Intent, Anchor]:
    """All that comes before the drop."""
    found = pointed_at(place, prompt, scene)
    room, item, client = point_out(SegmentedScene(scene), found), SegmentedObject(CUBE), OfflineClient()
    meant = intent(room, item, prompt, None, IntentConfig(), client, found)
    assert isinstance(meant, Intent), meant
    pose = rotation(room, item, meant, prompt, RotationConfig(picture_size=32), client)
    assert isinstance(pose, Rotation), pose
    spot = anchor(room, item, meant, pose, prompt, AnchorConfig(), client)
    assert isinstance(spot, Anchor), spot
    return room, meant, spot


@pytest.mark.parametrize(
    ("at", "base", "height"),
    [
        ((1.7, 0.7, 0.5), "table", 0.5),
        ((1.7, 0.7, 0.47), "table", 0.5),  # a little under the surface that was meant
        ((1.7, 0.7, 1.5), "table", 0.5),  # in the air, the table below
        ((1.7, 0.7), "table", 0.5),
        ((-2.0, -2.0), "floor", 0.0),
        ((-0.35, 0.7), "bed", 0.62),  # the pillow is the highest there
    ],
)
def test_the_thing_at_a_point_is_what_looks_up_below_it(at: tuple[float, ...], base: str, height: float) -> None:
    """Its surface is met by the vertical through the point; two numbers mean the highest surface."""
    found = pointed_at(GivenPlace(at=at))
    assert found.base_id == base
    assert found.point == pytest.approx([*at[:2], height], abs=1e-5)


@pytest.mark.parametrize(("up", "at"), [("y", (1.7, 0.5, -0.7)), ("y", (1.7, -0.7)), ("-z", (1.7, -0.7, -0.5))])
def test_points_are_in_the_files_own_frame(up: str, at: tuple[float, ...]) -> None:
    """With y up the level coordinates are x and z; with z down y turns round."""
    found = pointed_at(GivenPlace(at=at), up=up)
    assert found.base_id == "table"
    assert found.point == pytest.approx([1.7, 0.7, 0.5], abs=1e-5)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (GivenPlace(at=(50.0, 0.0, 1.0)), "--at 50,0,1 is outside of the scene"),
        (GivenPlace(at=(50.0, 0.0)), "--at 50,0 is outside of the scene"),
        (GivenPlace(at=(0.0, 0.0, -4.0)), "is under the floor"),
        (GivenPlace(at=(0.0, 0.0, 9.0)), "is above the scene"),
        (GivenPlace(at=(0.0, 3.05, 1.0)), "is inside of wall"),
        (GivenPlace(at=(-2.0, 3.05)), "there is no upward surface"),
        (GivenPlace(support=(40.0, 0.0, 0.0, 41.0, 1.0, 1.0)), "--support 40,0,0,41,1,1 contains nothing"),
        (GivenPlace(support=(1.5, 0.5, 0.1, 2.5, 1.5, 0.3)), "no upward surface"),
    ],
)
def test_a_place_that_carries_nothing_is_one_line(place: GivenPlace, words: str) -> None:
    """With the value, the scene's bounds in the file's frame and what to give instead."""
    with pytest.raises(InputError) as caught:
        pointed_at(place)
    said = str(caught.value)
    assert words in said
    assert "x -3 to 3, y -3 to 3.1, z -0.1 to 2.5" in said
    assert "give" in said
    assert "\n" not in said


def test_the_object_goes_to_the_point() -> None:
    """Over it, on the part there; words for another place are told, and no support need be named."""
    _, meant, spot = placed(GivenPlace(at=(1.75, 0.8, 0.5)), "put the block at the right edge of the table")
    assert (meant.base_id, spot.part) == ("table", "top")
    assert spot.world_from_object[:2, 3] == pytest.approx([1.75, 0.8], abs=0.02)
    assert spot.region == "at the point"
    assert any("right edge" in note and "--at determines" in note for note in meant.notes)
    _, meant, spot = placed(GivenPlace(at=(-2.0, -2.0, 0.0)), "put it there")
    assert (meant.base_id, spot.part) == ("floor", "floor")


def test_a_thing_that_was_only_guessed_is_called_as_the_sentence_does() -> None:
    """It then has such a thing's parts; where the label is sure the sentence does not change it."""
    room, meant, _ = placed(GivenPlace(at=(1.75, 0.8, 0.5)), "put the block on the table", unsure(ROOM, "table"))
    assert meant.base_label == "table"
    assert room.instances[room.index_of("table")].label == "table"


def fused() -> Segmentation:
    """A room in one piece: floor, wall and a low platform are one thing that nobody could name."""
    steps = [
        block((-2, -2, -0.1), (2, 2, 0)), block((-2, 1.9, 0), (2, 2, 2.4)), block((-1, 1, 0), (0.6, 1.9, 0.4)),
    ]  # fmt: skip
    room = segmentation({"thing": ("thing", None, [("body", Mesh.concatenate(steps))])})
    return unsure(room, "thing")


def test_a_surface_of_a_fused_scan_becomes_a_thing_of_its_own() -> None:
    """Under the sentence's name, with what is below it and nothing of the wall."""
    room, meant, spot = placed(GivenPlace(at=(-0.2, 1.4, 0.4)), "put the block on the sofa", fused())
    base = room.instances[room.index_of(meant.base_id)]
    assert (base.label, spot.part) == ("sofa", "seat cushion")
    assert base.box.top == pytest.approx(0.4, abs=1e-6)
    assert 2 * base.box.half_extents[:2] == pytest.approx([1.6, 0.9], abs=1e-6)


def test_a_box_makes_a_thing_of_its_faces() -> None:
    """The sentence may say where on it; its name is the sentence's, and the old thing keeps the rest."""
    box = GivenPlace(support=(-1.1, 0.9, 0.1, 0.7, 1.89, 0.5))
    room, meant, spot = placed(box, "put the block on the left side of the sofa", fused())
    base = room.instances[room.index_of(meant.base_id)]
    assert base.label == "sofa"
    assert (room.face_instance == room.index_of("thing")).sum() > 0
    assert spot.surface_point[2] == pytest.approx(0.4, abs=1e-5)
    assert meant.region.names == ("left",)


def test_a_box_around_a_thing_means_the_thing() -> None:
    """It keeps its parts, whatever else of it the box leaves out by a rim; a box over floor alone is floor."""
    found = pointed_at(GivenPlace(support=(1.5, 0.5, -0.05, 2.5, 1.5, 0.505)), "put it there")
    assert (found.base_id, len(found.cut), found.renamed) == ("table", 0, False)
    room, meant, _ = placed(GivenPlace(support=(-3.1, -3.1, -0.2, 3.1, 3.05, 0.05)), "put it there")
    assert meant.base_label == "floor"
    assert room.instances[room.index_of(meant.base_id)].structure
