"""InteriorGS and SuGaR folders: tolerant where real files differ, strict where they are broken."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.scenes.interiorgs import read_labels, read_structure
from dcap.scene.readers.scenes.sugar import find_mesh
from dcap.scene.readers.source import read_scan, read_splat_scene
from dcap.scene.types.sample import SourceOptions

SQUARE = "v 0 0 0\nv 3 0 0\nv 3 3 0\nv 0 3 0\nf 1 2 3 4\n"


def corners(center: Sequence[float], half: Sequence[float], angle: float = 0.0) -> NDArray[np.float64]:
    """Eight corners of a box turned about the vertical, shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return np.asarray(center) + (signs * np.asarray(half)) @ turn.T


def entry(points: NDArray[np.float64], **keys: object) -> dict[str, object]:
    """A labels.json entry."""
    return {"bounding_box": [dict(zip("xyz", map(float, p), strict=True)) for p in points], **keys}


def folder_with(tmp_path: Path, labels: object, structure: object = None) -> Path:
    """A scene folder."""
    (tmp_path / "labels.json").write_text(json.dumps(labels))
    if structure is not None:
        (tmp_path / "structure.json").write_text(json.dumps(structure))
    return tmp_path


@given(st.floats(-3.1, 3.1), st.permutations(range(8)), st.floats(0.3, 1.2))
@settings(max_examples=50, deadline=None)
def test_corner_order_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, angle: float, order: list[int], half: float
) -> None:
    """Any order of the eight corners of a turned box gives the same box, and it holds its corners."""
    points = corners([1, 2, 0.5], [1.3, half, 0.5], angle)
    folder = folder_with(tmp_path_factory.mktemp("i"), [entry(points[order], ins_id="1", label="Bed")])
    box = read_labels(folder)[0][0].box
    # The axis-aligned rectangle is taken where it is at most 1 % larger; no more than that is lost.
    assert 8.0 * np.prod(box.half_extents) == pytest.approx(8 * 1.3 * half * 0.5, rel=0.0101)
    assert box.contains(points, margin=1e-9).all()


def test_labels_as_they_occur(tmp_path: Path) -> None:
    """An object with a list, mixed case, entries without boxes, missing and repeated ids, points as lists."""
    points = corners([0, 0, 0.4], [1, 0.5, 0.4])
    labels = [
        entry(points, ins_id="7", label="Multi person  Sofa"),
        entry(points, ins_id="7", label="Bed"),
        entry(points, ins_id="", label="table lamp"),
        {"label": "table lamp", "bounding_box": points.tolist()},
        {"ins_id": "9", "label": "wall"},
        {"ins_id": "10", "bounding_box": points.tolist()},
        {"ins_id": "11", "bounding_box": "broken, and skipped all the same"},
    ]
    boxes, notes = read_labels(folder_with(tmp_path, {"labels": labels}))
    assert [b.label for b in boxes] == ["multi person sofa", "bed", "table lamp", "table lamp"]
    assert [b.id for b in boxes] == ["7", "7_1", "table_lamp", "table_lamp_1"]
    assert "3 entries" in notes[0]


def test_flat_boxes_are_padded(tmp_path: Path) -> None:
    """A rug without thickness gets one centimetre."""
    box = read_labels(folder_with(tmp_path, [entry(corners([0, 0, 0], [1, 1, 0]), label="rug")]))[0][0].box
    assert 2 * box.half_extents[2] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("labels", "word"),
    [
        ("[1]", "entry 0"),
        ("{}", "list"),
        ("[", "broken JSON"),
        ('[{"label": "bed", "bounding_box": [[0, 0, 0]]}]', "1 corners"),
        ('[{"label": "bed", "bounding_box": [{"x": 0}]}]', "entry 0"),
        ('[{"label": "bed", "bounding_box": [[0, 0, NaN]]}]', "not finite"),
    ],
)
def test_broken_labels_are_refused(tmp_path: Path, labels: str, word: str) -> None:
    """A file that is not labels is refused, naming the file and the entry."""
    (tmp_path / "labels.json").write_text(labels)
    with pytest.raises(InputError, match=word) as caught:
        read_labels(tmp_path)
    assert "labels.json" in str(caught.value)


def test_structure_becomes_rooms_walls_and_openings(tmp_path: Path) -> None:
    """Walls become boxes of their length, thickness and height; windows boxes in the wall; rooms polygons."""
    structure = {
        "rooms": [{"profile": [[0, 0], [4, 0], [4, 3], [0, 3]], "room_type": "Master Bedroom"}],
        "walls": [{"location": [[0, 0], [0, 3]], "thickness": 0.2, "height": 2.8}],
        "holes": [{"type": "WINDOW", "thickness": 0.2, "profile": [[0, 1, 1], [0, 2, 1], [0, 2, 2], [0, 1, 2]]}],
    }
    rooms, boxes = read_structure(folder_with(tmp_path, [], structure))
    wall, window = boxes
    assert (rooms[0].kind, len(rooms[0].profile)) == ("master bedroom", 4)
    assert (wall.label, window.label) == ("wall", "window")
    np.testing.assert_allclose(2 * wall.box.half_extents, [3.0, 0.2, 2.8])
    assert wall.box.contains(np.array([[0.09, 1.5, 2.7]])).all()
    assert sorted((2 * window.box.half_extents).round(6).tolist()) == [0.2, 1.0, 1.0]


@pytest.mark.parametrize("thickness", ["NaN", "Infinity", "1e999", '"thick"', "[]"])
def test_a_thickness_that_is_no_number_is_refused(tmp_path: Path, thickness: str) -> None:
    """A wall or hole without a finite thickness never becomes a box, and the line names file, place and value."""
    (tmp_path / "structure.json").write_text(
        f'{{"holes": [{{"thickness": {thickness}, "profile": [[0, 1, 1], [0, 2, 1], [0, 2, 2], [0, 1, 2]]}}]}}'
    )
    with pytest.raises(InputError, match=r"structure\.json: thickness of hole 0 is .*finite number"):
        read_structure(tmp_path)


def touch(folder: Path, *names: str) -> Path:
    """Write a small mesh under each name."""
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(SQUARE)
    return folder


@pytest.mark.parametrize(
    ("names", "chosen"),
    [
        (("scene.obj", "sugarmesh_x_level03_decim1000000.ply"), "scene.obj"),
        (("sugarmesh_x_decim200000.ply", "sugarmesh_x_decim1000000.ply"), "sugarmesh_x_decim1000000.ply"),
        (("refined_mesh/s/fine.obj", "refined_mesh/s/fine_postprocessed.obj"), "fine_postprocessed.obj"),
        (("output/coarse_mesh/s/sugarmesh_x_level03_decim10.ply",), "sugarmesh_x_level03_decim10.ply"),
        (("only.stl",), "only.stl"),
    ],
)  # fmt: skip
def test_the_refined_mesh_is_preferred(tmp_path: Path, names: tuple[str, ...], chosen: str) -> None:
    """Refined before coarse, post-processed before raw, more triangles before fewer."""
    assert find_mesh(touch(tmp_path, *names))[0].name == chosen


def test_folders_without_a_usable_mesh(tmp_path: Path) -> None:
    """Nothing or several meshes: each refusal says what to do. Splats alone are taken, and must be whole."""
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="no mesh"):
        find_mesh(tmp_path / "a")
    with pytest.raises(InputError, match="name one"):
        find_mesh(touch(tmp_path / "b", "x.glb", "y.glb"))
    (tmp_path / "c").mkdir()
    header = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty uint packed_position\nend_header\n0000"
    (tmp_path / "c" / "3dgs_compressed.ply").write_bytes(header)
    assert find_mesh(tmp_path / "c") == (tmp_path / "c" / "3dgs_compressed.ply", ())
    with pytest.raises(InputError, match="packed_rotation"):
        read_scan(tmp_path / "c" / "3dgs_compressed.ply", SourceOptions(), Role.SCENE)


@pytest.mark.parametrize(
    ("options", "role", "named"),
    [
        (SourceOptions(up="y"), Role.SCENE, "--up y"),
        (SourceOptions(unit="cm"), Role.SCENE, "--unit cm"),
        (SourceOptions(up="-z", unit="m"), Role.OBJECT, "--object-up -z"),
    ],
)
def test_options_against_the_annotations_are_refused(
    tmp_path: Path, options: SourceOptions, role: Role, named: str
) -> None:
    """They would turn the mesh and leave boxes, rooms and the map; what agrees is allowed."""
    touch(folder_with(tmp_path, [entry(corners([0, 0, 0], [1, 1, 1]), label="bed", ins_id="b")]), "scene.obj")
    with pytest.raises(InputError, match=f"^{named}: .* metres, z up"):
        read_scan(tmp_path, options, role)
    if role is Role.SCENE:
        with pytest.raises(InputError, match=f"^{named}: .* metres, z up"):
            read_splat_scene(tmp_path, options)
    np.testing.assert_array_equal(read_scan(tmp_path, SourceOptions("z", "m"), role).world_from_file, np.eye(4))


def test_a_scene_folder_is_metres_and_z_up(tmp_path: Path) -> None:
    """The annotations' frame holds for the mesh beside them, whatever its shape suggests."""
    touch(folder_with(tmp_path, [entry(corners([0, 0, 0], [1, 1, 1]), label="bed", ins_id="b")]), "scene.obj")
    scan = read_scan(tmp_path, SourceOptions(), Role.SCENE)
    assert (scan.up, scan.unit_metres, scan.unit_source, scan.boxes[0].id) == ("z", 1.0, "format", "b")
    np.testing.assert_array_equal(scan.world_from_file, np.eye(4))
