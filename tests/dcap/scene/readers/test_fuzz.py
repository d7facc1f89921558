"""Broken files of every format are read or refused with one line that names the file: no other exception, no flood.

The fast tests try a few changes per format; the slow one more, `$DCAP_FUZZ_EXAMPLES` of them per format.
"""

import base64
import json
import os
import struct
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from PIL import Image
from splat_files import sog, splat_records, spz

from dcap.scene.checks.findings import Findings
from dcap.scene.checks.scene_folder import check_scene
from dcap.scene.errors import DcapError, Severity
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.readers.source_files import source_files
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.gaussians import write_compressed_splats, write_splats
from dcap.scene.writers.glb import Node, glb_bytes
from dcap.scene.writers.meshes import write_object, write_ply

MANY = int(os.environ.get("DCAP_FUZZ_EXAMPLES", "50"))
"""Changes per format that the slow test tries."""

Image.init()  # imported at the first picture of no usual format: no memory that a broken file takes


def grid(cells: int) -> Mesh:
    """A bumpy square of 2 m."""
    u, v = np.meshgrid(np.linspace(0, 2, cells + 1), np.linspace(0, 2, cells + 1), indexing="ij")
    points = np.stack([u.ravel(), v.ravel(), 0.1 * np.sin(3 * u * v).ravel()], axis=1)
    i = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.stack([i, i + cells + 1, i + cells + 2, i + 1], axis=1)
    shade = (np.arange(len(points) * 3).reshape(-1, 3) % 256).astype(np.uint8)
    return Mesh.of(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]), shade)


def gaussians(count: int) -> Gaussians:
    """Flat opaque ones on a square of 2 m, with harmonics of degree 1."""
    random = np.random.default_rng(0)
    position = random.uniform(0, 2, (count, 3)) * [1, 1, 0.01]
    turn = np.tile([1.0, 0, 0, 0], (count, 1))
    harmonics = random.uniform(-1, 1, (count, 3, 3))
    flat = np.log([[0.05, 0.05, 0.001]]) + 0 * position
    fields = (position, flat, turn, np.full(count, 3.0), 0 * position, harmonics)
    return Gaussians(*(np.asarray(f, dtype=np.float32) for f in fields))


def polygons_ply(order: str, cells: int) -> bytes:
    """A PLY whose faces have three or four corners."""
    mesh = grid(cells)
    name = {"a": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order]
    faces = [f.tolist() for f in mesh.faces] + [[0, 1, 2, 3]]
    head = f"ply\nformat {name} 1.0\nelement vertex {len(mesh.vertices)}\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    head += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nproperty uchar red\nend_header\n"
    if order == "a":
        rows = [" ".join(f"{x:.4f}" for x in v) for v in mesh.vertices]
        return (head + "\n".join(rows + [" ".join(map(str, [len(f), *f, 7])) for f in faces])).encode()
    body = mesh.vertices.astype(order + "f4").tobytes()
    return head.encode() + body + b"".join(struct.pack(f"{order}B{len(f)}iB", len(f), *f, 7) for f in faces)


def stl(cells: int) -> bytes:
    """A binary STL."""
    corners = grid(cells).triangles.astype("<f4")
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["corner"] = corners
    return b"\0" * 80 + struct.pack("<I", len(rows)) + rows.tobytes()


def stl_text() -> bytes:
    """An ascii STL."""
    facets = "\n".join(
        "facet normal 0 0 1\nouter loop\n" + "\n".join(f"vertex {x} {y} {z}" for x, y, z in t) + "\nendloop\nendfacet"
        for t in grid(1).triangles.tolist()
    )
    return f"solid x\n{facets}\nendsolid x\n".encode()


def textured(folder: Path, cells: int) -> None:
    """crate.obj, its MTL and texture."""
    write_object(folder / "crate.obj", [("crate", grid(cells))])
    plain = (folder / "crate.obj").read_text().replace("\nf ", "\no top\nusemtl wood\nf ", 1)
    (folder / "crate.obj").write_text(f"mtllib crate.mtl\nvt 0 0\nvt 1 1\n{plain}f 1/1 2/2 3/-1 4/1\nf -1 -2 -3\n")
    (folder / "crate.mtl").write_text("newmtl wood\nKd 0.5 0.4 0.3\nmap_Kd wood.png\n")
    Image.fromarray(np.full((4, 4, 3), 90, np.uint8)).save(folder / "wood.png")


def gltf(folder: Path, *, apart: bool) -> None:
    """crate.gltf with a node tree, a texture, a sparse accessor, and its buffer inside or beside it."""
    data = glb_bytes([Node("bed", label="bed", children=(Node("frame", grid(2)), Node("pillow", grid(1))))])
    size = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    Image.fromarray(np.full((4, 4, 3), 90, np.uint8)).save(folder / "wood.png")
    picture = base64.b64encode((folder / "wood.png").read_bytes()).decode()
    document["images"] = [{"uri": f"data:image/png;base64,{picture}"}]
    document["textures"] = [{"source": 0}]
    document["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    first = document["meshes"][0]["primitives"][0]
    first["material"] = 0
    first["attributes"]["TEXCOORD_0"] = len(document["accessors"])
    document["accessors"].append(
        {"componentType": 5126, "count": 9, "type": "VEC2",
         "sparse": {"count": 2, "indices": {"bufferView": 2, "componentType": 5125}, "values": {"bufferView": 0}}}
    )  # fmt: skip
    document["nodes"][0] |= {"rotation": [0, 0.6, 0, 0.8], "scale": [1, 1, 2]}
    uri = "crate.bin" if apart else "data:;base64," + base64.b64encode(binary).decode()
    document["buffers"] = [{"byteLength": len(binary), "uri": uri}]
    (folder / "crate.bin").write_bytes(binary)
    (folder / "crate.gltf").write_text(json.dumps(document))


def interiorgs(folder: Path) -> None:
    """A scene folder with boxes, a wall, a window and a mesh."""
    corners = [{"x": x, "y": y, "z": z} for x in (0, 1) for y in (0, 1) for z in (0, 0.5)]
    (folder / "labels.json").write_text(
        json.dumps([{"ins_id": "7", "label": "Bed", "bounding_box": corners}, {"label": "room"}])
    )
    (folder / "structure.json").write_text(
        json.dumps({
            "rooms": [{"profile": [[0, 0], [2, 0], [2, 2]], "room_type": "Hall"}],
            "walls": [{"location": [[0, 0], [2, 0]], "thickness": 0.1, "height": 2.5}],
            "holes": [{"profile": [[0.5, 0, 1], [1, 0, 1], [1, 0, 2]], "type": "WINDOW", "thickness": 0.1}],
        })
    )  # fmt: skip
    write_ply(folder / "sugarmesh_1.ply", grid(2))


def scannet(folder: Path) -> None:
    """A scene with two instances and an alignment."""
    mesh = grid(2)
    write_ply(folder / "s_vh_clean_2.ply", mesh)
    (folder / "s_vh_clean_2.0.010000.segs.json").write_text(
        json.dumps({"sceneId": "s", "segIndices": [10 + i // 3 for i in range(len(mesh.vertices))]})
    )
    (folder / "s.aggregation.json").write_text(
        json.dumps({"sceneId": "s", "segGroups": [
            {"id": 0, "objectId": 0, "segments": [10, 11], "label": "Bed"},
            {"id": 1, "objectId": 1, "segments": [12], "label": "floor"},
        ]})
    )  # fmt: skip
    (folder / "s.txt").write_text("axisAlignment = 1 0 0 0.5 0 1 0 0 0 0 1 0 0 0 0 1\n")


@dataclass(frozen=True)
class Format:
    """How a sound file is made, and which of its files is broken."""

    make: Callable[[Path], object]
    """Writes into a folder."""
    broken: str
    """Name of the file that is changed."""
    read: str = ""
    """Name of the file that is read, `.` for the folder; empty: the changed one."""


FORMATS = {
    "glb": Format(lambda f: write_object(f / "a.glb", [("bed", grid(2))]), "a.glb"),
    "gltf": Format(lambda f: gltf(f, apart=False), "crate.gltf"),
    "gltf buffer": Format(lambda f: gltf(f, apart=True), "crate.bin", "crate.gltf"),
    "obj": Format(lambda f: textured(f, 2), "crate.obj"),
    "mtl": Format(lambda f: textured(f, 1), "crate.mtl", "crate.obj"),
    "texture": Format(lambda f: textured(f, 1), "wood.png", "crate.obj"),
    "ply": Format(lambda f: write_ply(f / "a.ply", grid(2)), "a.ply"),
    "ply ascii": Format(lambda f: (f / "a.ply").write_bytes(polygons_ply("a", 2)), "a.ply"),
    "ply little": Format(lambda f: (f / "a.ply").write_bytes(polygons_ply("<", 2)), "a.ply"),
    "ply big": Format(lambda f: (f / "a.ply").write_bytes(polygons_ply(">", 2)), "a.ply"),
    "stl": Format(lambda f: (f / "a.stl").write_bytes(stl(2)), "a.stl"),
    "stl ascii": Format(lambda f: (f / "a.stl").write_bytes(stl_text()), "a.stl"),
    "splats": Format(lambda f: write_splats(f / "a.ply", gaussians(9)), "a.ply"),
    "splats compressed": Format(lambda f: write_compressed_splats(f / "a.ply", gaussians(300)), "a.ply"),
    "splat": Format(lambda f: (f / "a.splat").write_bytes(splat_records(gaussians(300))), "a.splat"),
    "spz 2": Format(lambda f: (f / "a.spz").write_bytes(spz(gaussians(300), 2)), "a.spz"),
    "spz 3": Format(lambda f: (f / "a.spz").write_bytes(spz(gaussians(300), 3)), "a.spz"),
    "sog": Format(lambda f: (f / "a.sog").write_bytes(sog(gaussians(300))), "a.sog"),
    "interiorgs labels": Format(interiorgs, "labels.json", "."),
    "interiorgs structure": Format(interiorgs, "structure.json", "."),
    "scannet segments": Format(scannet, "s_vh_clean_2.0.010000.segs.json", "."),
    "scannet groups": Format(scannet, "s.aggregation.json", "."),
    "scannet alignment": Format(scannet, "s.txt", "."),
    "scannet mesh": Format(scannet, "s_vh_clean_2.ply", "."),
}

SPLATS = ("splats", "splat", "spz", "sog")
"""Formats of Gaussians."""

TREES = ("gltf", "interiorgs labels", "interiorgs structure", "scannet segments", "scannet groups")
"""Formats whose broken file is JSON."""

LIES = [b"0", b"-1", b"255", b"4294967295", b"99999999999999999999", b"1e308", b"nan", b"null", b"[]", b"{}", b'"x"']
BINARY_LIES = [b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0\0\0\0", b"\0\0\xc0\x7f"]

Change = tuple[str, float, float, bytes]
"""Kind, where (a share of the file), how much, and what is put there."""

changes = st.lists(
    st.tuples(
        st.sampled_from(["cut", "flip", "delete", "insert", "repeat", "number", "swap"]),
        st.one_of(st.floats(0, 1), st.floats(0, 0.15)),
        st.floats(0, 1),
        st.one_of(st.sampled_from(LIES + BINARY_LIES), st.binary(min_size=1, max_size=8)),
    ),
    min_size=1,
    max_size=3,
)


def changed(data: bytes, made: list[Change]) -> bytes:
    """The file after some changes."""
    for kind, where, much, what in made:
        at = int(where * len(data))
        length = 1 + int(much * much * 64)
        if kind == "cut":
            data = data[:at]
        elif kind == "flip":
            data = data[:at] + bytes(b ^ (1 + int(much * 254)) for b in data[at : at + 1]) + data[at + 1 :]
        elif kind == "delete":
            data = data[:at] + data[at + length :]
        elif kind == "insert":
            data = data[:at] + what + data[at:]
        elif kind == "repeat":
            data = data[:at] + data[at : at + length] * 3 + data[at + length :]
        elif kind == "swap":
            data = data[:at] + what + data[at + len(what) :]
        else:  # the next number in the text becomes another one
            start = next((i for i in range(at, len(data)) if data[i : i + 1].isdigit()), len(data))
            end = next((i for i in range(start, len(data)) if not data[i : i + 1].isdigit()), len(data))
            data = data[:start] + what + data[end:]
    return data


VALUES: tuple[object, ...] = (
    None, True, -1, 0, 7, 2**31, 2**70, 1e308, -0.5, float("nan"), float("inf"), "", "x", "\ud800", "a\nb", [], [[]],
    {}, {"a": 1}, [0] * 9,
)  # fmt: skip
"""What the values of a JSON tree are replaced by."""

replacements = st.lists(st.tuples(st.floats(0, 1), st.sampled_from(range(len(VALUES) + 1))), min_size=1, max_size=3)
"""Where in the tree, and which value; the last number: taken away."""


def other_tree(text: str, made: list[tuple[float, int]]) -> str:
    """A JSON text with other values in some places."""
    for where, which in made:
        tree = json.loads(text)
        places: list[tuple[Any, Any]] = []
        waiting = [tree]
        while waiting:
            one = waiting.pop()
            keys = list(one) if isinstance(one, dict) else range(len(one)) if isinstance(one, list) else ()
            places += [(one, key) for key in keys]
            waiting += [one[key] for key in keys]
        if places:
            parent, key = places[int(where * (len(places) - 1))]
            if which < len(VALUES):
                parent[key] = VALUES[which]
            else:
                del parent[key]
        text = json.dumps(tree)
    return text


def mesher(splats: Gaussians | PointCloud) -> tuple[Mesh, tuple[str, ...]]:
    """Stands for the surface of splats."""
    return grid(1), ()


def outcome(path: Path) -> Scan | str:
    """What a user gets: a scan, or a line that names one of the files."""
    try:
        source_files(path)
        return read_scan(path, SourceOptions(), Role.SCENE, mesher=mesher)
    except DcapError as error:
        return str(error)


MOST_MEMORY = 6e6  # bytes; the files have a few thousand
ValueT = TypeVar("ValueT")


def traced(read: Callable[[], ValueT]) -> tuple[ValueT, int]:
    """What it returns, and the most memory that it took [bytes]; of two times, as what is imported at the first use of
    a reader or of a message is not what a broken file takes."""
    for _ in range(2):
        tracemalloc.start()
        result, peak = read(), tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        if peak < MOST_MEMORY:
            break
    return result, peak


def try_file(folder: Path, name: str, change: Callable[[bytes], bytes]) -> Scan | str:
    """Break a sound file and read it."""
    one = FORMATS[name]
    one.make(folder)
    path = folder / one.broken
    path.write_bytes(change(path.read_bytes()))
    result, peak = traced(lambda: outcome(folder / (one.read or one.broken)))
    if isinstance(result, str):
        assert str(folder) in result
        assert "\n" not in result
        assert len(result) < 2000
    assert peak < MOST_MEMORY
    return result


def try_check(folder: Path, name: str, change: Callable[[bytes], bytes]) -> None:
    """Break a sound file, read it and check it: what is refused is told as an error.

    But for what is refused only when units are found: sizes that fit no thing, and splats that make no surface.
    """
    result = try_file(folder, name, change)
    findings, place = Findings(), folder / (FORMATS[name].read or FORMATS[name].broken)
    peak = traced(lambda: check_scene(place, findings))[1]
    assert peak < MOST_MEMORY
    if isinstance(result, str) and "set --unit" not in result and name.split()[0] not in SPLATS:
        assert findings.count(Severity.ERROR), result


@pytest.mark.parametrize("name", FORMATS)
def test_the_unbroken_file_is_read(tmp_path: Path, name: str) -> None:
    """Or the tests below would break what was broken."""
    FORMATS[name].make(tmp_path)
    assert isinstance(outcome(tmp_path / (FORMATS[name].read or FORMATS[name].broken)), Scan)


LARGE = 60
"""Cells along a side of the meshes, hundreds of Gaussians, in the files whose headers lie."""

COUNTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "ply vertices": (lambda p: write_ply(p, grid(LARGE)), f"vertex {(LARGE + 1) ** 2}"),
    "ply faces": (lambda p: write_ply(p, grid(LARGE)), f"face {2 * LARGE**2}"),
    "ply ascii vertices": (lambda p: p.write_bytes(polygons_ply("a", LARGE)), f"vertex {(LARGE + 1) ** 2}"),
    "ply ascii faces": (lambda p: p.write_bytes(polygons_ply("a", LARGE)), f"face {2 * LARGE**2 + 1}"),
    "ply polygons": (lambda p: p.write_bytes(polygons_ply("<", LARGE)), f"face {2 * LARGE**2 + 1}"),
    "ply polygons big": (lambda p: p.write_bytes(polygons_ply(">", LARGE)), f"face {2 * LARGE**2 + 1}"),
    "splats": (lambda p: write_splats(p, gaussians(100 * LARGE)), f"vertex {100 * LARGE}"),
    "splats packed": (lambda p: write_compressed_splats(p, gaussians(100 * LARGE)), f"vertex {100 * LARGE}"),
    "splats chunks": (lambda p: write_compressed_splats(p, gaussians(100 * LARGE)), f"chunk {-(-100 * LARGE // 256)}"),
    "splats harmonics": (lambda p: write_compressed_splats(p, gaussians(100 * LARGE)), f"sh {100 * LARGE}"),
    "gltf values": (lambda p: plain_gltf(p), f'"count": {(LARGE + 1) ** 2}'),
    "gltf view": (lambda p: plain_gltf(p), f'"byteLength": {12 * (LARGE + 1) ** 2}'),
}  # fmt: skip
"""What writes a large file, and where its header states a count."""


def plain_gltf(path: Path) -> None:
    """A glTF text with its buffer inside."""
    data = glb_bytes([Node("bed", grid(LARGE))])
    size = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    document["buffers"] = [
        {"byteLength": len(binary), "uri": "data:;base64," + base64.b64encode(binary).decode()}
    ]  # fmt: skip
    path.write_text(json.dumps(document))


RARE = ("ply faces", "ply ascii vertices", "ply polygons big", "splats chunks", "splats harmonics", "gltf view")
"""Counts that are tried with the slow tests."""


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in RARE else name for name in COUNTS]
)
def test_counts_that_lie_cost_no_memory(tmp_path: Path, name: str) -> None:
    """Each is compared with the file's length before anything is allocated: four times what is there at the most."""
    write, stated = COUNTS[name]
    path = tmp_path / ("a.gltf" if "gltf" in name else "a.ply")
    write(path)
    whole = path.read_bytes()
    sound = outcome(path)
    assert isinstance(sound, Scan)
    there = len(whole) + sum(a.nbytes for a in (sound.mesh.vertices, sound.mesh.faces, sound.mesh.colors))
    word, number = stated.rsplit(" ", 1)
    assert stated.encode() in whole
    for lie in (int(number) + 1, int(number) * 5 // 4, int(number) * 3, 10**7, 2**31 - 1, 2**63, 10**30):
        path.write_bytes(whole.replace(stated.encode(), f"{word} {lie}".encode(), 1))
        tracemalloc.start()
        line = outcome(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        if isinstance(line, Scan):  # a view may be longer than its accessor
            assert lie < len(whole)
            continue
        assert str(path) in line
        assert peak < 4 * there + 1.2e6, (lie, line)  # a megabyte is read to tell splats from meshes


def test_a_binary_stl_that_lies_costs_no_memory(tmp_path: Path) -> None:
    """Its count is no text."""
    for count in (2 * LARGE**2 + 1, 10**6, 2**32 - 1):
        data = bytearray(stl(LARGE))
        data[80:84] = struct.pack("<I", count)
        (tmp_path / "a.stl").write_bytes(data)
        tracemalloc.start()
        line = outcome(tmp_path / "a.stl")
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert "truncated" in str(line)
        assert peak < len(data) + 1e5


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", FORMATS)
@given(made=changes, values=replacements)
@example(
    made=[("swap", 0.0, 0.0, b"\xff\xff\xff\xff")], values=[(0.0, 0), (1.0, 7)]
)  # nan in a buffer, 1e300 m in JSON
@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True)
def test_a_broken_file_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, made: list[Change], values: list[tuple[float, int]]
) -> None:
    """Cut, flipped, shortened, repeated, with other numbers or values: a scan or one line, and a check that says so."""
    try_check(tmp_path_factory.mktemp("fuzz"), name, lambda data: changed(data, made))
    if name in TREES:
        try_check(tmp_path_factory.mktemp("fuzz"), name, lambda data: other_tree(data.decode(), values).encode())


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", FORMATS)
@given(made=changes, values=replacements)
@settings(max_examples=MANY, deadline=None, suppress_health_check=list(HealthCheck))
def test_many_broken_files_are_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, name: str, made: list[Change], values: list[tuple[float, int]]
) -> None:
    """The same many times over, with changes that differ from run to run."""
    try_check(tmp_path_factory.mktemp("fuzz"), name, lambda data: changed(data, made))
    if name in TREES:
        try_check(tmp_path_factory.mktemp("fuzz"), name, lambda data: other_tree(data.decode(), values).encode())
