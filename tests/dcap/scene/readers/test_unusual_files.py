"""Files that are unusual and sound are read; files that only look sound are refused in one short line."""

from pathlib import Path

import numpy as np
import pytest
from mesh_files import CUBE, QUADS, cube_document, glb, refusal, scan_of, volume, write_obj, write_ply


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
        ("Material #2", (0, 255, 0)),
        ("sky", (0, 0, 255)),
        ("sky # at noon", (0, 0, 255)),
        ("Material #3", None),
        ("Material", None),
        ("SKY", None),
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


def test_a_library_without_materials_is_told(tmp_path: Path) -> None:
    """An empty one, or one in another encoding."""
    path = write_obj(tmp_path / "cube.obj", CUBE, QUADS)
    path.write_text("mtllib cube.mtl\nusemtl sky\n" + path.read_text())
    (tmp_path / "cube.mtl").write_text(MATERIALS, encoding="utf-16")
    assert any("cube.mtl has no materials" in note for note in scan_of(path).notes)


def test_the_image_that_a_ply_names_is_told(tmp_path: Path) -> None:
    """The mesh is read without it."""
    path = write_ply(tmp_path / "cube.ply", "<", CUBE, QUADS)
    path.write_bytes(path.read_bytes().replace(b"comment made by a test", b"comment TextureFile oak planks.png"))
    assert any("'oak planks.png'" in note for note in scan_of(path).notes)


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


def test_a_broken_face_is_quoted_in_short(tmp_path: Path) -> None:
    """A message about a face of thousands of characters is a line that one can read."""
    path = tmp_path / "wide.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 " + "9" * 5000)
    told = refusal(path)
    assert "line 4" in told
    assert len(told) < len(str(path)) + 200


def test_a_concave_face_of_very_many_corners_is_refused(tmp_path: Path) -> None:
    """Cutting it takes memory with the square of its corners; a convex one is a fan, however large."""
    turn = np.linspace(0.0, 2.0 * np.pi, 5000, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(5000)], axis=1)
    area = scan_of(write_obj(tmp_path / "disc.obj", ring, [list(range(5000))]), up="z", unit="m").mesh.face_areas.sum()
    assert area == pytest.approx(np.pi, rel=1e-5)  # of the polygon: 1 - (2 pi / n)^2 / 6
    star = ring * (1.0 + 0.2 * np.cos(40.0 * turn))[:, None]
    assert "5000 corners > 4096" in refusal(write_obj(tmp_path / "star.obj", star, [list(range(5000))]))


def test_gltf_of_another_version_is_refused(tmp_path: Path) -> None:
    """Its accessors and materials mean something else."""
    document, binary = cube_document()
    path = tmp_path / "old.glb"
    path.write_bytes(glb(document | {"asset": {"version": "1.0"}}, binary))
    assert "'1.0'; only glTF 2.0" in refusal(path)


def test_a_node_whose_mesh_is_a_word_is_refused(tmp_path: Path) -> None:
    """A mesh is named by its number, and '0' is none."""
    document, binary = cube_document()
    path = tmp_path / "word.glb"
    path.write_bytes(glb(document | {"nodes": [{"name": "Crate", "mesh": "0"}]}, binary))
    assert "'mesh' is a str" in refusal(path)
