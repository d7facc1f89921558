"""What the question of the anchor tells a client, in rooms of boxes."""

import numpy as np
import pytest
import trimesh
from fake_api import data_of

from dcap.language.connect import connect
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.request import anchor_request
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.rotation.stage import RotationConfig, rotation

Corners = tuple[tuple[float, float, float], tuple[float, float, float]]
RED, GREEN, GREY = (220, 30, 30), (30, 200, 30), (150, 150, 150)
SENTENCE = "put the box on the table next to the lamp"


def room(*things: tuple[str, str, Corners, tuple[int, int, int]]) -> Segmentation:
    """Instances of one part each, all looking along -x: id, label, corners and colour."""
    instances, meshes, owner = [], [], []
    for number, (name, label, (low, high), color) in enumerate(things):
        shape = trimesh.creation.box(bounds=[low, high])
        meshes.append(Mesh(shape.vertices, shape.faces, np.tile(np.array(color, np.uint8), (8, 1))))
        half = (np.array(high) - low) / 2
        box = OrientedBox(np.array(low) + half, np.eye(3), half)
        part = Part("top" if label == "table" else "body", box, 1.0)
        instances.append(Instance(name, label, box, (part,), np.array([-1.0, 0.0, 0.0]), label == "floor"))
        owner += [number] * len(shape.faces)
    index = np.array(owner, np.int32)
    return Segmentation(Mesh.concatenate(meshes), tuple(instances), index, np.zeros_like(index))


ROOM = room(
    ("table", "table", ((0.0, 0.0, 0.7), (1.0, 2.0, 0.75)), GREY),
    ("red", "lamp", ((0.1, 0.2, 0.75), (0.3, 0.5, 1.05)), RED),
    ("green", "box", ((0.7, 1.6, 0.75), (0.9, 1.8, 0.85)), GREEN),
    ("far", "box", ((3.0, 0.0, 0.0), (3.5, 0.5, 0.5)), GREY),
    ("floor", "floor", ((-2.0, -2.0, -0.1), (4.0, 4.0, 0.0)), GREY),
)
ITEM = room(("object", "box", ((0.0, 0.0, 0.0), (0.1, 0.1, 0.1)), GREY))


def asked(prompt: str) -> Intent:
    found = intent(SegmentedScene(ROOM), SegmentedObject(ITEM), prompt, None, IntentConfig(), OfflineClient())
    assert isinstance(found, Intent)
    return found


def test_sentence_and_boxes_are_in_the_question():
    """The lamp is given as the viewer sees it, who stands at -x: his right is -y, his side is -x."""
    request = anchor_request(ROOM, ROOM.instances[0], asked(SENTENCE), SENTENCE, ITEM.mesh)
    assert request.prompt == SENTENCE
    lamp = request.references[0]
    assert (lamp.id, lamp.label, len(request.references)) == ("red", "lamp", 1)
    # its middle (0.2, 0.35, 0.9) less the table's (0.5, 1.0, 0.725), turned
    assert lamp.center == pytest.approx((0.65, 0.3, 0.175))
    assert lamp.size == pytest.approx((0.3, 0.2, 0.3))
    assert {one.id for one in request.neighbours} == {"red", "green"}
    top = request.part_boxes[request.parts[0].index]
    assert (top.id, top.label) == ("0", "top")
    assert top.size == pytest.approx((2.0, 1.0, 0.05))


def test_model_is_told_the_sentence_and_chooses_as_the_offline_reader_does(api):
    """The stage hands the whole sentence and one picture over; the same choice gives the same start."""
    meant = asked(SENTENCE)
    turned = rotation(
        SegmentedScene(ROOM), SegmentedObject(ITEM), meant, SENTENCE, RotationConfig(picture_size=64), OfflineClient()
    )
    assert isinstance(turned, Rotation)
    model = connect(LanguageConfig(client=ClientName.ANTHROPIC), Session())
    found = anchor(SegmentedScene(ROOM), SegmentedObject(ITEM), meant, turned, SENTENCE, AnchorConfig(), model)
    alone = anchor(
        SegmentedScene(ROOM), SegmentedObject(ITEM), meant, turned, SENTENCE, AnchorConfig(), OfflineClient()
    )
    assert isinstance(found, Anchor)
    assert isinstance(alone, Anchor)
    assert np.array_equal(found.world_from_object, alone.world_from_object)
    (body,) = api.asked
    assert data_of(body)["prompt"] == SENTENCE
    assert [block["type"] for block in body["messages"][0]["content"]] == ["text", "image", "text"]
