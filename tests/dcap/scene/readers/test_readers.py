"""Mesh files: what is read equals what was written; what is broken is refused with one line before it costs memory."""

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mesh_files import CUBE, QUADS, cube_document, glb, refusal, scan_of, volume, write_obj, write_ply
from PIL import Image

from dcap.scene.readers.frame import Role


@pytest.mark.parametrize("order", ["a", "<", ">"])
def test_ply_keeps_shape_and_colour_in_every_encoding(tmp_path: Path, order: str) -> None:
    """Ascii, little- and big-endian files of mixed polygons give the same closed cube and its colours."""
    polygons = [*QUADS[:5], [1, 5, 7], [1, 7, 3]]
    mesh = scan_of(write_ply(tmp_path / "cube.ply", order, CUBE, polygons)).mesh
    assert volume(mesh) == pytest.approx(1.0, abs=1e-6)  # float32 corners of size 1
    assert mesh.face_areas.sum() == pytest.approx(6.0, abs=1e-6)
    assert (mesh.colors == [10, 20, 30]).all()


def test_obj_keeps_quads_and_negative_indices(tmp_path: Path) -> None:
    """Quads are cut, not dropped, and indices counted from the end mean the same faces."""
    plain = scan_of(write_obj(tmp_path / "cube.obj", CUBE, QUADS), up="z").mesh
    text = (tmp_path / "cube.obj").read_text().splitlines()
    lines = [x if x[0] == "v" else "f " + " ".join(str(int(i) - 9) for i in x.split()[1:]) for x in text]
    (tmp_path / "negative.obj").write_text("\n".join(lines))
    negative = scan_of(tmp_path / "negative.obj", up="z").mesh
    assert volume(plain) == pytest.approx(1.0)
    np.testing.assert_array_equal(plain.triangles, negative.triangles)


@pytest.mark.parametrize("turn", [0, 3])
def test_concave_polygons_keep_their_area(tmp_path: Path, turn: int) -> None:
    """An L of area 3 is cut into triangles of total area 3, wherever its outline begins."""
    outline = np.roll([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], turn, axis=0)
    vertices = np.c_[outline, np.zeros(6)]
    mesh = scan_of(write_obj(tmp_path / "l.obj", vertices, [list(range(6))]), up="z").mesh
    assert len(mesh.faces) == 4
    assert mesh.face_areas.sum() == pytest.approx(3.0)
    assert (mesh.face_normals[:, 2] > 0).all()


def test_obj_names_its_objects(tmp_path: Path) -> None:
    """`o` lines become node names of the faces that follow them."""
    path = write_obj(tmp_path / "two.obj", CUBE, QUADS)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:8], "o frame", *lines[8:11], "o mattress", *lines[11:]]))
    scan = scan_of(path)
    assert scan.node_names == ("frame", "mattress")
    assert np.bincount(scan.face_node).tolist() == [6, 6]


def textured_square(folder: Path) -> Path:
    """A 1 m square of two triangles whose texture is red on the left and blue on the right half."""
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    pixels[:, :32], pixels[:, 32:] = (255, 0, 0), (0, 0, 255)
    Image.fromarray(pixels).save(folder / "halves.png")
    (folder / "square.mtl").write_text("newmtl cloth\nKd 1 1 1\nmap_Kd halves.png\n")
    (folder / "square.obj").write_text(
        "mtllib square.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl cloth\nf 1/1 2/2 3/3 4/4\n"
    )
    return folder / "square.obj"


def test_texture_survives_on_large_faces(tmp_path: Path) -> None:
    """Faces are cut until the texture's border shows within two target edges, and the area stays."""
    mesh = scan_of(textured_square(tmp_path), up="z").mesh
    assert mesh.face_areas.sum() == pytest.approx(1.0)
    center, color = mesh.triangles.mean(axis=1), mesh.colors[mesh.faces].mean(axis=1)
    # Edges end between 1 % and 2 % of the size; a face reaches one edge across the border.
    left, right = center[:, 0] < 0.5 - 0.04, center[:, 0] > 0.5 + 0.04
    assert (color[left] == [255, 0, 0]).all()
    assert (color[right] == [0, 0, 255]).all()
    assert len(mesh.faces) < 20_000


def stl_bytes() -> bytes:
    """A binary STL cube."""
    triangles = [CUBE[t] for q in QUADS for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])]
    records = [struct.pack("<12fH", 0, 0, 0, *t.ravel(), 0) for t in triangles]
    return b"\0" * 80 + struct.pack("<I", 12) + b"".join(records)


def test_stl_shares_corners(tmp_path: Path) -> None:
    """Twelve facets of a cube share eight vertices, in binary and in ascii."""
    (tmp_path / "binary.stl").write_bytes(stl_bytes())
    mesh = scan_of(tmp_path / "binary.stl").mesh
    corners = "\n".join(
        "facet normal 0 0 0\nouter loop\n" + "\n".join(f"vertex {x} {y} {z}" for x, y, z in t) + "\nendloop\nendfacet"
        for t in mesh.triangles.tolist()
    )
    (tmp_path / "text.stl").write_text(f"solid cube\n{corners}\nendsolid cube\n")
    for name in ("binary.stl", "text.stl"):
        mesh = scan_of(tmp_path / name).mesh
        assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
        assert volume(mesh) == pytest.approx(1.0)


def test_stl_may_end_in_other_bytes_and_hold_several_solids(tmp_path: Path) -> None:
    """Bytes behind the last facet are left alone, and every solid of a text is read, with any line ends."""
    (tmp_path / "more.stl").write_bytes(stl_bytes() + b"\0\0")
    assert len(scan_of(tmp_path / "more.stl").mesh.faces) == 12
    solid = "solid a\rfacet normal 0 0 1\router loop\rvertex {} 0 0\rvertex 1 0 0\rvertex 0 1 0\rendloop\rendfacet\r"
    (tmp_path / "two.stl").write_text(solid.format(0) + "endsolid a\r" + solid.format(-1) + "endsolid a\r")
    assert len(scan_of(tmp_path / "two.stl").mesh.faces) == 2


def test_glb_is_turned_to_z_up(tmp_path: Path) -> None:
    """glTF's y becomes our z, without mirroring."""
    (tmp_path / "crate.glb").write_bytes(glb(*cube_document()))
    scan = scan_of(tmp_path / "crate.glb")
    assert (scan.up, scan.unit_metres, scan.unit_source, scan.node_names) == ("y", 1.0, "format", ("Crate",))
    np.testing.assert_allclose(scan.mesh.bounds, [[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]], atol=1e-6)
    assert volume(scan.mesh) == pytest.approx(1.0, abs=1e-6)


def test_glb_node_tree(tmp_path: Path) -> None:
    """Parents move and name their children; a mirroring node keeps faces outward."""
    document, binary = cube_document()
    document["nodes"] = [
        {"name": "Bed", "children": [1], "translation": [0, 2, 0]},
        {"name": "Frame", "mesh": 0, "scale": [-2, 1, 1]},
    ]
    (tmp_path / "tree.glb").write_bytes(glb(document, binary))
    scan = scan_of(tmp_path / "tree.glb", up="y")
    assert scan.node_names == ("Bed/Frame",)
    np.testing.assert_allclose(scan.mesh.bounds[:, 2], [2.0, 3.0], atol=1e-6)
    assert volume(scan.mesh) == pytest.approx(2.0, abs=1e-5)


def broken_document(change: Callable[[dict[str, object]], None]) -> bytes:
    """A GLB cube after `change`."""
    document, binary = cube_document()
    change(document)
    return glb(document, binary)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["accessors"][0].update(count=10**9),
        lambda d: d["accessors"][0].pop("bufferView") and d["accessors"][0].update(count=10**9),
        lambda d: d["bufferViews"][0].update(byteLength=10**9),
        lambda d: d["buffers"][0].update(byteLength=10**9),
        lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop("POSITION"),
        lambda d: d["nodes"][0].update(mesh=7),
        lambda d: d.update(buffers=[None]),
        lambda d: d["buffers"][0].update(byteLength="x"),
        lambda d: d.update(nodes=[{"mesh": 0, "matrix": [1, 2]}]),
        lambda d: d["accessors"][1].update(componentType=5122, normalized=True),
        lambda d: d["nodes"][0].update(children=[0]),
        lambda d: d.update(meshes={}),
        lambda d: d["accessors"][1].update(type="VEC9"),
        lambda d: d["scenes"][0].update(nodes=[]),
        lambda d: d.update(extensionsRequired=["XYZ_unknown"]),
        lambda d: d["asset"].update(version="1.0"),
        lambda d: d["nodes"][0].update(mesh="0"),
    ],
)
def test_inconsistent_gltf_is_refused(tmp_path: Path, change: Callable[[dict[str, object]], None]) -> None:
    """Accessors beyond their bytes, missing keys, cycles and unknown requirements are one clear line each."""
    (tmp_path / "bad.glb").write_bytes(broken_document(change))
    refusal(tmp_path / "bad.glb")


@pytest.mark.parametrize(
    ("format_line", "vertex", "face", "words"),
    [
        ("format", "float x y z", "list uchar int vertex_indices", "line 2: expected"),
        ("format binary_little_endian 1.0", "float x y z", "int vertex_indices", "expected a list"),
        ("format binary_little_endian 1.0", "", "list uchar int vertex_indices", "without properties"),
        ("format binary_little_endian 1.0", "list x y z", "list uchar int vertex_indices", "no property 'x' of one"),
        ("format ascii 1.0", "float x y z", "list float int vertex_indices", "floating-point type"),
    ],
)  # fmt: skip
def test_ply_headers_that_promise_the_wrong_kind_are_refused(
    tmp_path: Path, format_line: str, vertex: str, face: str, words: str
) -> None:
    """A header that reads like one but declares what no mesh has is one line that says what."""
    kind, *axes = vertex.split() or [""]
    kind = "list uchar float" if kind == "list" else kind
    lines = ["ply", format_line, "element vertex 2", *(f"property {kind} {axis}" for axis in axes), "element face 1",
             f"property {face}", "end_header"]  # fmt: skip
    zeros = "0 0 0\n0 0 0\n0\n" if "ascii" in format_line else "\0" * 80
    (tmp_path / "x.ply").write_text("\n".join(lines) + "\n" + zeros)
    assert words in refusal(tmp_path / "x.ply")


def test_a_tree_of_nodes_is_walked_once(tmp_path: Path) -> None:
    """A very deep chain, and nodes that share their children (2^40 paths), are refused without walking them."""
    for count, children, words in ((2000, 1, "256 nodes deep"), (40, 2, "two parents")):
        document, binary = cube_document()
        document["nodes"] = [{"children": [i + 1] * children} for i in range(count)] + [{"mesh": 0}]
        (tmp_path / "tree.glb").write_bytes(glb(document, binary))
        assert words in refusal(tmp_path / "tree.glb")


BASES = {
    "ascii.ply": "a",
    "little.ply": "<",
    "big.ply": ">",
    "cube.obj": "obj",
    "cube.glb": "glb",
    "cube.gltf": "gltf",
    "binary.stl": "stl",
}
"""A sound file of every format and encoding."""


def sound_file(folder: Path, name: str) -> Path:
    """A cube in the format of the name."""
    path, kind = folder / name, BASES[name]
    if kind in ("a", "<", ">"):
        return write_ply(path, kind, CUBE, QUADS)
    if kind == "obj":
        return write_obj(path, CUBE, QUADS)
    document, binary = cube_document()
    uri = "data:;base64," + base64.b64encode(binary).decode()
    plain = json.dumps(document | {"buffers": [{"byteLength": len(binary), "uri": uri}]}).encode()
    path.write_bytes({"glb": glb(document, binary), "gltf": plain, "stl": stl_bytes()}[kind])
    return path


def test_bad_input_is_one_line(tmp_path: Path) -> None:
    """Missing, empty, faceless, not finite, without area, out of range, unknown format: each is refused."""
    assert "no such file" in refusal(tmp_path / "gone.obj")
    (tmp_path / "empty.ply").write_bytes(b"")
    assert "empty" in refusal(tmp_path / "empty.ply")
    (tmp_path / "scene.max").write_text("1 2 3")
    assert ".glb" in refusal(tmp_path / "scene.max")
    assert "8 points, expected at least 100" in refusal(write_ply(tmp_path / "points.ply", "<", CUBE, []))
    nan = np.where(np.arange(24).reshape(8, 3) == 7, np.nan, CUBE)
    assert "vertex 2 is not finite" in refusal(write_ply(tmp_path / "nan.ply", "<", nan, QUADS))
    assert "vertex 2 is not finite" in refusal(write_obj(tmp_path / "nan.obj", nan, QUADS))
    flat = write_obj(tmp_path / "flat.obj", CUBE, [[0, 1, 1], [2, 3, 2]])
    assert "zero area" in refusal(flat)
    assert "line 9" in refusal(write_obj(tmp_path / "far.obj", CUBE, [[0, 1, 99]]))
    (tmp_path / "words.obj").write_text("v 0 0 x\nf 1 1 1\n")
    assert "'v'" in refusal(tmp_path / "words.obj")
    (tmp_path / "short.stl").write_bytes(stl_bytes()[:-60])
    assert "truncated" in refusal(tmp_path / "short.stl")


def test_a_mesh_a_thousand_times_too_large_is_refused(tmp_path: Path) -> None:
    """A cube of 1 km is refused in every format and role, naming its size and the option that settles it."""
    (tmp_path / "huge.glb").write_bytes(glb(*cube_document(scale=1000.0)))
    for path in (tmp_path / "huge.glb", write_obj(tmp_path / "huge.obj", 1000 * CUBE, QUADS)):
        assert "1000" in refusal(path)
        assert "--unit" in refusal(path)
        assert "--object-unit" in refusal(path, Role.OBJECT)
        assert scan_of(path, unit="mm").mesh.bounds[1, 2] == pytest.approx(1.0, rel=1e-6)
    assert "--object-unit" in refusal(write_obj(tmp_path / "tiny.obj", 1e-4 * CUBE, QUADS), Role.OBJECT)


@pytest.mark.parametrize("name", sorted(BASES))
def test_more_faces_than_memory_holds_are_refused(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Triangles are counted, not polygons: six quads are twelve faces, and one too many is refused in every format."""
    path = sound_file(tmp_path, name)
    monkeypatch.setattr("dcap.scene.readers.mesh.raw.MAX_FACES", 12)
    assert len(scan_of(path).mesh.faces) == 12
    monkeypatch.setattr("dcap.scene.readers.mesh.raw.MAX_FACES", 11)
    assert "12 faces > 11; decimate" in refusal(path)


@pytest.mark.parametrize("name", sorted(set(BASES) - {"binary.stl"}))
def test_more_vertices_than_memory_holds_are_refused(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of many vertices and few faces is refused too."""
    path = sound_file(tmp_path, name)
    monkeypatch.setattr("dcap.scene.readers.mesh.raw.MAX_CORNERS", 7)
    assert "8 vertices > 7; decimate" in refusal(path)


@pytest.mark.parametrize("order", ["a", "<"])
def test_ply_comments_may_hold_the_words_of_a_header(tmp_path: Path, order: str) -> None:
    """A header ends at the line `end_header`, not where a comment says the word."""
    path = write_ply(tmp_path / "cube.ply", order, CUBE, QUADS)
    said = b"comment the end_header comes later\nobj_info end_header_not\ncomment element vertex 99\n"
    path.write_bytes(path.read_bytes().replace(b"comment made by a test\n", said))
    assert volume(scan_of(path).mesh) == pytest.approx(1.0, abs=1e-6)  # float32 corners of size 1


def test_obj_lines_may_end_in_a_comment(tmp_path: Path) -> None:
    """What follows a # is no number; a name may hold the sign."""
    path = write_obj(tmp_path / "cube.obj", CUBE, QUADS)
    lines = [f"{line} # {number}" for number, line in enumerate(path.read_text().splitlines())]
    path.write_text("o crate #1\n" + "\n".join(lines))
    scan = scan_of(path)
    assert volume(scan.mesh) == pytest.approx(1.0)
    assert scan.node_names == ("crate #1",)


def test_a_byte_order_mark_hides_nothing(tmp_path: Path) -> None:
    """Neither the first vertex, by which all faces would count from the next one, nor the first material."""
    path = write_obj(tmp_path / "cube.obj", CUBE, QUADS)
    text = path.read_text()
    path.write_text(text.replace("f ", "usemtl red\nf ", 1) + "\nv 9 9 9\nmtllib cube.mtl\n", encoding="utf-8-sig")
    (tmp_path / "cube.mtl").write_text("newmtl red\nKd 1 0 0\n", encoding="utf-8-sig")
    mesh = scan_of(path).mesh
    assert volume(mesh) == pytest.approx(1.0)
    assert (mesh.colors == [255, 0, 0]).all()
    path.write_text(text, encoding="utf-16")
    assert "UTF-16" in refusal(path)


MATERIALS = "newmtl Material #1\nKd 1 0 0\nnewmtl Material #2\nKd 0 1 0\nnewmtl sky # at noon\nKd 0 0 1\n"


@pytest.mark.parametrize(
    ("name", "color"),
    [
        ("Material #1", (255, 0, 0)),
        ("Material #1 # of the lid", (255, 0, 0)),
        ("sky # at noon", (0, 0, 255)),
        ("Material #3", None),
    ],
)
def test_a_material_is_found_by_its_name_or_missing_by_name(
    tmp_path: Path, name: str, color: tuple[int, int, int] | None
) -> None:
    """With a comment behind it on one side; what no library has is grey and told, never the colour of another."""
    path = write_obj(tmp_path / "cube.obj", CUBE, QUADS)
    path.write_text(f"mtllib cube.mtl\nusemtl {name}\n" + path.read_text())
    (tmp_path / "cube.mtl").write_text(MATERIALS)
    scan = scan_of(path)
    assert (scan.mesh.colors == (color or (200, 200, 200))).all()
    assert any(repr(name) in note for note in scan.notes) == (color is None)


def test_triangle_strips_of_a_ply_are_refused_by_name(tmp_path: Path) -> None:
    """They are faces, so that the file is no point cloud."""
    path = tmp_path / "strip.ply"
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {axis}\n" for axis in "xyz")
    head += "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    path.write_text(head + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    assert "triangle strips" in refusal(path)


def test_a_vertex_that_no_face_uses_does_not_count(tmp_path: Path) -> None:
    """Neither in the size of the thing nor in what the file's unit is taken to be."""
    path = write_obj(tmp_path / "cube.obj", CUBE, QUADS)
    plain = scan_of(path)
    path.write_text("v 90 90 90\n" + "\n".join(shifted(line) for line in path.read_text().splitlines()))
    scan = scan_of(path)
    assert scan.mesh.bounds == pytest.approx(plain.mesh.bounds)
    assert len(scan.mesh.vertices) == len(plain.mesh.vertices)
    assert volume(scan.mesh) == pytest.approx(1.0)


def shifted(line: str) -> str:
    """A line of an OBJ file whose faces count from a vertex further on."""
    if not line.startswith("f "):
        return line
    return "f " + " ".join(str(int(word.split("/")[0]) + 1) for word in line.split()[1:])


def test_a_concave_face_of_very_many_corners_is_refused(tmp_path: Path) -> None:
    """Cutting it takes memory with the square of its corners; a convex one is a fan, however large."""
    turn = np.linspace(0.0, 2.0 * np.pi, 5000, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(5000)], axis=1)
    area = scan_of(write_obj(tmp_path / "disc.obj", ring, [list(range(5000))]), up="z", unit="m").mesh.face_areas.sum()
    assert area == pytest.approx(np.pi, rel=1e-5)  # of the polygon: 1 - (2 pi / n)^2 / 6
    star = ring * (1.0 + 0.2 * np.cos(40.0 * turn))[:, None]
    assert "5000 corners > 4096" in refusal(write_obj(tmp_path / "star.obj", star, [list(range(5000))]))


BROKEN_OBJ = [
    *((f"v 0 0 0\nv 1 0 0\nv 1 1 0\nf {face}\n", "line 4")
      for face in ("/1 /2 /3", "1 2 --3", "1 2 99999999999999999999", "1//2 1/2/3 /4", "1 2 3.5")),
    *((f"# x\nv 0 0 0\nv 1 0 0\nvt 0 0\n{line}\nv 1 1 0\nf 1 2 3\n", "line 5:")
      for line in ("v 0 0 x", "v 0 0", "vt", "vt a")),
]  # fmt: skip
"""Missing positions, double signs, numbers beyond any count and words for numbers, and the line that is named."""


def test_what_is_broken_in_an_obj_is_named_by_its_line(tmp_path: Path) -> None:
    """A face or number that is none is refused at its line."""
    told = []
    for number, (text, _) in enumerate(BROKEN_OBJ):
        (tmp_path / f"{number}.obj").write_text(text)
        told.append(refusal(tmp_path / f"{number}.obj"))
    assert [text for text, (_, line) in zip(told, BROKEN_OBJ, strict=True) if line not in text] == []
