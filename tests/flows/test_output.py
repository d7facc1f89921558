"""What placement.json says of a result."""

import numpy as np
import pytest

from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from flows.placement_json import Values, base_of

BOX = OrientedBox(np.zeros(3), np.eye(3), np.ones(3))
SCENE = Segmentation(
    Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))),
    (
        Instance("1", "floor", BOX, (Part("floor", BOX, 1.0),), None, True),
        Instance("2", "rug", BOX, (Part("body", BOX, 1.0),), None, False),
    ),
    np.zeros(0, np.int32),
    np.zeros(0, np.int32),
)
ON_THE_FLOOR = Intent(
    "1", "floor", "ball", np.ones(3), 0.4, False, 1.0, OrientationRequest("any", "", ""), RegionRequest("", (), (), ""),
    (), (),
)  # fmt: skip


def hit(base_id: str, part: str) -> Anchor:
    return Anchor(base_id, part, 0, "under", np.zeros(2), np.zeros(3), np.eye(4), 0.01, np.zeros((4, 2)), "")


@pytest.mark.parametrize(
    ("intent", "anchor", "base"),
    [
        (ON_THE_FLOOR, hit("2", "body"), {"id": "2", "label": "rug"}),
        (ON_THE_FLOOR, hit("1", "floor"), {"id": "1", "label": "floor"}),
        (ON_THE_FLOOR, None, {"id": "1", "label": "floor"}),
        (None, None, None),
    ],
)
def test_base_is_what_carries_the_object(intent, anchor, base):
    """The instance that the anchor hit, which a rug may be where the floor was asked for; without one the asked."""
    values = Values(None, None, SCENE, None, intent, anchor, None, None, None, None, None)
    assert base_of(values) == base
