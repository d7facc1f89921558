"""Sizes and masses that the stage makes of an answer."""

import numpy as np
import pytest
import trimesh
from box_rooms import segmentation

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import MOST_STATES, IntentReply
from dcap.language.protocol.requests import IntentRequest, vector
from dcap.scene.types.choices import Intent
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.intent.stage import IntentConfig, intent, mass_of
from tasks.requests.views import instance_views, object_view, room_center


def block(label: str, *size: float) -> Segmentation:
    """A block of one part."""
    mesh = trimesh.creation.box(size)
    return segmentation({label: (label, None, [("top", Mesh.of(mesh.vertices, mesh.faces))])})


TABLE = block("table", 1.2, 0.8, 0.04)


def asked(item: Segmentation) -> Intent:
    prompt = f"put the {item.instances[0].label} on the table"
    found = intent(SegmentedScene(TABLE), SegmentedObject(item), prompt, None, IntentConfig(), OfflineClient())
    assert isinstance(found, Intent)
    return found


@pytest.mark.parametrize("unit", [1.0, 0.01, 0.001])
@pytest.mark.parametrize("thickness", [0.001, 0.006, 0.012])
def test_a_spread_towel_weighs_what_it_weighs_folded(thickness, unit):
    """It is compared with the spread size, whatever its unit, and its weight goes with its area: meshes of cloth have
    any thickness."""
    folded = asked(block("bath towel", 0.28, 0.35, 0.06))
    spread = asked(block("bath towel", 0.72 / unit, 1.38 / unit, thickness / unit))
    assert (folded.scale, spread.scale) == (1.0, unit)
    assert folded.size.tolist() == [0.35, 0.28, 0.06]
    assert spread.size.tolist() == [1.38, 0.72, 0.006]
    assert spread.mass == pytest.approx(folded.mass, rel=1e-9)


def answered(**changes: object) -> tuple[IntentReply, IntentRequest]:
    """A good answer with something changed, and its question."""
    item = block("towel", 0.3, 0.24, 0.05)
    request = IntentRequest("put it on the table", object_view(item), instance_views(TABLE), vector(room_center(TABLE)))
    good = OfflineClient().ask(INTENT, request)
    assert len(good.alternative_sizes) == 1
    return IntentReply.model_validate(good.model_dump() | changes), request


@pytest.mark.parametrize(
    ("sizes", "words"),
    [([(30.0, 1.0, 1.0)], "20 m"), ([(0.3, 0.2, 0.1)] * (MOST_STATES + 1), "entries")],
)
def test_absurd_alternative_sizes_are_no_answer(sizes, words):
    """Each is held to the limits of the size itself, and there are few."""
    reply, request = answered(alternative_sizes=sizes)
    with pytest.raises(ValueError, match=words):
        reply.check(request)


@pytest.mark.parametrize(
    ("ratio", "factor", "words"),
    [
        (1.1, 1.1**3, ""),
        (3.0, 5.0, ", clamped from 27 (mass_factor 5)"),
        (0.5, 0.2, ", clamped from 0.125 (mass_factor 5)"),
    ],
)
def test_a_clamped_mass_says_so(ratio, factor, words):
    """The note names the clamp and the factor that the size alone would give."""
    reply, _ = answered(size=(0.3, 0.2, 0.1), alternative_sizes=(), hollow=False, mass=2.0)
    usual = np.array(reply.size)
    weight, note = mass_of(reply, usual, ratio * usual, None, IntentConfig())
    assert weight == pytest.approx(2.0 * factor)
    assert f"with the volume by {factor:.3g}{words}" in note
    assert ("--mass" in note) == bool(words)
