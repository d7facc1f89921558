"""Every value becomes plain files and comes back bit for bit."""

import json
from dataclasses import fields, is_dataclass

import numpy as np
import pyarrow.parquet as pq
import pytest
from PIL import Image
from rest_records import (
    LAST,
    history,
    painted_records,
    settled_record,
)

from dcap.scene.errors import StoreError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import (
    Anchor,
    Intent,
    OrientationRequest,
    RegionConstraint,
    RegionRequest,
)
from dcap.scene.types.materials import BodyModel, ContactFriction, LayerConstants, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import (
    Infeasible,
    InTheWay,
    NoRoom,
    Reason,
)
from dcap.scene.types.particles import (
    BackgroundGrid,
    ColumnLayer,
    DistanceGrid,
    InertialProperties,
    LayeredPoints,
    MaterialPoints,
    Particles,
    RigidSimulationBody,
    SimulationBody,
    SoftSimulationBody,
)
from dcap.scene.types.pictures import Renders
from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import BodyGeometry, Method, RepairReport
from dcap.scene.types.segmentation import (
    Instance,
    Part,
    Segmentation,
)
from dcap.scene.types.settled import Settled
from flows.place import STAGES
from tasks.artifact import Store
from tasks.cache import kinds_of
from tasks.codec import encode, stored_types

RNG = np.random.default_rng(0)


def a_mesh(count: int = 60) -> Mesh:
    """A heap of random triangles."""
    return Mesh.of(
        RNG.normal(size=(count, 3)), RNG.integers(0, count, (count, 3)), RNG.integers(0, 256, (count, 3), np.uint8)
    )


def a_box() -> OrientedBox:
    """A box turned about the vertical."""
    return OrientedBox(RNG.normal(size=3), np.eye(3), np.array([0.1, 0.2, 0.3]))


def a_picture() -> np.ndarray:
    """A small picture."""
    return RNG.integers(0, 256, (12, 9, 3), np.uint8)


FRICTION = ContactFriction(0.5, 0.4, 0.001)
INERTIAL = InertialProperties(1.5, np.zeros(3), np.eye(3))
LAYERED = LayeredPoints(*(np.ones(100),) * 3, np.tile([0.0, 0.0, 1.0], (100, 1)))
POINTS = MaterialPoints(RNG.normal(size=(100, 3)), *(np.ones(100),) * 4, LAYERED)
GRID = BackgroundGrid(*(np.linspace(0, 1, 5),) * 3, np.zeros((5, 5, 5), np.int8))


def a_body(*, rigid: bool) -> SimulationBody:
    """A body of the solver's input."""
    distance = DistanceGrid(np.zeros(3), 0.01, RNG.normal(size=(5, 6, 7)).astype(np.float32))
    if rigid:
        return RigidSimulationBody(
            name="shelf", instance="3", fixed=True, surface=a_mesh(), distance=distance, inertial=INERTIAL,
            friction=FRICTION, face_friction=np.tile([0.5, 0.4, 0.001], (len(a_mesh().faces), 1)),
        )  # fmt: skip
    return SoftSimulationBody(
        name="object", instance="object", fixed=False, surface=a_mesh(), distance=distance, inertial=INERTIAL,
        friction=FRICTION, velocity=np.array([0.0, 0.0, -1.0]), points=POINTS, grid=GRID, loaded=False,
    )  # fmt: skip


MATERIAL = Material("foam", 30.0, 5e4, 0.3, 0.6, 0.5, 0.0, "soft", "handbook", LayerConstants(1e5, 0.2, 1e3))
INSTANCE = Instance("3", "bed", a_box(), (Part("mattress", a_box(), 0.9),), np.array([1.0, 0, 0]))
REPORT = RepairReport(
    Method.CLOSED, True, 1.0, 1e-4, 1e-5, 5e-3, 2e-3, 0.1, 0.0, ("2 degenerate faces dropped",), ""
)  # fmt: skip
NO_ROOM = NoRoom(
    "3", "mattress", "whole surface", (0.5, 0.4), 0.2, (0.4, 0.4), 0.4, 0.5, 0.1, (InTheWay("4", "book", 0.1),)
)  # fmt: skip
LIMIT = RegionConstraint("exactly", ("left", "edge"), "", 0.2, "20 cm from the left edge")
BODIES = (a_body(rigid=True), a_body(rigid=False))
VALUES = [
    Anchor("3", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, np.zeros((4, 2)), "asked"),
    Infeasible(Reason.TOO_LARGE_FOR_TARGET, "no room", NO_ROOM),
    Infeasible(Reason.TOPPLED, "it fell over", LAST),
    Intent(
        "3", "bed", "ball", np.array([0.2, 0.2, 0.2]), 0.4, True, 1.02, OrientationRequest("any", "", ""),
        RegionRequest("", ("left", "front"), (), "left front", "", (LIMIT,)), ("gently",), (), (),
    ),
    a_mesh(),
    Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))),
    *painted_records(a_picture()),
    Particles(
        BODIES, (("object", "3", 0.5, 0.4),), 0.004, ("cropped",), (BodyGeometry("bed_0", "mattress", REPORT),),
        (ColumnLayer("mattress", "foam", 0.02, 0.2),),
    ),
    PartMaterials((PartMaterial("object", "body", 0, MATERIAL, BodyModel.RIGID, "thin"),), "none"),
    Sample("a", "scene", "object", "put", mass=None),
    Segmentation(a_mesh(), (INSTANCE,), np.zeros(60, np.int32), np.full(60, -1, np.int32)),
    settled_record(a_mesh()),
    history(3),
]  # fmt: skip
"""Numbers, texts, enums, pictures, meshes, tables and nothing, in every nesting that stages return."""


def same(a: object, b: object) -> bool:
    """Equality down to dtype, shape and bits."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if is_dataclass(a) and not isinstance(a, type):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple | list):
        return type(a) is type(b) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    return type(a) is type(b) and a == b


def test_every_stored_type_comes_back_bit_for_bit(store: Store) -> None:
    """load(save(x)) is x in type, dtype, shape and every bit; saving it again gives the same reference and bytes."""
    returned = {kind.__name__ for stage in STAGES for kind in kinds_of(stage.hints["return"])}
    assert returned | {type(value).__name__ for value in VALUES} <= stored_types().keys()
    for value in VALUES:
        ref = store.save(value)
        loaded = store.load(ref)
        assert same(value, loaded), ref
        assert store.save(loaded) == ref
        assert encode(loaded) == encode(value), ref
        assert ref.kind == type(value).__name__


def test_artifacts_are_readable_without_our_code(store: Store) -> None:
    """JSON, Parquet, PNG and PLY readers of others understand what lies in the store."""
    import trimesh

    settled = next(value for value in VALUES if isinstance(value, Settled))
    folder = store.folder(store.save(settled))
    tree = json.loads((folder / "value.json").read_text())
    assert tree["verdict"] == "at_rest"
    np.testing.assert_array_equal(
        pq.read_table(folder / "history-linear_speed.parquet")["value"].to_numpy(), settled.history.linear_speed
    )
    ply = trimesh.load_mesh(folder / "bodies-0-surface.ply", process=False)
    np.testing.assert_array_equal(ply.vertices, settled.bodies[0].surface.vertices)
    renders = next(value for value in VALUES if isinstance(value, Renders))
    picture = Image.open(store.folder(store.save(renders)) / "clean.png")
    np.testing.assert_array_equal(np.asarray(picture), renders.clean)


def test_foreign_types_are_refused(store: Store) -> None:
    """A value of a type that the store does not know is an error at saving, not at loading."""
    with pytest.raises(StoreError, match="set"):
        store.save({"x": {1, 2}})
