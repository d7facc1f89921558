"""What was asked as a direction of the mesh, and whether its shape tells it."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import block, mug, thing, toy
from stage_chain import Stages

from dcap.geometry.placement.poses import about_z
from dcap.language.protocol.replies import RotationReply
from dcap.language.protocol.requests import FacingView, PoseView, RotationRequest
from dcap.scene.types.choices import AskedPose
from dcap.scene.types.mesh import Mesh
from tasks.rotation.requested_pose import CLEAR, requested_pose

OFFLINE = Stages()
SIDEWAYS = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float)
"""What was up in the mesh looks along -y."""


def seated(righting: float) -> RotationRequest:
    """A teddy that shall sit, whose shape speaks for another side than its file."""
    rows = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    poses = [PoseView(name, rows, 0.3, rows[2], (0.0, -1.0, 0.0), (0.2, 0.2, 0.3)) for name in ("upright", "righted")]
    return RotationRequest("p", "teddy", "seated", "", tuple(poses), (), 1, has_front=True, righting=righting)


def pose_of(sentence: str, name: str, mesh: Mesh) -> AskedPose:
    """What a sentence asks."""
    found = OFFLINE.oriented(sentence, thing(name, mesh)).pose
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("words", "axis", "angle"),
    [("sit the teddy", (0, 0, 1), 0.0), ("put the teddy upside down", (0, 0, 1), np.pi),
     ("lay the teddy on its back", (0, -1, 0), 0.0), ("lay the teddy on its left side", (1, 0, 0), np.pi)],
)  # fmt: skip
def test_the_direction_is_the_toys_own(words, axis, angle):
    """It looks along -y and stands along +z: seated that is up, on its back its front is."""
    found = pose_of(f"{words} on the bed", "teddy", toy())
    assert found.axis == pytest.approx(np.array(axis, dtype=float), abs=0.1)
    assert found.from_vertical == pytest.approx(angle)


def test_what_is_righted_is_up_as_it_is_righted():
    """A mug that lies in its file: up is along its own axis, not the file's z. Which end is up a full one does not
    tell."""
    found = pose_of("stand the mug upright on the bed", "mug", mug().transformed(SIDEWAYS))
    assert abs(found.up[1]) > 0.99
    assert "which way is up" in found.doubt


@pytest.mark.parametrize(("lead", "doubted"), [(0.05, True), (0.5, False)])
def test_an_up_that_the_shape_hardly_tells_is_a_doubt(lead, doubted):
    """Righted on weak evidence: nobody would know from the row alone. As it is in its file nothing was guessed."""
    for name, righting in (("righted", 0.4), ("upright", 0.0)):
        found = requested_pose(seated(righting), RotationReply(pose_id=name), np.eye(3), toy(), lead)
        assert found is not None
        assert bool(found.doubt) == (doubted and name == "righted")


@pytest.mark.parametrize(("name", "doubted"), [("teddy", True), ("gorilla", True), ("stool", False)])
def test_a_figure_on_legs_does_not_sit(name, doubted):
    """It stands, whatever was asked; what is no figure is just set down. A teddy with its seat on the ground does."""
    on_legs = Mesh.concatenate(
        [block((-0.08, -0.16, 0.14), (0.08, 0.16, 0.28)),
         *(block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.14)) for x in (-0.05, 0.05) for y in (-0.12, 0.12))]
    )  # fmt: skip
    assert ("no seat" in pose_of(f"sit the {name} on the bed", name, on_legs).doubt) == doubted
    assert not pose_of("sit the teddy on the bed", "teddy", toy()).doubt
    assert "no seat" not in pose_of("stand the teddy upright on the bed", "teddy", on_legs).doubt


def test_a_wrong_choice_does_not_change_what_was_asked():
    """It shall look along +x: chosen so or facing away from it, what is asked is the same; a turn goes on from there,
    and one that the reply leaves out is missed."""
    view = FacingView("door_0", (1.0, 0.0, 0.0))
    request = replace(seated(0.0), facing="door_0", facings=(view,))
    for angle in (0.0, 90.0, -90.0):
        chosen, reply = about_z(np.radians(angle)), RotationReply(pose_id="upright", facing_id="aligned")
        found = requested_pose(request, reply, chosen, toy(), 0.5)
        turned = requested_pose(replace(request, facing="", turn_deg=90.0), reply, chosen, toy(), 0.5)
        assert found is not None
        assert found.looks == pytest.approx(np.array([0.0, -1.0, 0.0]))
        assert found.ahead == pytest.approx(np.array([1.0, 0.0, 0.0]))
        assert turned is not None
        assert turned.looks is not None
        assert turned.ahead == pytest.approx(about_z(0.5 * np.pi) @ chosen @ turned.looks)


@pytest.mark.parametrize(("righting", "doubted"), [(0.01, False), (CLEAR, False), (0.3, True)])
def test_a_file_that_is_believed_is_doubted_only_where_its_shape_clearly_speaks_for_another_side(righting, doubted):
    """By more than what makes a righted shape clear; a little more for another side is no doubt."""
    found = requested_pose(seated(righting), RotationReply(pose_id="upright"), np.eye(3), toy(), 0.5)
    assert found is not None
    assert bool(found.doubt) == doubted
