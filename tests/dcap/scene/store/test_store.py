"""The store keeps every value bit for bit, whole or not at all, and notices damage."""

import json
import threading
from dataclasses import fields, is_dataclass
from pathlib import Path

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

from dcap.scene.errors import InputError, MissingArtifactError, StoreError
from dcap.scene.store.artifacts import Source, Store
from dcap.scene.store.codec import KINDS, decode, encode
from dcap.scene.store.ref import Ref
from dcap.scene.types.anchor import Anchor, Lean
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.file_scale import FileScale
from dcap.scene.types.given_labels import CornerFrame, GivenLabels, GivenPart, GivenThing, VertexLabels
from dcap.scene.types.intent import Intent, OrientationRequest, RegionConstraint, RegionRequest, SupportCandidate
from dcap.scene.types.materials import BodyModel, ContactFriction, LayerConstants, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import BesideThePart, HiddenObject, Infeasible, InTheWay, NoRoom, NotInScene, Reason
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
from dcap.scene.types.pointed import Pointed
from dcap.scene.types.renders import Overview, Renders
from dcap.scene.types.repair_report import BodyGeometry, Method, RepairReport
from dcap.scene.types.rotation import Rotation
from dcap.scene.types.sample import GivenPlace, KnownHeight, Sample, SourceOptions
from dcap.scene.types.scan import LabelBox, Room, Scan
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.types.settled import LeanCheck, Settled, SettledBody
from solver.certificate import BondRow, CertificateRow, NotDone, RollingRow

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


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")


def test_every_stored_type_has_an_example() -> None:
    """The round-trip test below covers every type that may be stored."""
    assert {type(value).__name__ for value in VALUES} == KINDS.keys()


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_load_gives_back_what_was_saved(store: Store, value: object) -> None:
    """load(save(x)) is x in type, dtype, shape and every bit, and saving it again gives the same reference."""
    ref = store.save(value)
    loaded = store.load(ref)
    assert same(value, loaded)
    assert store.save(loaded) == ref
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


def test_equal_values_give_equal_bytes() -> None:
    """Encoding is a function of the value alone."""
    for value in VALUES:
        assert encode(value) == encode(decode(encode(value)))


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


@pytest.mark.parametrize("damage", ["flip", "truncate", "delete", "add"])
def test_damage_is_noticed(store: Store, damage: str) -> None:
    """An artifact with one changed, shortened, missing or additional file is neither sound nor loaded."""
    ref = store.save(VALUES[0])
    assert store.has(ref)
    file = store.folder(ref) / "value.json"
    data = file.read_bytes()
    if damage == "flip":
        file.write_bytes(bytes([data[0] ^ 1]) + data[1:])
    elif damage == "truncate":
        file.write_bytes(data[:-1])
    elif damage == "delete":
        file.unlink()
    else:
        (file.parent / "more.txt").write_text("x")
    assert not store.has(ref)
    with pytest.raises(MissingArtifactError):
        store.load(ref)


def test_saving_mends_a_damaged_artifact(store: Store) -> None:
    """Saving the same value again replaces damaged bytes."""
    ref = store.save(VALUES[0])
    (store.folder(ref) / "value.json").write_text("{}")
    assert store.save(VALUES[0]) == ref
    assert store.has(ref)


def test_a_failed_write_leaves_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A write that dies half-way leaves no artifact and no draft."""
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if path.suffix == ".ply":
            raise OSError("no space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(OSError, match="no space"):
        store.save(a_mesh())
    assert not list(store.refs())
    assert not list((store.root / "building").iterdir())


def test_many_writers_of_one_value(store: Store) -> None:
    """Threads that save the same value at once all succeed and leave one sound artifact."""
    value, refs = a_mesh(), []
    threads = [threading.Thread(target=lambda: refs.append(store.save(value))) for _ in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(refs) == 8
    assert len(set(refs)) == 1
    assert list(store.refs()) == [refs[0]]
    assert Store(store.root).has(refs[0])


def test_foreign_types_are_refused(store: Store) -> None:
    """A value of a type that the store does not know is an error at saving, not at loading."""
    with pytest.raises(StoreError, match="set"):
        store.save({"x": {1, 2}})


def test_an_obj_takes_its_textures_along(store: Store, tmp_path: Path) -> None:
    """The artifact of an OBJ holds its MTL files and their textures, so changing a texture changes the reference."""
    folder = tmp_path / "mug"
    folder.mkdir()
    (folder / "mug.obj").write_text("mtllib my mug.mtl\nv 0 0 0\n")
    (folder / "my mug.mtl").write_text("newmtl a\nmap_Kd -s 1 1 1 skin.png\n")
    (folder / "skin.png").write_bytes(b"one")
    (folder / "other.png").write_bytes(b"not named")
    ref = store.add_source(folder / "mug.obj")
    source = store.load(ref)
    assert isinstance(source, Source)
    assert sorted(path.name for path in source.path.parent.iterdir()) == ["mug.obj", "my mug.mtl", "skin.png"]
    (folder / "other.png").write_bytes(b"changed")
    assert store.add_source(folder / "mug.obj") == ref
    (folder / "skin.png").write_bytes(b"two")
    assert store.add_source(folder / "mug.obj") != ref


def test_a_gltf_takes_its_buffers_along(store: Store, tmp_path: Path) -> None:
    """Buffers and images that a glTF names come along, data URIs and paths outside of its folder do not."""
    folder = tmp_path / "deep"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(b"x")
    buffers = [{"uri": "my%20data.bin"}, {"uri": "data:;base64,AA=="}, {"uri": "../secret.bin"}]
    (folder / "a.gltf").write_text(json.dumps({"buffers": buffers, "images": [{"uri": "i.png"}]}))
    (folder / "my data.bin").write_bytes(b"x")
    (folder / "i.png").write_bytes(b"x")
    source = store.load(store.add_source(folder / "a.gltf"))
    assert isinstance(source, Source)
    assert sorted(path.name for path in source.path.parent.iterdir()) == ["a.gltf", "i.png", "my data.bin"]


def test_ground_truth_stays_outside(store: Store, tmp_path: Path) -> None:
    """A truth file in a scene folder neither reaches a stage nor changes the reference."""
    scene = tmp_path / "room"
    scene.mkdir()
    (scene / "labels.json").write_text("[]")
    ref = store.add_source(scene)
    (scene / "truth.yaml").write_text("feasible: true")
    assert store.add_source(scene) == ref


def test_absurd_sources_are_refused(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing, empty, far too large and far too many files are errors that name the path."""
    with pytest.raises(InputError, match="no such file"):
        store.add_source(tmp_path / "nothing.obj")
    (tmp_path / "empty.ply").touch()
    with pytest.raises(InputError, match="empty file"):
        store.add_source(tmp_path / "empty.ply")
    with (tmp_path / "huge.ply").open("wb") as file:
        file.truncate(5 << 30)
    with pytest.raises(InputError, match=r"5\.0 GiB > 4 GiB"):
        store.add_source(tmp_path / "huge.ply")
    monkeypatch.setattr("dcap.scene.store.source_files.MOST_FILES", 3)
    many = tmp_path / "many"
    many.mkdir()
    for index in range(4):
        (many / f"{index}.txt").write_text("x")
    with pytest.raises(InputError, match="more than 3 files"):
        store.add_source(many)


def test_what_is_not_a_mesh_file_is_refused_unread(store: Store, tmp_path: Path) -> None:
    """A device, a film, a name too long for any file and a file without permission are one line, before any copy."""
    film = tmp_path / "film.mp4"
    film.write_bytes(b"x")
    for path, words in (
        (Path("/dev/zero"), "neither a file nor a folder"),
        (film, r"\.mp4 is not a mesh format"),
        (tmp_path / ("x" * 300 + ".obj"), "cannot be read"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            store.add_source(path)
        assert "\n" not in str(caught.value)
    assert list(store.refs()) == []


def test_a_file_that_may_not_be_read_is_bad_input(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The system's refusal becomes one line that names the file."""

    def forbidden(path: Path) -> str:
        raise PermissionError(13, "Permission denied", str(path))

    (tmp_path / "mug.obj").write_text("v 0 0 0")
    monkeypatch.setattr("dcap.scene.store.artifacts.digest_of_file", forbidden)
    with pytest.raises(InputError, match=r"cannot be read: Permission denied .*mug\.obj"):
        store.add_source(tmp_path / "mug.obj")


def test_a_stray_empty_folder_is_damage_that_saving_mends(store: Store) -> None:
    """What cannot be loaded is not there, and is written anew."""
    ref = store.save(MATERIAL)
    (store.folder(ref) / "stray").mkdir()
    assert not store.has(ref)
    assert store.save(MATERIAL) == ref
    assert store.load(ref) == MATERIAL


def test_reference_round_trip() -> None:
    """A reference survives JSON."""
    ref: Ref[Scan] = Ref("Scan", "ab" * 32)
    assert Ref.from_json(json.loads(json.dumps(ref.to_json()))) == ref
