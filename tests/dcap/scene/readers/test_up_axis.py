"""The up axis: rooms in all four rotations, as meshes and as splats; what is no room is never turned upside down."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.readers.frame import WORLD_FROM_FILE, Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.gaussians import Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.gaussians import write_splats
from dcap.scene.writers.meshes import mesh_to_ply
from dcap.synthetic.rooms import build_room

SAMPLE_DATA = Path(os.environ.get("DCAP_SAMPLE_DATA") or "absent")

UPS = sorted(WORLD_FROM_FILE)


def turned(up: str, shift: float = 0.0) -> NDArray[np.float64]:
    """Maps z up to that axis up, and away from the origin, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(WORLD_FROM_FILE[up], dtype=float).T
    matrix[:3, 3] = shift * np.array([3.0, -7.0, 5.0])
    return matrix


def mesh_scan(folder: Path, mesh: Mesh, up: str, option: str = "auto") -> Scan:
    """A mesh with that axis up, in a format that states none."""
    path = folder / "thing.ply"
    path.write_bytes(mesh_to_ply(mesh.transformed(turned(up, 1.0))))
    return read_scan(path, SourceOptions(up=option), Role.SCENE)


def check_room(folder: Path, name: str, up: str) -> None:
    """The room's mesh and its splats, both with that axis up."""
    mesh = build_room(name, 0).record.mesh
    scan = mesh_scan(folder, mesh, up)
    assert scan.up == up
    assert any(note.startswith(f"{up} taken as up, estimated from how the room") for note in scan.notes)
    size = np.ptp(mesh.bounds, axis=0)
    np.testing.assert_allclose(np.ptp(scan.mesh.bounds, axis=0), size, atol=1e-9)
    taken: list[Gaussians] = []

    def mesher(splats: Gaussians | PointCloud) -> tuple[Mesh, tuple[str, ...]]:
        assert isinstance(splats, Gaussians)
        taken.append(splats)
        return mesh, ()

    write_splats(folder / "splats.ply", splats_on_mesh(mesh, 0.15, 0).transformed(turned(up, 1.0)))
    assert read_scan(folder / "splats.ply", SourceOptions(), Role.SCENE, mesher=mesher).up == up
    assert np.ptp(taken[0].position, axis=0) == pytest.approx(size, abs=0.1)


def test_a_room_stands_as_it_is_furnished(tmp_path: Path) -> None:
    """Away from the origin and without a word of the format."""
    check_room(tmp_path, "hall_01", "-y")


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A closed box."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh.of(np.array(low) + corners * np.subtract(high, low), faces)


def table() -> Mesh:
    """A top on four legs, its feet at z = 0."""
    legs = [block((x, y, 0), (x + 0.06, y + 0.06, 0.7)) for x in (0, 1.14) for y in (0, 0.74)]
    return Mesh.concatenate([block((0, 0, 0.7), (1.2, 0.8, 0.74)), *legs])


@pytest.mark.parametrize("mesh", [table(), block((0, 0, 0), (2.4, 0.6, 2.3))], ids=["table", "wardrobe"])
@pytest.mark.parametrize("up", ["-y", "-z"])
def test_furniture_is_never_turned_upside_down(tmp_path: Path, mesh: Mesh, up: str) -> None:
    """Upside down it would stand too: without a word it stays as the file has it; `--up` turns it."""
    assert mesh_scan(tmp_path, mesh, up).up in ("y", "z")
    scan = mesh_scan(tmp_path, mesh, up, option=up)
    assert scan.up == up
    assert not any("taken as up" in note for note in scan.notes)
    np.testing.assert_allclose(np.ptp(scan.mesh.bounds, axis=0), np.ptp(mesh.bounds, axis=0), atol=1e-9)


@pytest.mark.parametrize("up", UPS)
def test_turning_keeps_the_hand(tmp_path: Path, up: str) -> None:
    """A named axis becomes z, nothing is mirrored, and the map says so."""
    scan = mesh_scan(tmp_path, table(), up, option=up)
    linear = scan.world_from_file[:3, :3]
    assert np.linalg.det(linear) == pytest.approx(1.0)
    direction = np.zeros(3)
    direction["xyz".index(up[-1])] = -1.0 if up[0] == "-" else 1.0
    np.testing.assert_array_equal(linear @ direction, [0, 0, 1])
    legs = scan.mesh.vertices[:, 2] - scan.mesh.bounds[0, 2]
    assert np.isclose(legs, 0.0).sum() == 16  # the four corners of four feet


@pytest.mark.parametrize("up", UPS)
def test_a_scene_without_walls_stands_on_its_ground(tmp_path: Path, up: str) -> None:
    """A floor of 4 m with a table on it."""
    scan = mesh_scan(tmp_path, Mesh.concatenate([block((-2, -2, -0.02), (2, 2, 0)), table()]), up)
    assert scan.up == up
    assert any("the ground (--up)" in note for note in scan.notes)


@pytest.mark.parametrize("up", UPS)
def test_splats_stand_on_their_ground(tmp_path: Path, up: str) -> None:
    """A thing on a large ground, away from the origin."""
    scene = Mesh.concatenate([block((-1, -1, 0), (1, 1, 0.01)), block((-0.2, -0.2, 0), (0.2, 0.2, 0.5))])
    write_splats(tmp_path / "a.ply", splats_on_mesh(scene, 0.03, 0).transformed(turned(up, 1.0)))
    scan = read_scan(tmp_path / "a.ply", SourceOptions(), Role.SCENE, mesher=lambda _: (scene, ()))
    assert scan.up == up
    assert any("the ground (--up)" in note for note in scan.notes)


def test_splats_without_any_sign_follow_custom(tmp_path: Path) -> None:
    """A ball away from the origin: y down, as structure from motion has it, and that is said."""
    z = 1 - (2 * np.arange(400) + 1) / 400
    angle = np.pi * (1 + np.sqrt(5)) * np.arange(400)
    ring = np.sqrt(1 - z * z)
    position = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1) + 5.0
    parts = (position, np.full((400, 3), -3.0), np.tile([1.0, 0, 0, 0], (400, 1)), np.full(400, 3.0), 0 * position)
    splats = Gaussians(*(np.asarray(p, dtype=np.float32) for p in (*parts, np.zeros((400, 3, 0)))))
    write_splats(tmp_path / "a.ply", splats)
    scan = read_scan(tmp_path / "a.ply", SourceOptions(), Role.SCENE, mesher=lambda _: (table(), ()))
    assert scan.up == "-y"
    assert any("convention alone" in note for note in scan.notes)


@pytest.mark.third_party
@pytest.mark.skipif(not SAMPLE_DATA.is_dir(), reason="DCAP_SAMPLE_DATA is not set")
@pytest.mark.parametrize(
    ("name", "up"),
    [("gs_donut_inria/fused.ply", "z"), ("gs_playbot_sh2/playbot.standard.ply", "-y"),
     ("gs_guitar_compressed/guitar.compressed.ply", "-y")],
)  # fmt: skip
def test_real_splats_stand_as_they_look(name: str, up: str) -> None:
    """Seen in pictures: the donut lies on z = 0, the robot hovers above a ground, the guitar stands on its stand."""
    assert read_scan(SAMPLE_DATA / name, SourceOptions(), Role.SCENE, mesher=lambda _: (table(), ())).up == up


@pytest.mark.third_party
@pytest.mark.skipif(not SAMPLE_DATA.is_dir(), reason="DCAP_SAMPLE_DATA is not set")
@pytest.mark.parametrize("name", ["room_myroom_mit/room.glb", "room_simple_habitat/simple_room.glb"])
@pytest.mark.parametrize("up", UPS)
def test_real_rooms_stand_on_their_floor(tmp_path: Path, name: str, up: str) -> None:
    """Written without a word on axes; neither had a part in how rooms are told."""
    mesh = read_scan(SAMPLE_DATA / name, SourceOptions(), Role.SCENE).mesh
    assert mesh_scan(tmp_path, mesh, up).up == up


@pytest.mark.parametrize("up", ["y", "z"])
def test_walls_at_any_heading_tell_the_vertical(up: str, tmp_path: Path) -> None:
    """Of a torn scan neither four sides nor a ground are covered: what is upright or level tells the axis."""
    mesh = build_room("bathroom_01", 0).record.mesh
    low, high = mesh.bounds
    place = mesh.triangles.mean(axis=1)
    level = np.abs(mesh.face_normals[:, 2]) > 0.9 * np.linalg.norm(mesh.face_normals, axis=1)
    ends = (place[:, 2] < low[2] + 0.1) | (place[:, 2] > high[2] - 0.1)
    kept = mesh.submesh(np.flatnonzero(~(level & ends)))
    heading = np.eye(4)
    heading[:2, :2] = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    scan = mesh_scan(tmp_path, kept.transformed(heading), up)
    assert scan.up == up
    assert any("estimated from its upright walls" in note for note in scan.notes)
