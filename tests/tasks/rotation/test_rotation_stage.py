"""Three pictures and one rotation: where up and front come to point for what the words say."""

import numpy as np
import pytest
from box_rooms import ROOM, block, book, mug, thing, toy
from scipy.spatial.transform import Rotation as Turn
from stage_chain import Asked, Stages, turned, with_each

from dcap.language.protocol.client import ClientName
from dcap.scene.types.choices import Rotation
from dcap.scene.types.mesh import Mesh

OFFLINE = Stages()
LYING = [Turn.from_euler("xy", angles, degrees=True).as_matrix() for angles in ((90, 0), (-90, 0), (0, 90))]
"""Own axes to those of files that have a thing on its front, its back, its side."""


def sitter() -> Mesh:
    """A figure on a broad foot, which shows on which side it stands; it looks along -y."""
    return Mesh.concatenate(
        [block((-0.15, -0.2, 0.0), (0.15, 0.1, 0.08)), block((-0.07, -0.02, 0.08), (0.07, 0.08, 0.3))]
    )


def test_three_pictures_and_a_rotation(stages):
    """Exactly three different pictures of the asked size where a model looks, none else; one orthonormal matrix."""
    turned = stages.oriented("put the mug on the bed", thing("mug", mug()))
    if stages.client is ClientName.OFFLINE:
        assert turned.pictures == ()
    else:
        assert [p.shape for p in turned.pictures] == [(64, 64, 3)] * 3
        assert not np.array_equal(turned.pictures[0], turned.pictures[2])
    assert np.allclose(turned.matrix @ turned.matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned.matrix) == pytest.approx(1.0)


def up_of(turned: Rotation) -> np.ndarray:
    return turned.matrix[:, 2]


@pytest.mark.parametrize(
    ("stages", "words", "vertical"),
    with_each(
        [("", 1), ("upright", 1), ("upside down", -1), ("on its side", 0), ("lying down", 0), ("standing", 1)],
        "upside down",
    ),
    indirect=["stages"],
)
def test_words_turn_the_mug(stages, words, vertical):
    """The mug's own axis points up, down or sideways as the words say (15 degrees)."""
    turned = stages.oriented(f"put the mug {words} on the bed", thing("mug", mug()))
    assert up_of(turned)[2] == pytest.approx(vertical, abs=np.sin(np.radians(15)))


@pytest.mark.parametrize(
    ("words", "height"), [("", 0.03), ("lying flat", 0.03), ("standing", 0.23), ("on its side", 0.16)]
)
def test_words_turn_the_book(words, height):
    """A book lies on its largest face unless told otherwise, however its file has it."""
    upright = book().transformed(np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]], dtype=float))
    for mesh in (book(), upright):
        turned = OFFLINE.oriented(f"put the book {words} on the bed", thing("book", mesh))
        assert np.ptp(mesh.vertices @ turned.matrix.T, axis=0)[2] == pytest.approx(height, abs=1e-3)


@pytest.mark.parametrize(("words", "height"), [("on its back", -1), ("down", 0), ("on its left side", 0)])
def test_the_back_of_what_has_four_legs_is_its_top(words, height):
    """Its own up points down on its back; lying it is on a side, as a dog sleeps."""
    legs = (block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.14)) for x in (-0.05, 0.05) for y in (-0.1, 0.1))
    head, body = block((-0.05, -0.25, 0.2), (0.05, -0.16, 0.3)), block((-0.08, -0.16, 0.14), (0.08, 0.16, 0.28))
    turned = OFFLINE.oriented(
        f"lay the teddy {words} on the bed", thing("teddy", Mesh.concatenate([body, head, *legs]))
    )
    assert up_of(turned)[2] == pytest.approx(height, abs=np.sin(np.radians(15)))


@pytest.mark.parametrize(("words", "down"), [("on its left side", (1, 0, 0)), ("on its right side", (-1, 0, 0))])
def test_hands_are_those_of_the_toy(words, down):
    """The toy looks along -y, so its left is +x: that side points down (15 degrees)."""
    turned = OFFLINE.oriented(f"lay the teddy {words} on the bed", thing("teddy", toy()))
    assert (turned.matrix @ down)[2] == pytest.approx(-1.0, abs=1 - np.cos(np.radians(15)))


@pytest.mark.parametrize(
    ("stages", "words", "direction"),
    with_each(
        [
            ("facing the pillows", (0, 1)),
            ("facing the wall", (0, 1)),
            ("facing away from the wall", (0, -1)),
            ("facing me", (0, -1)),
            ("facing left", (-1, 0)),
            ("", (0, -1)),
            ("rotated by 90 degrees clockwise", (-1, 0)),
            ("facing the wall, turned 90 degrees to the left", (-1, 0)),
            ("turned around", (0, 1)),
        ],
        "facing the pillows",
        "facing left",
    ),
    indirect=["stages"],
)
def test_front_looks_where_the_words_say(stages, words, direction):
    """The toy's front, -y in its mesh, points there; without words to the bed's front (15 degrees)."""
    turned = stages.oriented(f"put the teddy on the bed {words}", thing("teddy", toy()))
    ahead = turned.matrix @ (0.0, -1.0, 0.0)
    assert float(ahead[:2] @ direction) > np.cos(np.radians(15))


@pytest.mark.parametrize("words", ["", "facing the pillows"])
@pytest.mark.parametrize("file_from_own", LYING)
def test_what_lies_looks_along_its_own_axis_however_its_file_has_it(file_from_own, words):
    """On its back it looks along its own up: the head, to the head end or where it is told, both of which are +y."""
    pose = np.eye(4)
    pose[:3, :3] = file_from_own
    item = thing("teddy", sitter().transformed(pose))
    own = OFFLINE.oriented(f"lay the teddy on its back on the bed {words}", item).matrix @ file_from_own
    assert own @ (0.0, -1.0, 0.0) == pytest.approx(np.array([0.0, 0.0, 1.0]), abs=1e-9)
    assert own @ (0.0, 0.0, 1.0) == pytest.approx(np.array([0.0, 1.0, 0.0]), abs=1e-9)


def test_stable_poses_have_the_front_of_the_frame_that_is_believed():
    """The toy's shape hardly speaks for another side than its file's, which is believed: on its back is its own back,
    not that of the frame in which it would lie, and every stable pose says where the file's front and up point."""
    asked = Asked()
    found = turned("lay the teddy on its back on the bed", thing("teddy", toy()), ROOM, asked)[1]
    request = asked.requests[-1]
    stable = [pose for pose in request.poses if pose.id.startswith("stable")]
    assert any(pose.id == "righted" for pose in request.poses)
    assert stable
    for pose in stable:
        assert np.array(pose.rotation) @ (0.0, -1.0, 0.0) == pytest.approx(np.array(pose.front), abs=1e-5)
        assert np.array(pose.rotation)[:, 2] == pytest.approx(np.array(pose.up), abs=1e-5)
    assert (found.matrix @ (0.0, -1.0, 0.0))[2] == pytest.approx(1.0, abs=1e-5)
