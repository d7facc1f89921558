"""Every value becomes plain files and comes back bit for bit."""

import json
import pickle
from dataclasses import fields, is_dataclass

import numpy as np
import pyarrow.parquet as pq
import pytest
from asked_records import asked_and_refused, earlier_records, painted_records, planned_records
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image
from placed_examples import chained
from rest_records import (
    CHECKS,
    CONTACT,
    KICK,
    LAST,
    PUSHES,
    ROW,
    STABILITY,
    explicit_certificate,
    history,
    measured_records,
    motion_records,
    settled_record,
    signals,
)

from dcap.scene.errors import StoreError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import (
    Anchor,
    Intent,
    Lean,
    OrientationRequest,
    RegionConstraint,
    RegionRequest,
    Rotation,
    SupportCandidate,
)
from dcap.scene.types.materials import BodyModel, ContactFriction, LayerConstants, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import (
    BesideThePart,
    Cause,
    Caution,
    HiddenObject,
    Infeasible,
    InTheWay,
    NoRoom,
    NotInScene,
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
from dcap.scene.types.pictures import Overview, Renders
from dcap.scene.types.sample import GivenPlace, KnownHeight, Sample, SourceOptions
from dcap.scene.types.scan import BodyGeometry, FileScale, LabelBox, Method, RepairReport, Room, Scan
from dcap.scene.types.segmentation import (
    CornerFrame,
    GivenLabels,
    GivenPart,
    GivenThing,
    Instance,
    Part,
    Pointed,
    Segmentation,
    VertexLabels,
)
from dcap.scene.types.settled import EndPose, LeanCheck, Settled, SettledBody
from flows.place import STAGES
from solver.certificate import BondRow, CertificateRow, NotDone, RollingRow
from tasks.artifact import Store
from tasks.cache import kinds_of
from tasks.codec import decode, encode, stored_types

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


LAYERS = LayerConstants(1e5, 0.2, 1e3)
MATERIAL = Material("foam", 30.0, 5e4, 0.3, 0.6, 0.5, 0.0, "soft", "handbook", LAYERS)
INSTANCE = Instance("3", "bed", a_box(), (Part("mattress", a_box(), 0.9),), np.array([1.0, 0, 0]))

REPORT = RepairReport(
    Method.CLOSED, True, 1.0, 1e-4, 1e-5, 5e-3, 2e-3, 0.1, 0.0, ("2 degenerate faces dropped",), ""
)  # fmt: skip
GEOMETRY = BodyGeometry("bed_0", "mattress, blanket", REPORT)
NO_ROOM = NoRoom(
    "3", "mattress", "whole surface", (0.5, 0.4), 0.2, (0.4, 0.4), 0.4, 0.5, 0.1, (InTheWay("4", "book", 0.1),)
)  # fmt: skip
COLUMN = ColumnLayer("mattress", "foam", 0.02, 0.2)
LEAN = Lean("wall_0", 0.21, np.array([0.2, 0.0, 0.98]))
LEANING = LeanCheck("wall_0", 0.21, 0.22, CertificateRow.at_most(0.01, 0.26), CertificateRow.at_least(0.1, 0.005))
LIMIT = RegionConstraint("exactly", ("left", "edge"), "", 0.2, "20 cm from the left edge")
SUPPORT = SupportCandidate("3", "bed", 0.9)
BODIES = (a_body(rigid=True), a_body(rigid=False))
A_THING = GivenThing(
    "3", "sofa", 0.5, np.array([[0, 4], [6, 7]]), np.zeros((8, 3)), (GivenPart("seat", np.array([[0, 4]])),)
)  # fmt: skip
VALUES = [
    ANCHOR := Anchor("3", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, np.zeros((4, 2)), "asked"),
    *chained(INSTANCE, ANCHOR, MATERIAL, a_mesh()),
    EndPose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0)),
    DistanceGrid(np.zeros(3), 0.01, RNG.normal(size=(4, 4, 4)).astype(np.float32)),
    FileScale(0.0254, "by a table"),
    GivenLabels("labels.json", (A_THING,), CornerFrame.Y_UP, complete=False, mesh="0123", notes=("one",)),
    A_THING.parts[0],
    GivenPlace(at=(1.0, 2.5)),
    A_THING,
    KnownHeight("table", 0.75),
    Pointed("3", "sofa", "", np.zeros(3), np.zeros((0, 2), np.int64), True, ()),
    VertexLabels("ids.npy", np.array([0, -1, 0], np.int32), ("sofa_3",), ("sofa",)),
    Infeasible(Reason.TOO_LARGE_FOR_TARGET, "no room", NO_ROOM),
    INSTANCE,
    Intent(
        "3", "bed", "ball", np.array([0.2, 0.2, 0.2]), 0.4, True, 1.02, OrientationRequest("any", "", ""),
        RegionRequest("", ("left", "front"), (), "left front", "", (LIMIT,)), ("gently",), (), (SUPPORT,),
    ),
    LabelBox("3", "bed", a_box()),
    *(LEAN, LEANING, LIMIT, SUPPORT, LAYERS),
    LAYERED,
    MATERIAL,
    a_mesh(),
    Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))),
    OrientationRequest("upright", "", "upright"),
    a_box(),
    Overview(a_picture(), None),
    *asked_and_refused(),
    Part("mattress", a_box(), 0.5),
    Particles(BODIES, (("object", "3", 0.5, 0.4),), 0.004, ("cropped",), (GEOMETRY,), (COLUMN,)),
    COLUMN,
    PartMaterial("object", "body", 0, MATERIAL, BodyModel.MPM, "E below 1 GPa"),
    PartMaterials((PartMaterial("object", "body", 0, MATERIAL, BodyModel.RIGID, "thin"),), "none"),
    GEOMETRY,
    REPORT,
    RegionRequest("seat", (), ("part:pillow",), ""),
    *painted_records(a_picture()),
    *(*earlier_records(), *planned_records()),
    Room("bedroom", np.zeros((5, 2))),
    Rotation(np.eye(3), (a_picture(), a_picture(), a_picture()), "a ball", "pose 1", "most stable"),
    Sample("a", "scene", "object", "put", mass=None),
    Scan(
        a_mesh(), np.zeros(60, np.int32), ("bed",), (LabelBox("3", "bed", a_box()),), (Room("bath", np.zeros((4, 2))),),
        "", np.eye(4), "z", 0.01, "option", ("scaled",),
    ),
    Segmentation(a_mesh(), (INSTANCE,), np.zeros(60, np.int32), np.full(60, -1, np.int32)),
    settled_record(a_mesh()),
    explicit_certificate(),
    *motion_records(),
    *measured_records(),
    LAST,
    CONTACT,
    KICK,
    STABILITY, *STABILITY.bodies.values(),
    *PUSHES,
    STABILITY.bounds,
    ROW,
    signals(),
    KICK.distance_m,
    NotDone(reason="nothing rests"),
    RollingRow("object", "bed", 1e-4, 1e-3),
    BondRow("cover", "bed", 12, 3.0, 1e-5),
    CHECKS,
    history(3),
    NO_ROOM,
    *NO_ROOM.in_the_way,
    BesideThePart("3", "seat", "beside", ("stove",), 1.5),
    HiddenObject(0.0, np.zeros(3)),
    NotInScene("the piano", ("bed", "sofa"), "ball"),
    Infeasible(Reason.UNSTABLE_STEP, "it broke", None),
    Infeasible(Reason.TOPPLED, "it fell over", LAST),
    SettledBody("object", a_mesh(), np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros((60, 3))),
    FRICTION,
    INERTIAL,
    POINTS,
    GRID,
    *BODIES,
    SourceOptions("y", "cm", "table"),
]  # fmt: skip


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
    assert returned <= {type(value).__name__ for value in VALUES} <= stored_types().keys()
    for value in VALUES:
        ref = store.save(value)
        loaded = store.load(ref)
        assert same(value, loaded), ref
        assert store.save(loaded) == ref
        assert encode(loaded) == encode(value), ref
        assert ref.kind == type(value).__name__


@given(
    hnp.arrays(
        st.sampled_from([np.float64, np.float32, np.int32, np.int64, np.uint8, np.int8, np.bool_, np.uint32]),
        hnp.array_shapes(min_dims=1, max_dims=4, min_side=0, max_side=20),
    )
)
@settings(deadline=None, max_examples=60)
def test_any_array_survives(array: np.ndarray) -> None:
    """Arrays of every dtype and shape, also empty and with NaN and infinity, come back bit for bit."""
    if array.dtype.kind == "f":  # libraries loaded by other tests may flush numbers below the normal ones to zero
        array[np.abs(array) < np.finfo(array.dtype).tiny] = 0.0
    body = SettledBody("a", Mesh.of(np.zeros((1, 3)), np.zeros((0, 3))), np.zeros(3), np.ones(4), array)
    assert same(body, decode(encode(body)))


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


def test_messages_keep_their_cause() -> None:
    """A caution among plain texts comes back with its cause, and a text as a text."""
    given = {"notes": ["cut", Caution(Cause.NOT_MET, "asked seated")]}
    files = encode(given)
    found = decode(files)
    assert found == given
    assert isinstance(found, dict)
    plain, caution = found["notes"]
    assert type(plain) is str
    assert isinstance(caution, Caution)
    assert caution.cause is Cause.NOT_MET
    assert pickle.loads(pickle.dumps(caution)).cause is Cause.NOT_MET
    assert encode(found) == files
