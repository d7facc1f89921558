"""What materials of files say is in the written files: names, transparency, factors and every map, pixel by pixel."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from all_maps import CUTOFF, FACTORS, IMAGES, LIGHT, SCALE, STRENGTH, encoded, image, write_quad
from textured import plate

from dcap.geometry.rendering.painted import own_paint
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan, read_surface
from dcap.scene.readers.source_files import companions
from dcap.scene.types.mesh import PLAIN, AlphaMode, MaterialMap, Paint, SourceSurface, SurfaceMaterial
from dcap.scene.types.sample import SourceOptions
from dcap.scene.writers.glb import Node, glb_bytes

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, -1.0, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])


def written(path: Path, surface: SourceSurface) -> Path:
    """A file of a surface."""
    path.write_bytes(glb_bytes([Node("thing", surface.mesh, paint=own_paint(surface))]))
    return path


def said_by(paint: Paint) -> SurfaceMaterial:
    """The material of the first face."""
    return paint.materials[int(paint.material_index[0])]


def maps_of(said: SurfaceMaterial) -> list[MaterialMap]:
    """All of a material's maps, in the order of `IMAGES`."""
    assert said.metallic_roughness_map is not None
    assert said.normal_map is not None
    assert said.occlusion_map is not None
    assert said.emissive_map is not None
    return [said.metallic_roughness_map, said.normal_map, said.occlusion_map, said.emissive_map]


def document_of(path: Path) -> dict[str, Any]:
    """The JSON of a GLB."""
    data = path.read_bytes()
    found: dict[str, Any] = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])
    return found


def test_all_that_a_gltf_material_says_is_written_and_read_back(tmp_path):
    first = read_surface(write_quad(tmp_path / "given.glb"), Y_UP)
    again = read_surface(written(tmp_path / "written.glb", first), Y_UP)
    for surface in (first, again):
        paint = surface.paint
        said = said_by(paint)
        assert (said.name, said.alpha_mode, said.alpha_cutoff, said.alpha) == ("Leaf", AlphaMode.MASK, CUTOFF, 0.75)
        assert (said.metallic, said.roughness) == (FACTORS["metallicFactor"], FACTORS["roughnessFactor"])
        assert (said.double_sided, list(said.emission)) == (False, LIGHT)
        maps = maps_of(said)
        assert [used.strength for used in maps] == [1.0, SCALE, STRENGTH, 1.0]
        assert [used.uv_set for used in maps] == [0, 0, 1, 0]
        slots = [int(paint.face_texture[0]), *(used.texture for used in maps)]
        for name, slot in zip(IMAGES, slots, strict=True):
            assert np.array_equal(paint.textures[slot], image(name)), name
        assert paint.wrap(maps[1].texture) == ("clamp", "mirror")
        assert paint.more_uv[0] == pytest.approx(1.0 - paint.corner_uv, abs=1e-6)
    assert again.mesh.triangles == pytest.approx(first.mesh.triangles, abs=1e-6)


@pytest.mark.parametrize(
    ("said", "expected"),
    [({}, (0.0, 0.9)), ({"roughnessFactor": 0.5}, (1.0, 0.5)), ({"metallicFactor": 0.0}, (0.0, 1.0)),
     ({"metallicRoughnessTexture": {"index": 1}}, (1.0, 1.0))],
)  # fmt: skip
def test_the_standard_fills_in_what_a_material_leaves_out_of_what_it_says(tmp_path, said, expected):
    """A material that says nothing of its reflection is rough and no metal; half a statement is filled in with 1."""
    surface = read_surface(write_quad(tmp_path / "given.glb", pbrMetallicRoughness=said), Y_UP)
    (material,) = document_of(written(tmp_path / "written.glb", surface))["materials"]
    look = material["pbrMetallicRoughness"]
    assert (look["metallicFactor"], look["roughnessFactor"]) == expected


@pytest.mark.parametrize("broken", [{"index": 99}, {"index": "x"}, {"index": 2, "texCoord": 7}, {}, 5, None])
def test_a_map_that_cannot_be_used_is_left_out(tmp_path, broken):
    surface = read_surface(write_quad(tmp_path / "given.glb", normalTexture=broken), Y_UP)
    (said,) = (one for one in surface.paint.materials if one != PLAIN)
    assert said.normal_map is None
    assert said.emissive_map is not None


def test_faces_without_texture_keep_colour_name_and_transparency(tmp_path):
    source = plate()
    glass = SurfaceMaterial("glass", AlphaMode.BLEND, alpha=0.25, roughness=0.0, metallic=0.0)
    colors = np.array([[255, 0, 0], [0, 0, 255]], np.uint8)
    paint = Paint(
        colors, np.full(2, -1, np.int32), source.paint.corner_uv, (), (), np.array([1, 0], np.int32), (PLAIN, glass)
    )
    path = written(tmp_path / "written.glb", SourceSurface(source.mesh, paint))
    document = document_of(path)
    (material,) = document["materials"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [1.0, 0.0, 0.0, 0.25]
    assert (material["name"], material["alphaMode"]) == ("glass", "BLEND")
    assert not {"textures", "images", "samplers"} & document.keys()
    mesh = read_scan(path, SourceOptions(up="y"), Role.OBJECT).mesh  # the plain face has vertex colours, as ever
    assert {tuple(row) for row in mesh.colors.tolist()} == {(255, 0, 0), (0, 0, 255)}


def obj_quad(folder: Path, library: str) -> Path:
    """A unit square of an OBJ with a material `Leaf`, and the images beside it."""
    for name, pixels in (
        ("base.png", image("base")[..., :3]),
        ("both.png", image("base")),
        ("light.png", image("light")),
        ("alpha.png", image("base")[..., 3]),
        ("soft.png", np.full((4, 4), 128, np.uint8)),
    ):
        (folder / name).write_bytes(encoded(pixels))
    (folder / "leaf.mtl").write_text(f"newmtl Leaf\n{library}\n")
    rows = ["mtllib leaf.mtl", "usemtl Leaf", *(f"v {x} {y} 0" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))]
    rows += [*(f"vt {x} {y}" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))), "f 1/1 2/2 3/3 4/4"]
    (folder / "leaf.obj").write_text("\n".join(rows))
    return folder / "leaf.obj"


@pytest.mark.parametrize("cut", ["alpha.png", "both.png", "-imfchan m both.png"])
def test_the_cut_out_of_an_obj_is_the_alpha_of_its_texture(tmp_path, cut):
    path = obj_quad(tmp_path, f"map_Kd base.png\nmap_d {cut}\nPr 0.25")
    assert {"base.png", cut.split()[-1]} <= set(companions(path))
    again = read_surface(written(tmp_path / "written.glb", read_surface(path, np.eye(4))), Y_UP)
    assert np.array_equal(again.paint.textures[int(again.paint.face_texture[0])], image("base"))
    said = said_by(again.paint)
    assert (said.name, said.alpha_mode, said.roughness) == ("Leaf", AlphaMode.MASK, 0.25)


@pytest.mark.parametrize(
    ("library", "alpha"),
    [("d 0.25", 0.25), ("Tr 0.75", 0.25), ("Tr 1\nd 0.5", 0.5), ("d 0.5\nTr 1", 0.5), ("d -halo 0.5", 0.5)],
)
def test_an_obj_says_how_much_shines_through(tmp_path, library, alpha):
    surface = read_surface(obj_quad(tmp_path, f"Kd 1 0 0\n{library}"), np.eye(4))
    said = said_by(surface.paint)
    assert (said.alpha_mode, said.alpha) == (AlphaMode.BLEND, alpha)
    (material,) = document_of(written(tmp_path / "written.glb", surface))["materials"]
    assert material["pbrMetallicRoughness"]["baseColorFactor"] == [1.0, 0.0, 0.0, alpha]
