"""Values between the stages: what is not of the promised shape, length or range is refused when it is made."""

from dataclasses import replace

import numpy as np
import pytest

from dcap.scene.errors import GeometryError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import (
    BackgroundGrid,
    DistanceGrid,
    InertialProperties,
    MaterialPoints,
    RigidSimulationBody,
)
from dcap.scene.types.scan import Room, Scan
from dcap.scene.types.segmentation import Instance, Part, Segmentation

MESH = Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 1]])
BOX = OrientedBox(np.zeros(3), np.eye(3), np.ones(3))
FACES = np.array([-1, 0], dtype=np.int32)
VALUES = {
    "box": BOX,
    "room": Room("bath", np.zeros((4, 2))),
    "scan": Scan(MESH, FACES, ("bed",), (), (), "", np.eye(4), "z", 1.0, "format", ()),
    "instance": Instance("a", "bed", BOX, (Part("top", BOX, 1.0),), None),
    "anchor": Anchor("a", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, np.zeros((4, 2)), ""),
    "distance": DistanceGrid(np.zeros(3), 0.01, np.zeros((2, 2, 2), np.float32)),
    "inertial": InertialProperties(1.0, np.zeros(3), np.eye(3)),
    "points": MaterialPoints(np.zeros((2, 3)), *(np.ones(2),) * 4),
    "grid": BackgroundGrid(*(np.array([0.0, 1.0]),) * 3, np.zeros((2, 2, 2), np.int8)),
    "body": RigidSimulationBody(
        name="object", instance="object", fixed=False, surface=MESH,
        distance=DistanceGrid(np.zeros(3), 0.01, np.zeros((2, 2, 2), np.float32)),
        inertial=InertialProperties(1.0, np.zeros(3), np.eye(3)), friction=ContactFriction(0.5, 0.4, 0.0),
    ),
}  # fmt: skip
VALUES["segmentation"] = Segmentation(MESH, (VALUES["instance"],), FACES, FACES)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("box", {"half_extents": np.array([1, np.nan, 1])}, "half_extents of a box holds nan"),
        ("box", {"half_extents": np.array([1, -1e-3, 1])}, "expected none below 0"),
        ("box", {"axes": np.eye(4)}, r"axes of a box has shape \(4, 4\), expected \(3, 3\)"),
        ("room", {"profile": np.zeros((4, 3))}, r"expected \(n, 2\)"),
        ("scan", {"face_node": np.zeros(1, np.int32)}, r"face_node has shape \(1,\), expected \(2\)"),
        ("scan", {"face_node": np.array([0, 1], np.int32)}, "face_node spans 0 to 1, expected -1 to 0"),
        ("scan", {"world_from_file": np.full((4, 4), np.inf)}, "world_from_file holds inf"),
        ("instance", {"front": np.zeros(2)}, "front of a has shape"),
        ("segmentation", {"face_instance": np.array([-2, 0], np.int32)}, "face_instance spans -2"),
        ("segmentation", {"face_part": np.array([0, 1], np.int32)}, "face_part spans 0 to 1"),
        ("anchor", {"surface_point": np.array([0, np.nan, 0])}, "surface_point holds nan"),
        ("anchor", {"world_from_object": np.eye(3)}, "world_from_object has shape"),
        ("distance", {"values": np.full((2, 2, 2), np.nan, np.float32)}, "values of a distance grid holds nan"),
        ("points", {"volume": np.ones(1)}, "volume of material points has shape"),
        ("points", {"position": np.zeros((0, 3))}, "without material points"),
        ("grid", {"node_state": np.zeros((1, 2, 2), np.int8)}, "node_state of a background grid has shape"),
        ("grid", {"y": np.array([1.0, 0.0])}, "along y must be two or more that increase"),
        ("inertial", {"inertia": np.full((3, 3), np.nan)}, "inertia of a body holds nan"),
        ("body", {"velocity": np.full(3, np.nan)}, "velocity of object holds nan"),
    ],
)  # fmt: skip
def test_what_breaks_its_promise_is_refused(name: str, change: dict[str, object], words: str) -> None:
    """Each promise of a field's docstring that is cheap to check is checked, and the message says field and value."""
    with pytest.raises(GeometryError, match=words):
        replace(VALUES[name], **change)  # type: ignore[type-var]
