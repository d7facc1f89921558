"""Files that a mesh names: the store takes along exactly what the readers find again, however it is written."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.readers.source_files import companions
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from tasks.artifact import Source, Store

RED = (255, 0, 0)
SQUARE = (
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl skin\nf 1/1 2/2 3/3 4/4\n"
)  # fmt: skip


def stored(path: Path, root: Path) -> tuple[Scan, list[str]]:
    """What is read from the store's copy of a file, and the names of all that was copied."""
    store = Store(root)
    source = store.load(store.add_source(path))
    assert isinstance(source, Source)
    files = source.path.parent
    names = sorted(str(one.relative_to(files)) for one in files.rglob("*") if one.is_file())
    return read_scan(source.path, SourceOptions(up="z", unit="m"), Role.SCENE), names


def red_image(path: Path) -> None:
    """A small red picture."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((4, 4, 3), RED, dtype=np.uint8)).save(path)


@pytest.mark.parametrize(
    ("library", "texture"),
    [
        ("mtllib\tmug.mtl", "\tmap_Kd\tskin.png"),
        ("  mtllib mug.mtl", "  map_Kd -s 1 1 1 skin.png"),
        ("mtllib {folder}/mug.mtl", "map_Kd {folder}/skin.png"),
        ("mtllib ../{name}/mug.mtl", "map_Kd ../{name}/skin.png"),
        ("mtllib mug.mtl", r"map_Kd textures\skin.png"),
        ("mtllib mug.mtl", r"map_Kd C:\Users\me\textures\skin.png"),
        ("mtllib gone.mtl mug.mtl", "map_Kd skin.png"),
        ("\ufeffmtllib mug.mtl", "map_Kd skin.png"),
    ],
)  # fmt: skip
def test_a_texture_survives_the_store_however_it_is_named(tmp_path: Path, library: str, texture: str) -> None:
    """Absolute, upward, Windows, indented and tabbed names reach the same picture, and nothing leaves the artifact."""
    folder = tmp_path / "my mug"
    for place in ("", "textures"):
        red_image(folder / place / "skin.png")
    names = {"folder": folder, "name": folder.name}
    (folder / "mug.obj").write_text(library.format(**names) + "\n" + SQUARE)
    (folder / "mug.mtl").write_text("newmtl skin\n" + texture.format(**names) + "\n")
    scan, files = stored(folder / "mug.obj", tmp_path / "store")
    assert (scan.mesh.colors == RED).all()
    assert files in (["mug.mtl", "mug.obj", "skin.png"], ["mug.mtl", "mug.obj", "textures/skin.png"])


def test_a_texture_elsewhere_is_said_to_be_elsewhere(tmp_path: Path) -> None:
    """A picture in a folder beside the file's own is neither copied nor called missing."""
    red_image(tmp_path / "textures" / "wood.png")
    folder = tmp_path / "chair"
    folder.mkdir()
    (folder / "chair.obj").write_text("mtllib chair.mtl\n" + SQUARE)
    (folder / "chair.mtl").write_text("newmtl skin\nmap_Kd ../textures/wood.png\n")
    scan, files = stored(folder / "chair.obj", tmp_path / "store")
    assert files == ["chair.mtl", "chair.obj"]
    assert any("'../textures/wood.png'" in note and "outside of the file's folder" in note for note in scan.notes)


def test_textures_of_a_library_in_a_folder_lie_beside_it(tmp_path: Path) -> None:
    """Names in an MTL file are relative to that file."""
    folder = tmp_path / "sofa"
    red_image(folder / "materials" / "skin.png")
    (folder / "sofa.obj").write_text("mtllib materials/sofa.mtl\n" + SQUARE)
    (folder / "materials" / "sofa.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    scan, files = stored(folder / "sofa.obj", tmp_path / "store")
    assert files == ["materials/skin.png", "materials/sofa.mtl", "sofa.obj"]
    assert (scan.mesh.colors == RED).all()


def test_a_glb_takes_its_files_along(tmp_path: Path) -> None:
    """Buffers and pictures that a GLB names by URI come along as those of a .gltf do."""
    (tmp_path / "a b.bin").write_bytes(b"x")
    (tmp_path / "i.png").write_bytes(b"x")
    text = json.dumps({"buffers": [{"uri": "a%20b.bin"}, {"byteLength": 4}], "images": [{"uri": "i.png"}]}).encode()
    chunk = struct.pack("<II", len(text), 0x4E4F534A) + text
    (tmp_path / "a.glb").write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunk)) + chunk)
    assert list(companions(tmp_path / "a.glb")) == ["a b.bin", "i.png"]


@pytest.mark.parametrize("line", ["Kd spectral steel.rfl", "Kd inf 0 0", "Kd nan 0 0", "Kd 0.5"])
def test_a_colour_that_is_not_three_numbers_is_grey(tmp_path: Path, line: str) -> None:
    """A colour by spectrum, which the format allows, and a broken one cost the colour, not the mesh, and are said."""
    (tmp_path / "a.obj").write_text("mtllib a.mtl\n" + SQUARE)
    (tmp_path / "a.mtl").write_text(f"newmtl skin\n{line}\n")
    scan = read_scan(tmp_path / "a.obj", SourceOptions(up="z", unit="m"), Role.SCENE)
    assert (scan.mesh.colors == 200).all()
    assert any("a.mtl: line 2" in note and "grey" in note for note in scan.notes)
