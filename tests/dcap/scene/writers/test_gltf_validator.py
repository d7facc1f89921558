"""Written files are glTF 2.0 without errors or warnings, by Khronos' own validator."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from all_maps import FACTORS, write_quad
from dented_bed import anchor, ball, scene_of, settled
from textured import plate, quarters

from dcap.geometry.rendering.painted import own_paint
from dcap.scene.readers.source import read_surface
from dcap.scene.types.mesh import Mesh, Paint, SourceSurface
from dcap.scene.types.particles import Particles
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from flows.output import corner_normals, iso_glb
from tasks.render.settled_meshes import contact_nodes, object_at_rest, scene_at_rest

VALIDATOR = Path(__file__).parents[4] / "build" / "node" / "node_modules" / "gltf-validator"
SCRIPT = """
const validator = require(process.argv[1]), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])))
  .then(report => console.log(JSON.stringify(report.issues)));
"""

pytestmark = [
    pytest.mark.node,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("node") is None, reason="no node on this machine"),
    pytest.mark.skipif(not VALIDATOR.is_dir(), reason="no glTF validator; run: make node-tools"),
]


def issues(data: bytes, folder: Path) -> list[str]:
    """What the validator has against a file, hints and information left out."""
    path = folder / "file.glb"
    path.write_bytes(data)
    told = subprocess.run(
        ["node", "-e", SCRIPT, str(VALIDATOR), str(path)], capture_output=True, text=True, check=True, timeout=60
    )
    return [f"{one['code']} {one.get('pointer')}" for one in json.loads(told.stdout)["messages"] if one["severity"] < 2]


def textured(mesh: Mesh) -> SourceSurface:
    """A mesh with the whole texture on each face."""
    uv = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), (len(mesh.faces), 1, 1))
    count = len(mesh.faces)
    paint = Paint(np.full((count, 3), 255, np.uint8), np.zeros(count, np.int32), uv, (quarters(),))
    return SourceSurface(Mesh.of(mesh.vertices, mesh.faces, (255, 255, 255)), paint)


@pytest.mark.parametrize("with_textures", [True, False], ids=["textures", "colours"])
def test_scene_and_object_at_rest(tmp_path: Path, with_textures: bool) -> None:
    plain = SourceSurface.untextured()
    room = textured(scene_of().mesh) if with_textures else plain
    own = textured(ball().mesh) if with_textures else plain
    around, look = scene_at_rest(scene_of(), room, settled(), "bed")
    thing = object_at_rest(ball(), own, anchor(), settled().bodies[0])
    node = Node("object", thing.mesh, paint=thing.paint, normals=corner_normals(thing.mesh))
    normals = corner_normals(around.scene.mesh)
    scene = Node("scene", children=tuple(labelled_nodes(around.scene, look.paint, normals)))
    assert issues(glb_bytes([scene, node]), tmp_path) == []


def test_other_files(tmp_path: Path) -> None:
    assert issues(glb_bytes(contact_nodes(settled())), tmp_path) == []
    assert issues(glb_bytes(labelled_nodes(scene_of())), tmp_path) == []
    assert issues(iso_glb(settled(), Particles((), (), 0.01, ())), tmp_path) == []


def test_faces_without_area_and_many_tints(tmp_path: Path) -> None:
    """A face without area has no normal of its own; corner colours go beside the texture."""
    source = plate()
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 9, 9]], np.uint8)
    mesh = Mesh(np.vstack([source.mesh.vertices, source.mesh.vertices[:1]]), np.array([[0, 1, 2], [0, 4, 2]], np.int32),
                np.vstack([colors, colors[:1]]))  # fmt: skip
    paint = own_paint(SourceSurface(mesh, source.paint))
    assert issues(glb_bytes([Node("plate", mesh, paint=paint, normals=corner_normals(mesh))]), tmp_path) == []


def test_materials_with_all_maps(tmp_path: Path) -> None:
    """Five maps with two sets of coordinates, cut out; the same without a base colour's texture, and blended.

    Tangents are left to who reads the file, as the standard allows with normals and coordinates; that is warned of.
    """
    tangents = ["MESH_PRIMITIVE_GENERATED_TANGENT_SPACE /meshes/0/primitives/0/material"]
    (given := tmp_path / "given").mkdir()
    plain = {"pbrMetallicRoughness": FACTORS, "alphaMode": "BLEND", "alphaCutoff": None}
    for number, changes in enumerate(({}, plain)):
        surface = read_surface(write_quad(given / f"{number}.glb", **changes), np.eye(4))
        assert issues((given / f"{number}.glb").read_bytes(), tmp_path) == tangents
        node = Node("leaf", surface.mesh, paint=own_paint(surface), normals=corner_normals(surface.mesh))
        assert issues(glb_bytes([node]), tmp_path) == tangents


def test_the_validator_finds_what_is_wrong(tmp_path: Path) -> None:
    """A byte count in the header that is not the file's."""
    data = bytearray(glb_bytes(labelled_nodes(scene_of())))
    data[8] ^= 4
    assert issues(bytes(data), tmp_path) != []
