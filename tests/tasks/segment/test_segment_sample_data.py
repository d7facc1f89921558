"""Segmentation of furniture and objects that others made."""

import os
from pathlib import Path

import numpy as np
import pytest

from dcap.geometry.distance import MeshDistance
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.readers.splats.splats import read_splats
from dcap.scene.types.sample import SourceOptions
from tasks.artifact import Source
from tasks.mesh.stage import MeshConfig, mesh_object, mesh_scene
from tasks.segment.stage import SegmentConfig, segment, segment_object
from tests.tasks.segment.test_segment import check_cover

FOLDER = Path(os.environ.get("DCAP_SAMPLE_DATA") or "nowhere")
pytestmark = [
    pytest.mark.third_party,
    pytest.mark.skipif(not FOLDER.is_dir(), reason="$DCAP_SAMPLE_DATA names no folder"),
]

EXPECTED = [
    ("sup_bed_kaykit/bed_double_A.gltf", "bed", {"mattress", "frame", "headboard", "pillow", "blanket"}),
    ("sup_couch_kaykit/couch.gltf", "sofa", {"base", "seat cushion", "back", "arm"}),
    ("sup_chair_kaykit/chair_A.gltf", "", {"seat", "back", "leg"}),
    ("sup_shelf_kaykit/shelf_B_large.gltf", "", {"board", "side"}),
    ("sup_table_polyhaven/wooden_table_02_1k.gltf", "table", {"top", "leg"}),
    ("obj_lamp_kaykit/lamp_table.gltf", "", {"shade", "pole", "base"}),
    ("room_myroom_mit/bed.glb", "", {"mattress", "frame", "pillow"}),
    ("room_simple_habitat/chair.glb", "", {"seat", "back", "leg"}),
    ("room_simple_habitat/simple_room.glb", "table", {"top", "leg"}),
]


@pytest.mark.parametrize(("name", "label", "parts"), EXPECTED)
def test_real_furniture(name: str, label: str, parts: set[str]) -> None:
    """Furniture that others made is read and gets the parts that a person would name."""
    scan = mesh_scene(Source(FOLDER / name), SourceOptions(label=label), MeshConfig())
    result = segment(scan, SegmentConfig(), OfflineClient())
    check_cover(result)
    assert any({p.name for p in one.parts} == parts for one in result.instances)


@pytest.mark.parametrize(
    ("name", "up", "height"),
    [
        ("obj_mug_ycb", "z", 0.082),
        ("obj_plush_koala", "y", 0.0534),
        ("obj_dumbbell_polypizza", "y", 0.159),
        ("obj_shoe_black_gso", "z", 0.123),
        ("obj_towel_green_gso", "z", 0.027),
        ("obj_book_kaykit", "y", 0.5),
    ],
)
def test_real_objects(name: str, up: str, height: float) -> None:
    """Objects that others made, given as folders, are read upright in a plausible unit."""
    scan = mesh_object(Source(FOLDER / name), SourceOptions(), MeshConfig())
    assert scan.up == up
    assert float(np.ptp(scan.mesh.vertices[:, 2])) == pytest.approx(height, abs=1e-3)
    check_cover(segment_object(scan, SegmentConfig(), OfflineClient()))


@pytest.mark.parametrize("name", ["room_myroom_mit/bed.draco.glb", "room_myroom_mit"])
def test_real_files_that_are_refused(name: str) -> None:
    """Draco and a folder of several meshes are refused with one line."""
    with pytest.raises(InputError):
        mesh_scene(Source(FOLDER / name), SourceOptions(), MeshConfig())


@pytest.mark.long
def test_a_real_thing_of_splats_becomes_a_mesh() -> None:
    """A guitar, 4 units long: half of its opaque splats lie within a cell of the surface that is made of them."""
    path = FOLDER / "gs_guitar_compressed" / "guitar.compressed.ply"
    with pytest.raises(InputError, match=r"Gaussians have no unit.*--height-of table=0.75.*--unit m"):
        mesh_scene(Source(path), SourceOptions(), MeshConfig())
    scan = mesh_scene(Source(path), SourceOptions(unit="m"), MeshConfig())
    splats = read_splats(path).transformed(scan.world_from_file)
    away = MeshDistance(scan.mesh).unsigned(splats.position[splats.opacity > 0.5].astype(float))
    assert np.median(away) < MeshConfig().surface.cell
    assert "reconstructed from Gaussian splats" in " ".join(scan.notes)
