"""The language stages on meshes that nobody of this project made; skipped where $DCAP_SAMPLE_DATA is not set."""

import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dcap.geometry.raycast import Raycaster
from dcap.language.offline.client import OfflineClient
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig, intent
from tasks.mesh.stage import cleaned
from tasks.rotation.stage import RotationConfig, rotation
from tasks.segment.stage import SegmentConfig, segment, segment_object

FOLDER = Path(os.environ.get("DCAP_SAMPLE_DATA") or "nowhere")
pytestmark = [
    pytest.mark.third_party,
    pytest.mark.slow,
    pytest.mark.skipif(not FOLDER.is_dir(), reason="$DCAP_SAMPLE_DATA names no folder"),
]
MUG, KOALA = "obj_mug_ycb/textured.obj", "obj_plush_koala/koala_low_resolution.obj"
BALL, SHOE = "obj_ball_soccer_ycb/textured.obj", "obj_shoe_black_gso/black_shoe_with_green_stripes.obj"
BED, TABLE = "sup_bed_kaykit/bed_double_A.gltf", "sup_table_polyhaven/wooden_table_02_1k.gltf"
SOFA = "sup_couch_kaykit/couch.gltf"


@cache
def read(name: str, label: str, role: Role) -> Segmentation:
    scan = cleaned(read_scan(FOLDER / name, SourceOptions(label=label), role))
    return (segment if role is Role.SCENE else segment_object)(scan, SegmentConfig(), OfflineClient())


@pytest.mark.parametrize(
    ("support", "label", "item", "prompt", "part"),
    [
        (TABLE, "table", MUG, "put the mug upside down near the edge of the table", "top"),
        (BED, "bed", KOALA, "put the koala on the bed facing the pillows", "mattress"),
        (SOFA, "sofa", BALL, "put the ball on the left arm of the sofa", "arm"),
        pytest.param(
            "room_myroom_mit/bed.glb", "", KOALA, "put the koala on the bed", "mattress", marks=pytest.mark.long
        ),
    ],
)
def test_object_starts_one_centimetre_over_the_asked_part(support, label, item, prompt, part):
    """The part is the asked or usual one, and no vertex of the object is nearer than 1 cm to what lies below."""
    scene, thing = read(support, label, Role.SCENE), read(item, "", Role.OBJECT)
    meant = intent(SegmentedScene(scene), SegmentedObject(thing), prompt, None, IntentConfig(), OfflineClient())
    assert isinstance(meant, Intent)
    turned = rotation(
        SegmentedScene(scene), SegmentedObject(thing), meant, prompt, RotationConfig(picture_size=64), OfflineClient()
    )
    assert isinstance(turned, Rotation)
    found = anchor(
        SegmentedScene(scene), SegmentedObject(thing), meant, turned, prompt, AnchorConfig(), OfflineClient()
    )
    assert isinstance(found, Anchor)
    assert found.part == part
    points = thing.mesh.transformed(found.world_from_object).vertices
    gap = Raycaster(scene.mesh).cast(points, np.tile([0.0, 0.0, -1.0], (len(points), 1))).distance.min()
    assert gap == pytest.approx(0.01, abs=1e-3)  # the nearest pair may be a vertex of the scene: a little more here
