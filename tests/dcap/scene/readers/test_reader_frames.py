"""Units and axes of mesh files: what a format states, what is estimated, and what an option settles."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_files import CUBE, QUADS, cube_document, glb, refusal, scan_of, write_obj
from numpy.typing import NDArray

from dcap.scene.readers.frame import Role


@pytest.mark.parametrize("role", Role)
@given(st.floats(0.05, 2.0))
@settings(max_examples=30, deadline=None)
def test_millimetres_are_never_taken_for_centimetres(
    tmp_path_factory: pytest.TempPathFactory, role: Role, size: float
) -> None:
    """What is 5 cm to 2 m long and written in millimetres is refused as long as nobody says so, in every role."""
    path = write_obj(tmp_path_factory.mktemp("mm") / "stool.obj", 1000 * size * CUBE, QUADS)
    assert "states no unit" in refusal(path, role)
    assert np.ptp(scan_of(path, role, unit="mm").mesh.bounds[:, 0]) == pytest.approx(size)


@pytest.mark.parametrize("role", Role)
@given(st.floats(0.05, 2.0))
@settings(max_examples=30, deadline=None)
def test_metres_need_no_word(tmp_path_factory: pytest.TempPathFactory, role: Role, size: float) -> None:
    """What is 5 cm to 2 m long and written in metres is read as such."""
    scan = scan_of(write_obj(tmp_path_factory.mktemp("m") / "stool.obj", size * CUBE, QUADS), role)
    assert (scan.unit_metres, scan.unit_source) == (1.0, "estimate")


def test_an_object_in_centimetres_is_recognised(tmp_path: Path) -> None:
    """Nine units without a stated unit are centimetres for an object, and that is said."""
    scan = scan_of(write_obj(tmp_path / "toy.obj", 9 * CUBE, QUADS), Role.OBJECT)
    assert (scan.unit_metres, scan.unit_source) == (0.01, "estimate")
    assert any("centimetres" in note for note in scan.notes)


def test_options_win(tmp_path: Path) -> None:
    """The user's unit, axis and label override format and estimate; an unknown one is refused."""
    (tmp_path / "crate.glb").write_bytes(glb(*cube_document()))
    scan = scan_of(tmp_path / "crate.glb", unit="cm", up="z", label="Tea Table")
    assert (scan.unit_metres, scan.unit_source, scan.up, scan.label) == (0.01, "option", "z", "tea table")
    assert "furlong" in refusal(tmp_path / "crate.glb", unit="furlong")
    assert "--object-up" in refusal(tmp_path / "crate.glb", Role.OBJECT, up="w")


@pytest.mark.parametrize(("axis", "up"), [(1, "y"), (2, "z")])
def test_up_is_the_axis_that_a_mesh_stands_on(tmp_path: Path, axis: int, up: str) -> None:
    """An OBJ whose lowest coordinate along one axis is zero, and centred along the others, stands on that axis."""
    centred = CUBE * [1, 1, 2]
    vertices = centred if axis == 2 else np.stack([centred[:, 0], centred[:, 2], -centred[:, 1]], axis=1)
    assert scan_of(write_obj(tmp_path / "box.obj", vertices, QUADS), Role.OBJECT).up == up


def box_between(low: list[float], high: list[float]) -> NDArray[np.float64]:
    """Corners of an axis-aligned box in the order of `CUBE`."""
    return np.asarray(low) + (CUBE - CUBE.min(axis=0)) * (np.asarray(high) - low)


def gltf_mesh(path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int64]) -> Path:
    """A GLB of one mesh whose coordinates are written as they are."""
    document, _ = cube_document()
    points, indices = vertices.astype("<f4").tobytes(), triangles.astype("<u2").tobytes()
    for index, (data, count) in enumerate(((points, len(vertices)), (indices, triangles.size))):
        document["accessors"][index]["count"] = count  # type: ignore[index]
        document["bufferViews"][index] = {  # type: ignore[index]
            "buffer": 0, "byteOffset": index * len(points), "byteLength": len(data)
        }  # fmt: skip
    document["buffers"] = [{"byteLength": len(points) + len(indices)}]
    path.write_bytes(glb(document, points + indices))
    return path


TRIANGLES = np.array([t for q in QUADS for t in ([q[0], q[1], q[2]], [q[0], q[2], q[3]])])


def test_a_picture_of_a_gltf_hangs_upright(tmp_path: Path) -> None:
    """A thin upright thing whose back lies in z = 0, centred in y, is not laid on its back against the standard."""
    picture = box_between([-0.3, -0.2, 0.0], [0.3, 0.2, 0.02])
    scan = scan_of(gltf_mesh(tmp_path / "picture.glb", picture, TRIANGLES))
    assert scan.up == "y"
    np.testing.assert_allclose(np.ptp(scan.mesh.bounds, axis=0), [0.6, 0.02, 0.4], atol=1e-6)


def test_a_gltf_that_can_stand_on_z_alone_is_turned(tmp_path: Path) -> None:
    """A round table top with its foot at z = 0 would balance on its rim if y were up: z is, and that is said."""
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    ring = np.c_[np.cos(angle), np.sin(angle)] * 0.5
    vertices = np.concatenate([np.c_[ring, np.zeros(64)], np.c_[ring, np.full(64, 0.3)]])
    i, j = np.arange(64), (np.arange(64) + 1) % 64
    fans = [np.c_[np.zeros(62, int), i[1:63], i[2:64]] + k for k in (0, 64)]
    sides = [np.c_[i, j, i + 64], np.c_[j, j + 64, i + 64]]
    scan = scan_of(gltf_mesh(tmp_path / "table.glb", vertices, np.concatenate(fans + sides)))
    assert scan.up == "z"
    assert any("although the format says" in note for note in scan.notes)


def test_world_from_file_is_what_was_done(tmp_path: Path) -> None:
    """`world_from_file` maps the file's vertices to ours exactly."""
    scan = scan_of(write_obj(tmp_path / "cube.obj", CUBE, QUADS), up="y", unit="cm")
    mapped = np.c_[CUBE, np.ones(8)] @ scan.world_from_file.T
    np.testing.assert_allclose(scan.mesh.vertices, mapped[:, :3], atol=1e-15)


GRID = np.array([451234.87, 5411876.52, 113.1])
"""A place in the coordinates of a national grid [m]."""


def test_a_scan_in_grid_coordinates_is_moved_to_the_origin(tmp_path: Path) -> None:
    """In whole metres, said in a note and in world_from_file, to a hundredth of a millimetre."""
    scan = scan_of(write_obj(tmp_path / "scan.obj", GRID + 2.0 * CUBE, QUADS), up="z", unit="m")
    shift = scan.world_from_file[:3, 3]
    assert (shift == np.round(shift)).all()
    np.testing.assert_allclose(np.ptp(scan.mesh.vertices, axis=0), 2.0 * np.ptp(CUBE, axis=0), atol=1e-9)
    np.testing.assert_allclose(scan.mesh.bounds - shift, (GRID + 2.0 * CUBE)[[0, 7]], atol=1e-5)
    assert any("to the origin" in note for note in scan.notes)


def test_coordinates_that_single_precision_has_spoilt_are_refused(tmp_path: Path) -> None:
    """At five million metres they are multiples of half a metre."""
    spoilt = (GRID + 2.0 * CUBE).astype(np.float32).astype(np.float64)
    assert "exact to 500 mm only" in refusal(write_obj(tmp_path / "s.obj", spoilt, QUADS), up="z", unit="m")
