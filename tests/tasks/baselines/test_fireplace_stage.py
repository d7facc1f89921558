"""FirePlace* in rooms made of boxes: it finds the support and the place, touches, and cuts through nothing."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import CUBE, HALL, ROOM, ball, block, thing, toy
from stage_chain import Stages

from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.raycast import Raycaster
from dcap.language.connect import Client
from dcap.language.offline.client import OfflineClient
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.baselines.fireplace import FirePlaceConfig, fireplace

OFFLINE = Stages()
FEW = FirePlaceConfig(placements=5, picture_size=32)
RAISED = np.array([0.0, 0.0, 0.02])


def shared(prompt: str, item: Segmentation, room: Segmentation) -> Intent:
    """The intent, spoilt in all that methods do not share."""
    found = OFFLINE.meant(prompt, item, room)
    assert isinstance(found, Intent), found
    return replace(found, base_id="none", base_label="none", candidates=())


def placed(
    prompt: str, item: Segmentation, room: Segmentation = ROOM, client: Client | None = None
) -> Anchor | Infeasible:  # fmt: skip
    """What the method proposes."""
    intent = shared(prompt, item, room)
    return fireplace(SegmentedScene(room), SegmentedObject(item), intent, prompt, FEW, client or OfflineClient())


def found(prompt: str, item: Segmentation, room: Segmentation = ROOM) -> tuple[Anchor, Mesh]:
    """The placement and the object there."""
    anchor = placed(prompt, item, room)
    assert isinstance(anchor, Anchor), anchor
    return anchor, item.mesh.transformed(anchor.world_from_object)


def gap(room: Segmentation, mesh: Mesh) -> float:
    """Smallest vertical distance between object and scene, negative where they cut through each other [m]."""
    exact = Clearance(mesh, room.mesh, Raycaster(room.mesh))
    return exact.gap(RAISED) - float(RAISED[2])


@pytest.mark.parametrize(
    ("prompt", "base", "part", "low", "high"),
    [
        ("put the ball at the center of the bed", "bed", "mattress", (-0.2, -0.4, 0.5), (0.2, 0.3, 0.7)),
        ("put the ball on the left side of the bed", "bed", "mattress", (-0.75, -0.95, 0.5), (0.0, 0.95, 0.7)),
        ("put the ball on the foot of the bed", "bed", "mattress", (-0.75, -0.95, 0.5), (0.75, -0.4, 0.7)),
        ("put the ball on the left pillow of the bed", "bed", "pillow", (-0.65, 0.5, 0.62), (-0.05, 0.9, 0.82)),
        ("put the ball on the floor", "floor", "floor", (-3.0, -3.0, 0.0), (3.0, 3.0, 0.2)),
    ],
)
def test_the_ball_touches_what_is_asked_where_it_is_asked(
    prompt: str, base: str, part: str, low: tuple[float, ...], high: tuple[float, ...]
) -> None:
    """Its bounds lie within those of the region, and its lowest point is on the surface."""
    anchor, mesh = found(prompt, thing("ball", ball()))
    assert (anchor.base_id, anchor.part) == (base, part)
    assert (mesh.bounds[0] >= np.array(low) - 0.012).all()
    assert (mesh.bounds[1] <= np.array(high) + 0.012).all()
    assert gap(ROOM, mesh) == pytest.approx(0.0, abs=1e-4)


def test_what_is_in_the_way_is_avoided() -> None:
    """The lamp stands in the middle of the table: the cube is beside it, and upright on the top."""
    anchor, mesh = found("put the cube on the table", CUBE)
    assert anchor.part == "top"
    assert gap(ROOM, mesh) == pytest.approx(0.0, abs=1e-4)
    assert mesh.bounds[0, 2] == pytest.approx(0.5, abs=1e-4)
    exact = Clearance(mesh, ROOM.mesh, Raycaster(ROOM.mesh))
    assert len(exact.cuts(np.array([0.0, 0.0, 1e-3]))[0]) == 0


def test_the_front_looks_where_it_is_asked() -> None:
    """The toy, whose front is -y, looks at the pillows, which lie at the bed's +y end."""
    anchor, mesh = found("put the toy on the bed, facing the pillow", thing("toy", toy()))
    ahead = anchor.world_from_object[:3, :3] @ (0.0, -1.0, 0.0)
    to_pillows = np.array([0.0, 0.7]) - mesh.bounds.mean(axis=0)[:2]
    cosine = ahead[:2] @ to_pillows / np.linalg.norm(ahead[:2]) / np.linalg.norm(to_pillows)
    assert cosine > np.cos(np.radians(10.0))


def test_a_toy_upside_down_rests_on_its_top() -> None:
    """The words decide which of its surfaces is in contact."""
    anchor, mesh = found("put the toy upside down on the floor", thing("toy", toy()), HALL)
    assert anchor.world_from_object[:3, :3] @ (0.0, 0.0, 1.0) == pytest.approx((0, 0, -1), abs=1e-6)
    assert mesh.bounds[0, 2] == pytest.approx(0.0, abs=1e-4)


def test_what_is_larger_than_its_support_is_refused_with_numbers() -> None:
    """A wardrobe does not go on a chair of 0.4 x 0.4 m."""
    outcome = placed("put the wardrobe on the chair", thing("wardrobe", block((-1, -0.5, 0), (1, 0.5, 2))), HALL)
    assert isinstance(outcome, Infeasible)
    assert outcome.reason is Reason.TOO_LARGE_FOR_TARGET
    assert "on the chair" in outcome.message
    assert "\n" not in outcome.message


def test_what_the_scene_lacks_is_not_found() -> None:
    """The sentence is read by the method itself, whatever the intent says."""
    item = thing("ball", ball())
    intent = shared("put the ball on the bed", item, ROOM)
    outcome = fireplace(
        SegmentedScene(ROOM), SegmentedObject(item), intent, "put the ball on the piano", FEW, OfflineClient()
    )
    assert isinstance(outcome, Infeasible)
    assert outcome.reason is Reason.TARGET_NOT_FOUND
    assert "piano" in outcome.message


def test_every_client_can_answer(stages: Stages) -> None:
    """A model is shown pictures and letters, chooses in batches, and arrives at the same place as the rules."""
    item = thing("cube", CUBE.mesh)
    prompt = "put the cube on the bench"
    expected = placed(prompt, item, HALL)
    got = stages.answered(lambda client: placed(prompt, item, HALL, client))
    assert isinstance(expected, Anchor)
    assert isinstance(got, Anchor)
    assert got.world_from_object == pytest.approx(expected.world_from_object)
