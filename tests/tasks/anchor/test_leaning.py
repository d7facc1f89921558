"""What leans starts tilted against what holds it: close to it, its foot on the base, its middle beyond its edge."""

import numpy as np
import pytest
from box_rooms import CUBE, ROOM, block, segmentation, thing
from stage_chain import Stages

from dcap.geometry.placement.poses import center_of_mass
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.segmentation import Segmentation
from tasks.anchor.leaning import BEYOND, GAP, LEAST, MOST

OFFLINE = Stages()
BOARD = thing("board", block((-0.15, -0.01, 0.0), (0.15, 0.01, 0.4)))
PARLOUR = segmentation(
    {
        "floor": ("floor", None, [("floor", block((-2, -2, -0.1), (2, 2, 0.0)))]),
        "sofa": ("sofa", (0.0, -1.0, 0.0), [("seat cushion", block((-0.8, -0.4, 0.0), (0.8, 0.3, 0.4))),
                                            ("back", block((-0.8, 0.3, 0.0), (0.8, 0.45, 0.9)))]),
    }
)  # fmt: skip
THICK = thing("crate", block((-0.15, -0.06, 0.0), (0.15, 0.06, 0.4)))


def start(prompt: str, item: Segmentation, room: Segmentation = ROOM) -> tuple[Anchor, Mesh]:
    _, _, found = OFFLINE.placed(prompt, item, room)
    return found, item.mesh.transformed(found.world_from_object)


@pytest.mark.parametrize(
    ("prompt", "room", "face", "floor"),
    [
        ("lean the board against the wall", ROOM, 3.0, 0.0),
        ("prop the board up against the back of the sofa", PARLOUR, 0.3, 0.4),
        ("put the board on the sofa, leaning on its back", PARLOUR, 0.3, 0.4),
        ("put the board on the floor, leaning against the wall", ROOM, 3.0, 0.0),
    ],
)
def test_its_upper_edge_is_at_the_face_and_its_foot_on_the_base(
    prompt: str, room: Segmentation, face: float, floor: float
) -> None:
    """The faces look along -y: the largest y of the object is a gap from it, and belongs to its top; a gap below it is
    the base."""
    found, mesh = start(prompt, BOARD, room)
    assert found.lean is not None
    near = mesh.vertices[np.argmax(mesh.vertices[:, 1])]
    assert face - near[1] == pytest.approx(GAP, abs=1e-4)
    assert near[2] > mesh.vertices[:, 2].mean()
    assert mesh.bounds[0, 2] - floor == pytest.approx(GAP, abs=1e-4)


@pytest.mark.parametrize(("item", "least"), [(BOARD, LEAST), (THICK, np.arctan(0.06 / 0.2) + BEYOND)])
def test_the_tilt_follows_from_the_shape(item: Segmentation, least: float) -> None:
    """A thin thing is tilted by 12 degrees; a thick one until its middle is 4 degrees beyond its lower edge, which
    happens at the angle whose tangent is thickness over height."""
    found, mesh = start("lean it against the wall", item)
    assert found.lean is not None
    assert found.lean.angle == pytest.approx(least, abs=1e-6)
    assert found.lean.angle < MOST
    assert found.lean.axis == pytest.approx([0.0, np.sin(least), np.cos(least)], abs=1e-6)
    foot = mesh.vertices[np.argmin(mesh.vertices[:, 2])]
    assert center_of_mass(mesh)[1] > foot[1]


def test_the_thin_side_goes_along_the_wall() -> None:
    """A board that stands across in its file is turned to the wall."""
    across = thing("board", block((-0.01, -0.15, 0.0), (0.01, 0.15, 0.4)))
    _, mesh = start("lean the board against the wall", across)
    assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(0.3, abs=1e-6)


def test_what_stands_by_itself_is_set_upright_against_it_and_that_is_told() -> None:
    """A cube's middle would go beyond its edge at 45 degrees, where no friction holds it."""
    found, mesh = start("lean the cube against the wall", CUBE)
    assert found.lean is not None
    assert found.lean.angle == 0.0
    assert 3.0 - mesh.bounds[1, 1] == pytest.approx(GAP, abs=1e-4)
    assert "stands on its own" in found.notes[0]


def test_nothing_leans_on_what_is_lower_than_its_middle() -> None:
    """A board of 40 cm does not lean on a box of 10 cm."""
    room = segmentation(
        {
            "floor": ("floor", None, [("floor", block((-2, -2, -0.1), (2, 2, 0.0)))]),
            "box": ("box", None, [("body", block((-0.2, 0.5, 0.0), (0.2, 0.9, 0.1)))]),
        }
    )
    found = OFFLINE.tried("lean the board against the box", BOARD, room)
    assert isinstance(found, Infeasible)
    assert "middle would be above" in found.message
