"""Checks of scenes: a sound one is let be, every defect is found at its line, and nothing ends a check early."""

import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from json_trees import Tree

from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.checks.findings import Finding, Findings
from dcap.scene.checks.scene_folder import check_scene, layout_of
from dcap.scene.errors import Severity
from dcap.scene.writers.interiorgs import write_interiorgs, write_interiorgs_splats
from dcap.synthetic.rooms import BuiltRoom, build_room

SPLATS = "3dgs_compressed.ply"
SQUARE = "v 0 0 0\nv 3 0 0\nv 3 3 0\nv 0 3 0\nf 1 2 3 4\n"


@pytest.fixture(scope="module")
def built() -> BuiltRoom:
    return build_room("hall_01", 0)


@pytest.fixture(scope="module")
def sound(built: BuiltRoom, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of a sound scene of a few splats."""
    folder = tmp_path_factory.mktemp("sound")
    write_interiorgs_splats(folder, built.record, splats_on_mesh(built.record.mesh, 0.4, 0), 0)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def written(folder: Path, files: dict[str, bytes]) -> Path:
    """A folder of these files."""
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder


def found(folder: Path) -> tuple[Finding, ...]:
    """What is found in a scene."""
    findings = Findings()
    check_scene(folder, findings)
    return findings.all()


def test_a_generated_room_is_sound(built: BuiltRoom, tmp_path: Path) -> None:
    """Nothing but notes is found in a room as it is written, and its numbers are those of the room."""
    write_interiorgs(tmp_path, built.record, 0)
    findings = Findings()
    facts = check_scene(tmp_path, findings)
    assert [one for one in findings.all() if one.severity is not Severity.NOTE] == []
    assert facts.faces == len(built.record.mesh.faces)
    assert sorted(facts.labels) == sorted(one.name.lower() for one in built.record.labels if one.box is not None)


BUILDING = ("floor", "ceiling", "window", "door")


def boxed(labels: Tree, number: int = 0) -> Tree:
    """One of the entries with a box that is no part of the building."""
    return [entry for entry in labels if "bounding_box" in entry and entry["label"].lower() not in BUILDING][number]


def shifted(entry: Tree, **by: float) -> None:
    for corner in entry["bounding_box"]:
        for axis, step in by.items():
            corner[axis] += step


def marked(entry: Tree, **change: object) -> None:
    entry.pop("ins_id", None)
    rest = dict(entry)
    entry.clear()
    entry.update({"ins_id": "MARK", **rest, **change})


def without(entry: Tree, key: str) -> None:
    del entry[key]


def flattened(entry: Tree) -> None:
    for corner in entry["bounding_box"]:
        corner["z"] = 0.5


def swapped(profile: Tree) -> None:
    profile[1], profile[2] = profile[2], profile[1]


E, W, N = Severity.ERROR, Severity.WARNING, Severity.NOTE
LABELS: list[tuple[Callable[[Tree], object], str, int, Severity, str]] = [
    (lambda t: (marked(boxed(t)), without(boxed(t), "label")), '"MARK"', -1, W, "has no label"),
    (lambda t: marked(boxed(t), bounding_box=[]), '"bounding_box": []', 0, E, "0 corners, expected 8"),
    (lambda t: boxed(t)["bounding_box"].pop(), "BOX0", 0, E, "7 corners, expected 8"),
    (lambda t: boxed(t)["bounding_box"][3].update(y=float("nan")), "NaN", -2, E, "not finite"),
    (lambda t: boxed(t)["bounding_box"][2].update(x="wide"), '"wide"', -1, E, "point 2"),
    (lambda t: boxed(t)["bounding_box"].__setitem__(5, 77), " 77,", 0, E, "point 5 is 77"),
    (lambda t: (marked(boxed(t)), marked(boxed(t, 1))), "SECOND MARK", 0, W, "'MARK' of entry"),
    (lambda t: shifted(boxed(t), z=-60.0), "BOX0", 0, W, "below the floor"),
    (lambda t: shifted(boxed(t), x=70.0), "BOX0", 0, W, "away from every room"),
    (lambda t: flattened(boxed(t)), "BOX0", 0, N, "is flat"),
    (lambda t: boxed(t, 1).update(bounding_box=boxed(t)["bounding_box"]), "BOX1", 0, W, "has the same box as"),
    (lambda t: marked(boxed(t), boundingbox=boxed(t).pop("bounding_box")), '"MARK"', -1, W, "mean 'boundingbox'"),
    (lambda t: t.insert(4, "a word"), '"a word"', 0, E, "entry 4 is a str"),
]
STRUCTURE: list[tuple[Callable[[Tree], object], str, int, Severity, str]] = [
    (lambda t: t["rooms"][0].update(profile=[[0, 1]]), '"profile"', 0, W, "1 points, expected 3"),
    (lambda t: swapped(t["rooms"][0]["profile"]), '"profile"', 0, W, "crosses itself"),
    (lambda t: t["rooms"][0].update(profile="round"), '"profile": "round"', 0, E, "not a list of points"),
    (lambda t: t["walls"][2].update(thickness="thick"), '"thick"', 0, E, "thickness of wall 2"),
    (lambda t: t["walls"][1].update(height=-2), '"height": -2', 0, W, "height of wall 1 is -2 m"),
    (lambda t: t["walls"][0].update(location=[[1, 2]]), '"location"', 0, E, "1 points, expected 2"),
    (lambda t: t["walls"].append(None), " null", 0, E, "is None"),
    (lambda t: t["holes"][0].update(type="WINDOR"), '"WINDOR"', 0, W, "did you mean 'window'"),
]
OCCUPANCY: list[tuple[Callable[[Tree], object], str, int, Severity, str]] = [
    (lambda t: t.update(scale=0), '"scale": 0', 0, E, "above 0"),
    (lambda t: t.update(scale=50), '"scale": 50', 0, E, "up to 10"),
    (lambda t: t.update(upper=[90]), '"upper"', 0, E, "three finite numbers"),
    (lambda t: t.update(lower=t["upper"], upper=t["lower"]), '"lower"', 0, E, "is not below upper"),
    (lambda t: t.update(sclae=t.pop("scale")), "{", 0, E, "'scale' is missing; did you mean 'sclae'"),
]
DEFECTS = [
    *(("labels.json", *one) for one in LABELS),
    *(("structure.json", *one) for one in STRUCTURE),
    *(("occupancy.json", *one) for one in OCCUPANCY),
]


def line_of(text: str, needle: str) -> int:
    """Line of the first occurrence; of the box of the n-th thing for BOXn, of the second mark for SECOND."""
    if needle.startswith("BOX"):
        entry = boxed(json.loads(text), int(needle[3:]))
        start = text.index(json.dumps(entry, indent=1).replace("\n", "\n "))
        return text.count("\n", 0, text.index('"bounding_box"', start)) + 1
    if needle == "SECOND MARK":
        return text.count("\n", 0, text.index('"MARK"', text.index('"MARK"') + 1)) + 1
    return text.count("\n", 0, text.index(needle)) + 1


def test_a_defect_is_found_at_its_line(sound: dict[str, bytes], tmp_path: Path, subtests: pytest.Subtests) -> None:
    """One thing wrong with an otherwise sound scene: it alone is told, with file, line and value."""
    for name, change, needle, offset, severity, words in DEFECTS:
        with subtests.test(str((name, needle, words))):
            tree = json.loads(sound[name])
            change(tree)
            text = json.dumps(tree, indent=1)
            told = found(written(tmp_path, sound | {name: text.encode()}))
            mine = [one for one in told if words in one.what]
            assert [(one.path.name, one.severity, one.line) for one in mine] == [
                (name, severity, line_of(text, needle) + offset)
            ], told
            assert all(one.severity is not E for one in told if one not in mine), told


def test_all_of_many_defects_are_found(sound: dict[str, bytes], tmp_path: Path) -> None:
    """Ten defects in four files, some in one entry after another: all are told, and both ends of the program go on."""
    labels, structure = json.loads(sound["labels.json"]), json.loads(sound["structure.json"])
    boxed(labels)["bounding_box"].pop()
    boxed(labels, 1)["bounding_box"][0]["x"] = "a"
    boxed(labels, 1)["bounding_box"][4]["z"] = None
    labels.append(3)
    structure["walls"][0]["thickness"] = []
    structure["walls"][1]["height"] = "tall"
    structure["holes"][0]["profile"] = []
    occupancy = b'{"scale": "x"}'
    files = {
        "labels.json": json.dumps(labels).encode(), "structure.json": json.dumps(structure).encode(),
        "occupancy.json": occupancy, SPLATS: sound[SPLATS][:-7], "occupancy.png": sound["occupancy.png"][:200],
    }  # fmt: skip
    errors = [one for one in found(written(tmp_path, files)) if one.severity is E]
    assert {name: sum(one.path.name == name for one in errors) for name in files} == {
        "labels.json": 4,
        "structure.json": 3,
        "occupancy.json": 3,
        SPLATS: 1,
        "occupancy.png": 1,
    }


@pytest.mark.parametrize(
    ("gone", "severity", "words"),
    [
        (SPLATS, E, "no mesh"),
        ("labels.json", W, "is missing"),
        ("structure.json", W, "is missing"),
        ("occupancy.json", W, "is missing next to"),
        ("occupancy.png", W, "is missing next to"),
    ],
)
def test_a_missing_file_is_told(
    sound: dict[str, bytes], tmp_path: Path, gone: str, severity: Severity, words: str
) -> None:
    """What a scene folder promises and does not hold."""
    told = found(written(tmp_path, {name: data for name, data in sound.items() if name != gone}))
    assert [(one.severity, words in one.what) for one in told] == [(severity, True)]


def test_broken_json_names_its_line(sound: dict[str, bytes], tmp_path: Path) -> None:
    """A comma too few ends that file's check, with the line, and no other's."""
    text = b'[\n {"label": "bed"}\n {"label": "rug"}\n]'
    told = found(written(tmp_path, sound | {"labels.json": text, "structure.json": b"{\n"}))
    assert [(one.path.name, one.line) for one in told] == [("labels.json", 3), ("structure.json", 2)]


def test_a_key_given_twice_is_told(sound: dict[str, bytes], tmp_path: Path) -> None:
    """The parser takes the last one silently."""
    text = sound["occupancy.json"].replace(b'"lower"', b'"scale": 3,\n "lower"', 1)
    told = found(written(tmp_path, sound | {"occupancy.json": text}))
    line = text[: text.index(b'"scale": 3')].count(b"\n") + 1
    assert (line, True) in [(one.line, "'scale' is given twice" in one.what) for one in told]


def test_a_picture_of_another_size_is_told(sound: dict[str, bytes], tmp_path: Path) -> None:
    """Width and height must fit lower, upper and scale."""
    tree = json.loads(sound["occupancy.json"])
    tree["scale"] *= 2
    told = found(written(tmp_path, sound | {"occupancy.json": json.dumps(tree).encode()}))
    assert [one.what[:36] for one in told] == [
        "1024 pixels wide, but lower, upper a",
        "1024 pixels high, but lower, upper a",
    ]


def chunk_field(data: bytes, chunk: int, field: int, value: float) -> bytes:
    """Compressed splats with one range changed."""
    start = data.index(b"end_header\n") + len(b"end_header\n") + 4 * (18 * chunk + field)
    return data[:start] + struct.pack("<f", value) + data[start + 4 :]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: chunk_field(d, 1, 2, np.nan), "min_z of chunk 1 is not finite"),
        (lambda d: chunk_field(d, 0, 3, -900.0), "min_x of chunk 0 is above its max"),
        (lambda d: d[:-1], "the file is truncated"),
        (lambda d: d.replace(b"property uint packed_color", b"property int packed_color"), "expected uint"),
        (lambda d: d.replace(b"element vertex ", b"element vertex 9"), "promises"),
        (lambda d: b"", "empty"),
    ],
)
def test_broken_splats_are_told(
    sound: dict[str, bytes], tmp_path: Path, change: Callable[[bytes], bytes], words: str
) -> None:
    """Ranges, counts and types of the compressed file, without decoding it."""
    told = found(written(tmp_path, sound | {SPLATS: change(sound[SPLATS])}))
    assert any(words in one.what and one.severity is E for one in told), told


def test_a_broken_line_of_an_obj_is_told(tmp_path: Path, subtests: pytest.Subtests) -> None:
    """A position, a texture coordinate or a face, by its line."""
    for broken in ("v 1 0", "v 1 1 x", "vt a b", "f 1 2", "f 1 4 9", "f 1 z 4"):
        with subtests.test(broken):
            (tmp_path / "a.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\n{broken}\nf 1 3 4\n")
            told = [(one.severity, one.line) for one in found(tmp_path)]
            assert told == [(E, 6)]


def test_broken_words_of_ascii_files_are_told(tmp_path: Path) -> None:
    """The first word of a PLY that is no number, by its line; a facet of an STL, without it."""
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    header += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(header + "0 0 0\n1 zero 0\n0 1 none\n3 0 1 2\n")
    assert [one.line for one in found(tmp_path / "a.ply") if one.severity is E] == [11]
    corners = "facet\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    text = f"solid a\n{corners}{corners}endsolid a\n".replace("vertex 1 0 0", "vertex 1 ? 0", 1)
    (tmp_path / "a.stl").write_text(text)
    assert ["three numbers" in one.what for one in found(tmp_path / "a.stl") if one.severity is E] == [True]


def test_a_broken_accessor_of_a_gltf_is_told(tmp_path: Path) -> None:
    """By its line in the text; a face beyond the vertices by that of its indices."""
    data = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes() + np.array([0, 1, 7], "<u2").tobytes()
    views = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}]
    accessors: list[dict[str, object]] = [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
    ]
    document = {
        "asset": {"version": "2.0"}, "accessors": accessors, "bufferViews": views, "nodes": [{"mesh": 0}],
        "buffers": [{"uri": "data.bin", "byteLength": 42}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
    }  # fmt: skip
    (tmp_path / "data.bin").write_bytes(data)

    def told() -> list[tuple[int, str]]:
        (tmp_path / "a.gltf").write_text(json.dumps(document, indent=1))
        return [(one.line, one.what) for one in found(tmp_path) if one.severity is E]

    assert told() == [(12, "a face uses vertex 7, its primitive has 3 (node_0)")]
    accessors[1]["count"] = 4
    assert [line for line, _ in told()] == [12]


def test_faces_without_area_and_beyond_the_vertices_are_told(tmp_path: Path) -> None:
    """A few slivers are a note, many a warning."""
    (tmp_path / "a.obj").write_text(SQUARE + "f 1 1 2\n")
    assert [(one.severity, "1 of 3 faces" in one.what) for one in found(tmp_path)] == [(W, True)]
    (tmp_path / "a.obj").write_text(SQUARE * 8 + "f 1 1 2\n")
    assert [one.severity for one in found(tmp_path)] == [N]


def test_what_is_a_scene(tmp_path: Path) -> None:
    """Annotated folders, single meshes, SuGaR's tree and numbered folders, at any depth; results and caches are not."""
    tree = "rooms/c/coarse_mesh/c/sugarmesh_x.ply"
    for name in (tree, "rooms/a/labels.json", "rooms/b/only.obj", "cache/x/labels.json", "objects/one.obj",
                 "objects/two.glb", "0001_839920/readme.txt", "notes/text.txt", "rooms/b/textures/x.png"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    findings = Findings()
    layout = layout_of(tmp_path, findings)
    assert [str(path.relative_to(tmp_path)) for path in layout.scenes] == [
        "0001_839920",
        "rooms/a",
        "rooms/b",
        "rooms/c",
    ]
    assert [path.name for path in layout.meshes] == ["one.obj", "two.glb"]
    assert [(one.path.name, one.severity) for one in findings.all()] == [("notes", N)]
    check_scene(layout.scenes[0], findings)
    assert any("no mesh" in one.what and one.severity is E for one in findings.all())
