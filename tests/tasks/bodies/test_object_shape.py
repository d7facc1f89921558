"""The object as one solid at its size in the scene; what cannot be closed is refused with its holes and a picture."""

import numpy as np
import pytest
from box_rooms import segmentation
from torn import ball, fine_box, middles, normals, where

from dcap.geometry.pieces import is_closed
from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import OpenObject, Reason
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.bodies.object_shape import ObjectShape, OpenShape, object_shape, refused
from tasks.overview import OverviewConfig, overview

SCALE = 0.5
ROOM = segmentation({"table": ("table", None, [("top", fine_box((-1, -1, 0), (1, 1, 0.5), 1))])})


def item(mesh: Mesh) -> Segmentation:
    """An object of one part."""
    return segmentation({"object": ("thing", None, [("body", mesh)])})


def named(name: str) -> Intent:
    """An intent about such a thing."""
    return Intent("table", "table", name, np.full(3, 0.2), 1.0, False, SCALE, OrientationRequest("any", "", ""),
                  RegionRequest("", ("center",), (), ""), (), ())  # fmt: skip


def anchor() -> Anchor:
    """On the table, at half the size of its file."""
    pose = np.diag([SCALE, SCALE, SCALE, 1.0])
    pose[:3, 3] = 0.0, 0.0, 0.7
    return Anchor("table", "top", 0, "center", np.zeros(2), np.array([0, 0, 0.5]), pose, 0.01, np.zeros((4, 2)), "test")


def test_a_sound_object_stays_as_it_is():
    """The very same, with nothing to tell."""
    given = item(ball())
    found = object_shape(given, named("ball"), anchor())
    assert isinstance(found, ObjectShape)
    assert found.item is given
    assert not found.report.problem
    assert not found.notes


def test_a_pillow_without_underside_gets_one():
    """A flat dome: in its own frame it is closed, where it was, and its underside belongs to its part; the note tells
    the size of the hole in the scene, half of the file's 20 cm."""
    dome = ball().vertices * (1.0, 1.0, 0.4)
    pillow = where(Mesh.of(dome, ball().faces), middles(ball())[:, 2] > 0.0)
    found = object_shape(item(pillow), named("pillow"), anchor())
    assert isinstance(found, ObjectShape)
    assert is_closed(found.item.mesh)
    assert found.item.mesh.bounds == pytest.approx(pillow.bounds, abs=1e-9)
    assert set(found.item.face_part.tolist()) == {0}
    assert not found.report.problem
    assert any("10 x 10 cm below, closed from the rim" in note for note in found.notes)


def test_a_cup_keeps_its_hollow_and_a_block_does_not():
    """The same skin without a lid: what it is called decides."""
    block = fine_box((-0.04, -0.04, 0.0), (0.04, 0.04, 0.1), 4)
    skin = where(block, normals(block)[:, 2] < 0.5)
    inside = np.array([[0.0, 0.0, 0.7 + SCALE * 0.05]])
    cup, full = (object_shape(item(skin), named(name), anchor()) for name in ("cup", "brick"))
    assert isinstance(cup, ObjectShape)
    assert isinstance(full, ObjectShape)
    assert not cup.solid.inside(inside)[0]
    assert full.solid.inside(inside)[0]


def test_strips_are_refused_with_sizes_places_and_a_picture():
    """Size and middle of the largest hole are those at the pose before the drop; its rim is red in the picture."""
    strips = where(ball(), np.floor((middles(ball())[:, 2] + 0.1) / 0.02) % 3 == 0)
    found = object_shape(item(strips), named("ball"), anchor())
    assert isinstance(found, OpenShape)
    outcome = refused(found, "ball")
    assert outcome.reason is Reason.OBJECT_NOT_SOLID
    assert isinstance(outcome.evidence, OpenObject)
    assert outcome.evidence.holes[0].size_m == pytest.approx((0.1, 0.1), abs=0.01)
    assert np.linalg.norm(np.array(outcome.evidence.holes[0].middle_m) - (0, 0, 0.7)) < 0.05
    shown = overview(
        SegmentedScene(ROOM), SegmentedObject(item(strips)), named("ball"), anchor(), OverviewConfig(size=96)
    )
    assert shown.hole is not None
    red = (shown.hole[..., 0] > 180) & (shown.hole[..., 1] < 90) & (shown.hole[..., 2] < 90)
    assert red.sum() > 50
    filled = overview(
        SegmentedScene(ROOM), SegmentedObject(item(strips)), named("ball"), anchor(), OverviewConfig(size=96), True
    )
    assert filled.hole is None
    whole = overview(
        SegmentedScene(ROOM), SegmentedObject(item(ball())), named("ball"), anchor(), OverviewConfig(size=96)
    )
    assert whole.hole is None
