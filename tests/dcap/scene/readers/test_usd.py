"""USD: polygons, transforms, instances, unit and axis; what is missing or broken is one line."""

import sys
from pathlib import Path

import numpy as np
import pytest
from mesh_files import volume
from PIL import Image
from textured import quarters

from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.scenes.sugar import find_mesh
from dcap.scene.readers.source import read_scan, read_surface
from dcap.scene.readers.source_files import companions
from dcap.scene.readers.usd.usd import read_usd
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.gaussians import write_splats
from tasks.segment.stage import SegmentConfig, segment

CUBE = """
        point3f[] points = [(0,0,0), (0,0,1), (0,1,0), (0,1,1), (1,0,0), (1,0,1), (1,1,0), (1,1,1)]
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0,1,3,2, 4,6,7,5, 0,4,5,1, 2,3,7,6, 0,2,6,4, 1,5,7,3]
"""
"""A unit cube of quads, outward."""

ROOM = f"""#usda 1.0
(
    defaultPrim = "World"
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Xform "World"
{{
    double3 xformOp:scale = (100, 100, 100)
    uniform token[] xformOpOrder = ["xformOp:scale"]
    def Mesh "Chair_1" {{
        color3f[] primvars:displayColor = [(1, 0, 0)]
        {CUBE}
    }}
    def Xform "Chair_2" (
        instanceable = true
        references = </Prototype>
    ) {{
        double3 xformOp:translate = (3, 0, 0)
        double3 xformOp:scale = (-1, 1, 2)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }}
    def Mesh "Hidden" {{
        token visibility = "invisible"
        {CUBE}
    }}
    def Sphere "Ball" {{
        double radius = 1
    }}
}}
class Xform "Prototype" {{
    def Mesh "Body" {{
        {CUBE}
    }}
}}
"""


def scan_of(folder: Path, text: str, name: str = "room.usda") -> Scan:
    """Read a text as a scene."""
    (folder / name).write_text(text)
    return read_scan(folder / name, SourceOptions(), Role.SCENE)


def test_without_the_library_the_way_to_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whether or not it is installed here."""
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(InputError, match=r"room\.usda: .*pip install 'dcap\[usd\]'"):
        scan_of(tmp_path, ROOM)
    with pytest.raises(InputError, match="neither text, binary nor package"):
        scan_of(tmp_path, "solid x")


@pytest.mark.parametrize("beside", ["room.obj", "room.glb", "3dgs_compressed.ply"])
def test_a_stage_beside_other_meshes_is_not_needed(tmp_path: Path, beside: str) -> None:
    """A folder that could be read before somebody put a stage into it can be read after."""
    (tmp_path / "room.usda").write_text(ROOM)
    assert find_mesh(tmp_path)[0].name == "room.usda"
    if beside == "3dgs_compressed.ply":
        one = np.zeros((1, 3), dtype=np.float32)
        turn = np.array([[1.0, 0, 0, 0]], dtype=np.float32)
        write_splats(tmp_path / beside, Gaussians(one, one, turn, one[:, 0], one, np.zeros((1, 3, 0), np.float32)))
    else:
        (tmp_path / beside).write_bytes(b"glTF")
    assert find_mesh(tmp_path)[0].name == beside


def test_a_stage_of_instances(tmp_path: Path) -> None:
    """Centimetres and z up as stated; quads cut, a mirrored instance kept outward, what is hidden left out."""
    pytest.importorskip("pxr")
    scan = scan_of(tmp_path, ROOM)
    assert (scan.up, scan.unit_metres, scan.unit_source) == ("z", 0.01, "format")
    assert scan.node_names == ("World/Chair_1", "World/Chair_2/Body")
    np.testing.assert_allclose(scan.mesh.bounds, [[0, 0, 0], [3, 1, 2]], atol=1e-6)
    assert volume(scan.mesh) == pytest.approx(3.0, abs=1e-5)
    assert len(scan.mesh.faces) == 24
    first = scan.mesh.submesh(np.flatnonzero(scan.face_node == 0))
    assert (first.colors == [255, 0, 0]).all()
    found = segment(scan, SegmentConfig(), OfflineClient())
    assert [one.label for one in found.instances] == ["chair", "chair"]


def test_axes_and_units_that_are_not_stated_are_estimated(tmp_path: Path) -> None:
    """Neither the standard's fallback of centimetres nor y is taken for stated."""
    pytest.importorskip("pxr")
    text = (
        ROOM.replace("    metersPerUnit = 0.01\n", "")
        .replace('    upAxis = "Z"\n', "")
        .replace("100, 100, 100", "1, 1, 1")
    )
    scan = scan_of(tmp_path, text)
    assert (scan.unit_metres, scan.unit_source) == (1.0, "estimate")
    assert any("taken as up" in note for note in scan.notes)


def test_binaries_and_left_handed_meshes(tmp_path: Path) -> None:
    """The same stage as .usdc and .usdz, and a mesh whose faces run the other way."""
    pytest.importorskip("pxr")
    from pxr import Sdf, UsdUtils

    text = ROOM.replace("        color3f[]", '        uniform token orientation = "leftHanded"\n        color3f[]')
    plain = scan_of(tmp_path, text).mesh
    assert volume(plain) == pytest.approx(2.0 - 1.0, abs=1e-5)
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "room.usda"))
    layer.Export(str(tmp_path / "room.usdc"))
    UsdUtils.CreateNewUsdzPackage(str(tmp_path / "room.usdc"), str(tmp_path / "room.usdz"))
    for name in ("room.usdc", "room.usdz"):
        mesh = read_scan(tmp_path / name, SourceOptions(), Role.SCENE).mesh
        np.testing.assert_array_equal(mesh.triangles, plain.triangles)


@pytest.mark.parametrize("trouble", ["os.abort()", "while True: pass", "bytes(2**40)"])
def test_a_library_that_breaks_takes_nobody_along(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, trouble: str
) -> None:
    """It may crash, never end, or want all memory: the limits of its process are named."""
    pytest.importorskip("pxr")
    (tmp_path / "trouble.py").write_text(
        "import os, resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[2]),) * 2)\n"
        f"resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[3]),) * 2)\n{trouble}\n"
    )
    command = [sys.executable, str(tmp_path / "trouble.py")]
    monkeypatch.setattr("dcap.scene.readers.usd.usd.module_command", lambda _, *words: [*command, *words])
    monkeypatch.setattr("dcap.scene.readers.usd.usd.CPU_SECONDS", 1)
    with pytest.raises(InputError, match=r"room\.usda: the USD library failed on this file .*limits 1 s"):
        scan_of(tmp_path, ROOM)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[4, 4, 4, 4, 4, 4]", "[4, 4, 4, 4, 4, 5]", "ask for 25 indices, there are 24"),
        ("[4, 4, 4, 4, 4, 4]", "[4, 4, 4, 4, 12, -4]", "faceVertexCounts ask"),
        ("5,7,3]", "5,7,9]", "/World/Chair_1: a face uses vertex 9 of 8"),
        ("5,7,3]", "5,7,-3]", "uses vertex -3 of 8"),
        ("</Prototype>", "@elsewhere.usd@", "usdcat --flatten"),
        ('def Xform "World"', "def Xform", "USD cannot read it"),
        ("Mesh", "Cube", "the stage has no mesh"),
        ("(1,1,1)]", "(1,1,nan)]", "not finite"),
    ],
)
def test_what_is_broken_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    """It names the file and the prim."""
    pytest.importorskip("pxr")
    assert old in ROOM
    with pytest.raises(InputError) as caught:
        scan_of(tmp_path, ROOM.replace(old, new))
    assert words in str(caught.value)
    assert str(tmp_path / "room.usda") in str(caught.value)
    assert "\n" not in str(caught.value)


QUAD = """#usda 1.0
(
    upAxis = "Z"
    metersPerUnit = 1
)
def Mesh "Board" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {
    color3f[] primvars:displayColor = [(1, 0, 0)]
    point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0), (0,0,1), (1,0,1), (1,1,1), (0,1,1)]
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0,3,2,1, 4,5,6,7, 0,1,5,4, 1,2,6,5, 2,3,7,6, 3,0,4,7]
    texCoord2f[] primvars:map = [(0,0), (1,0), (1,1), (0,1), (0,0), (1,0), (1,1), (0,1)] ( interpolation = "vertex" )
    rel material:binding = </Look>
}
def Material "Look" {
    token outputs:surface.connect = </Look/Surface.outputs:surface>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Look/Picture.outputs:rgb>
        token outputs:surface
    }
    def Shader "Picture" {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @IMAGE@
        token inputs:wrapS = "mirror"
        float2 inputs:st.connect = </Look/Reader.outputs:result>
        float3 outputs:rgb
    }
    def Shader "Reader" {
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "map"
        float2 outputs:result
    }
}
"""


@pytest.mark.parametrize("packed", [False, True])
def test_the_texture_of_a_stage_is_read(tmp_path: Path, packed: bool) -> None:
    """Beside its text or within its package: pixels, coordinates by the primvar that is named, and how it goes on."""
    pytest.importorskip("pxr")
    from pxr import UsdUtils

    Image.fromarray(quarters()).save(tmp_path / "board.png")
    path = tmp_path / "board.usda"
    path.write_text(QUAD.replace("IMAGE", "board.png"))
    assert list(companions(path)) == ["board.png"]
    if packed:
        path = tmp_path / "board.usdz"
        UsdUtils.CreateNewUsdzPackage(str(tmp_path / "board.usda"), str(path))
    surface = read_surface(path, np.eye(4))
    assert np.array_equal(surface.paint.textures[0], quarters())
    assert surface.paint.wraps == (("mirror", "repeat"),)
    assert (surface.paint.face_texture == 0).all()
    assert surface.paint.corner_uv == pytest.approx(surface.mesh.triangles[..., :2])
    colors = read_scan(path, SourceOptions(), Role.OBJECT).mesh.colors  # the picture's, not displayColor
    assert len(np.unique(colors, axis=0)) >= 4


def test_a_texture_that_is_missing_or_lies_elsewhere_is_left_out(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    (folder := tmp_path / "own").mkdir()
    Image.fromarray(quarters()).save(tmp_path / "board.png")
    for name in ("gone.png", "../board.png"):
        (folder / "board.usda").write_text(QUAD.replace("IMAGE", name))
        assert not read_surface(folder / "board.usda", np.eye(4)).kept
        mesh = read_scan(folder / "board.usda", SourceOptions(), Role.OBJECT).mesh
        assert (mesh.colors == [255, 0, 0]).all()


PLAIN = """#usda 1.0
def Mesh "Board"
{
    point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0,1,2,3]
}
"""
REFERRING = """#usda 1.0
def "Thing" (
    references = @WHERE@</Board>
)
{
}
"""


@pytest.mark.parametrize("where", ["../other.usda", "{0}/other.usda"])
def test_a_stage_takes_no_layer_from_outside_of_its_folder(tmp_path: Path, where: str) -> None:
    """A reference that leads out, up or by a whole path, is refused; one beside the stage is followed."""
    pytest.importorskip("pxr")
    (folder := tmp_path / "own").mkdir()
    for place in (tmp_path, folder):
        (place / "other.usda").write_text(PLAIN)
    path = folder / "a.usda"
    path.write_text(REFERRING.replace("WHERE", where.format(tmp_path)))
    with pytest.raises(InputError, match="lies outside of the file's folder; flatten it"):
        read_usd(path)
    path.write_text(REFERRING.replace("WHERE", "other.usda"))
    assert len(read_usd(path).faces) == 2
