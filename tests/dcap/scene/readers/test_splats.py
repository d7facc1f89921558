"""Gaussian splats: both PLY schemas there and back, against PlayCanvas' own decoding, turned, truncated and broken."""

import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.scenes.sugar import has_only_splats
from dcap.scene.readers.source import read_scan
from dcap.scene.readers.splats.splats import CHUNK, read_splats
from dcap.scene.types.gaussians import COEFFICIENTS, Gaussians, harmonics
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud
from dcap.scene.types.sample import SourceOptions
from dcap.scene.writers.gaussians import morton_order, write_compressed_splats, write_splats

SAMPLE_DATA = Path(os.environ.get("DCAP_SAMPLE_DATA") or "absent")


def some(count: int, degree: int = 3, seed: int = 0) -> Gaussians:
    """Random Gaussians in a room of 4 m."""
    random = np.random.default_rng(seed)

    def numbers(*shape: int) -> np.ndarray:
        return random.standard_normal(shape).astype(np.float32)

    return Gaussians(
        random.uniform(-2, 2, (count, 3)).astype(np.float32), numbers(count, 3) - 4, numbers(count, 4),
        2 * numbers(count), numbers(count, 3), np.clip(numbers(count, 3, COEFFICIENTS[degree]), -3.9, 3.9),
    )  # fmt: skip


def same(a: Gaussians, b: Gaussians) -> bool:
    """Whether all fields are equal."""
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(Gaussians))


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_the_plain_schema_loses_nothing(tmp_path: Path, degree: int) -> None:
    """Written and read: the same numbers."""
    splats = some(300, degree)
    write_splats(tmp_path / "a.ply", splats)
    assert same(read_splats(tmp_path / "a.ply"), splats)


def test_properties_come_in_any_order_with_or_without_normals(tmp_path: Path) -> None:
    """Ascii and shuffled, as other programs write them."""
    splats = some(7, 0)
    columns = {
        "opacity": splats.logit, **{f"rot_{i}": splats.rotation[:, i] for i in range(4)},
        **{f"scale_{i}": splats.log_scale[:, i] for i in range(3)}, "z": splats.position[:, 2],
        **{f"f_dc_{2 - i}": splats.dc[:, 2 - i] for i in range(3)}, "x": splats.position[:, 0],
        "y": splats.position[:, 1],
    }  # fmt: skip
    head = ["ply", "format ascii 1.0", "element vertex 7", *(f"property float {n}" for n in columns), "end_header"]
    rows = [" ".join(repr(float(v)) for v in row) for row in zip(*columns.values(), strict=True)]
    (tmp_path / "a.ply").write_text("\n".join(head + rows) + "\n")
    assert same(read_splats(tmp_path / "a.ply"), splats)


@pytest.mark.parametrize(("count", "degree"), [(1, 0), (CHUNK, 1), (CHUNK + 1, 2), (2000, 3)])
def test_the_compressed_schema_stays_within_its_quantisation(tmp_path: Path, count: int, degree: int) -> None:
    """Half a step of each field, with room for single precision."""
    splats = some(count, degree)
    write_compressed_splats(tmp_path / "a.ply", splats)
    read, true = read_splats(tmp_path / "a.ply"), splats.subset(morton_order(splats.position))
    owner = np.arange(count) // CHUNK
    for name, bits in (("position", (11, 10, 11)), ("log_scale", (11, 10, 11))):
        values = getattr(true, name)
        extent = np.stack([np.ptp(values[owner == c], axis=0) for c in range(owner[-1] + 1)])[owner]
        step = extent / (2.0 ** np.array(bits) - 1)
        assert (np.abs(getattr(read, name) - values) <= 0.5 * step + 1e-5).all()
    # each component is off by half a step e of sqrt(2) / 1023; the one left out, m >= 1/2, by sum |q_i| e / m <= 3 e
    q = true.rotation / np.linalg.norm(true.rotation, axis=1, keepdims=True)
    q *= np.sign((q * read.rotation).sum(axis=1, keepdims=True))
    assert np.abs(q - read.rotation).max() < 0.5 * np.sqrt(2) / 1023 * 3
    assert np.abs(read.opacity - true.opacity).max() < 0.5 / 255 + 1e-6
    color = np.stack([np.ptp(true.dc[owner == c], axis=0) for c in range(owner[-1] + 1)])[owner]
    assert (np.abs(read.dc - true.dc) <= 0.5 * color / 255 + 1e-5).all()
    assert read.rest.shape == true.rest.shape
    assert np.abs(read.rest - true.rest).max(initial=0.0) <= 8 / 256  # trunc: the byte's middle is half a step away


def test_turning_splats_turns_what_is_seen() -> None:
    """Colours from turned directions, axes and centres follow; lengths scale; a stretch is refused."""
    splats = some(20)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    turn = turn @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    map_ = np.eye(4)
    map_[:3, :3], map_[:3, 3] = 2.5 * turn, [1, 2, 3]
    moved = splats.transformed(map_)
    d = np.random.default_rng(1).standard_normal((9, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    seen = np.einsum("nck,dk->ncd", splats.rest, harmonics(d, 3))
    assert np.einsum("nck,dk->ncd", moved.rest, harmonics(d @ turn.T, 3)) == pytest.approx(seen, abs=2e-5)
    assert moved.position == pytest.approx(2.5 * splats.position @ turn.T + [1, 2, 3], abs=1e-5)
    assert moved.axes == pytest.approx(turn @ splats.axes, abs=1e-5)
    assert moved.scale == pytest.approx(2.5 * splats.scale, rel=1e-5)
    with pytest.raises(GeometryError, match="uniform scaling"):
        splats.transformed(np.diag([1.0, 2.0, 1.0, 1.0]))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"element vertex 300", b"element vertex 4000000000", "promises 4000000000"),
        (b"element vertex 300", b"element vertex 299", "2 chunks for 299|300 rows, expected one for each of 299"),
        (b"element chunk 2", b"element chunk 1", "1 chunks for 300 splats, expected 2"),
        (b"property uint packed_scale", b"property int  packed_scale", "packed_scale is of type int32"),
        (b"property uchar f_rest_44\n", b"", "44 properties in element sh"),
        (b"element sh 300", b"element sh 200", "element sh has 200 rows, expected one for each of 300"),
    ],
)
def test_a_compressed_file_that_contradicts_itself(tmp_path: Path, old: bytes, new: bytes, words: str) -> None:
    """One line that names the file, the field and the numbers."""
    write_compressed_splats(tmp_path / "a.ply", some(300))
    data = (tmp_path / "a.ply").read_bytes()
    assert old in data
    (tmp_path / "b.ply").write_bytes(data.replace(old, new))
    with pytest.raises(FormatError, match=words) as caught:
        read_splats(tmp_path / "b.ply")
    assert "b.ply" in str(caught.value)


def test_numbers_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    """With the number of the splat and the name of the field."""
    splats = some(5, 0)
    for field, name in (("position", "position"), ("rotation", "rotation"), ("log_scale", "scale")):
        broken = read_after(tmp_path, splats, field, np.nan)
        assert f"the {name} of splat 3 is not finite" in broken
    assert "has no length" in read_after(tmp_path, splats, "rotation", 0.0)


def read_after(folder: Path, splats: Gaussians, field: str, value: float) -> str:
    """What the reader says once a field of splat 3 has a value."""
    write_splats(folder / "a.ply", splats)
    data = bytearray((folder / "a.ply").read_bytes())
    start = data.index(b"end_header\n") + len(b"end_header\n")
    row = np.frombuffer(data, "<f4", offset=start).reshape(len(splats), -1)
    column = {"position": slice(0, 3), "log_scale": slice(-7, -4), "rotation": slice(-4, None)}[field]
    row[3, column] = value
    (folder / "a.ply").write_bytes(data)
    with pytest.raises(FormatError) as caught:
        read_splats(folder / "a.ply")
    return str(caught.value)


@pytest.mark.long
@pytest.mark.third_party
@pytest.mark.skipif(not SAMPLE_DATA.is_dir(), reason="DCAP_SAMPLE_DATA is not set")
def test_playcanvas_decodes_the_same() -> None:
    """Field by field to the rounding of single precision; opacities of 0 and 1 are infinite there."""
    folder = SAMPLE_DATA / "gs_guitar_compressed"
    ours, theirs = read_splats(folder / "guitar.compressed.ply"), read_splats(folder / "guitar.standard.ply")
    for field in fields(Gaussians):
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        assert a == pytest.approx(b, rel=2e-6, abs=2e-6), field.name


@pytest.mark.third_party
@pytest.mark.skipif(not SAMPLE_DATA.is_dir(), reason="DCAP_SAMPLE_DATA is not set")
@pytest.mark.parametrize(
    ("name", "count", "degree"),
    [("gs_donut_inria/fused.ply", 45624, 0), ("gs_playbot_sh2/playbot.standard.ply", 8406, 2)],
)
def test_real_splats_are_read(name: str, count: int, degree: int) -> None:
    """Count and degree as their authors state."""
    splats = read_splats(SAMPLE_DATA / name)
    assert (len(splats), splats.degree) == (count, degree)


def box_of_splats(up: int) -> Gaussians:
    """Flat, opaque Gaussians all over a box of 1 x 1 x 0.5, the short side along an axis, standing on its zero."""
    random = np.random.default_rng(0)
    point = random.uniform(-0.5, 0.5, (3000, 3))
    face = random.integers(0, 6, 3000)
    point[np.arange(3000), face // 2] = np.where(face % 2, 0.5, -0.5)
    axis = np.eye(3)[face // 2]
    scale = np.where(axis > 0, 1e-3, 0.02)
    size = np.where(np.arange(3) == up, 0.5, 1.0)
    place = point * size
    place[:, up] += 0.25
    return Gaussians(
        place.astype(np.float32), np.log(scale).astype(np.float32), np.tile([1, 0, 0, 0], (3000, 1)).astype(np.float32),
        np.full(3000, 3.0, np.float32), np.zeros((3000, 3), np.float32), np.zeros((3000, 3, 0), np.float32),
    )  # fmt: skip


@pytest.mark.parametrize(("up", "options"), [(2, {}), (1, {"up": "y"}), (2, {"unit": "cm"})])
def test_splats_become_a_scan_through_a_mesher(tmp_path: Path, up: int, options: dict[str, str]) -> None:
    """The mesher gets Gaussians in metres and z up; what it makes is the scan's mesh, as it is."""
    write_splats(tmp_path / "thing.ply", box_of_splats(up))
    given: list[Gaussians] = []

    def mesher(splats: Gaussians | PointCloud) -> tuple[Mesh, tuple[str, ...]]:
        assert isinstance(splats, Gaussians)
        given.append(splats)
        return Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), ()

    scan = read_scan(tmp_path / "thing.ply", SourceOptions(**options), Role.SCENE, mesher=mesher)
    unit = 0.01 if options.get("unit") == "cm" else 1.0
    assert np.ptp(given[0].position, axis=0) == pytest.approx(unit * np.array([1.0, 1.0, 0.5]), rel=0.02)
    assert scan.mesh.vertices.max() == 1.0
    assert scan.unit_metres == unit
    assert scan.label == "thing"
    assert "reconstructed from Gaussian splats" in scan.notes[-1]
    with pytest.raises(InputError, match="Gaussian splats, not a mesh"):
        read_scan(tmp_path / "thing.ply", SourceOptions(**options), Role.SCENE)


def test_a_mesh_beside_splats_is_taken(tmp_path: Path) -> None:
    """SuGaR's mesh wins; a folder with only splats, and a file of them, need a mesher."""
    write_splats(tmp_path / "3dgs_compressed.ply", box_of_splats(2))
    assert has_only_splats(tmp_path)
    assert has_only_splats(tmp_path / "3dgs_compressed.ply")
    (tmp_path / "room.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert not has_only_splats(tmp_path)
    assert not has_only_splats(tmp_path / "room.obj")
    assert not has_only_splats(tmp_path / "gone")


def test_splats_that_show_nothing_are_refused(tmp_path: Path) -> None:
    """None is opaque: nothing stops the eye."""
    faint = box_of_splats(2)
    write_splats(tmp_path / "a.ply", replace(faint, logit=faint.logit - 10))
    with pytest.raises(InputError, match="more than half of the opacity"):
        read_scan(tmp_path / "a.ply", SourceOptions(), Role.SCENE, mesher=lambda _: (Mesh.of([], []), ()))
