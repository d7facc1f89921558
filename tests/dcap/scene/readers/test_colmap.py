"""COLMAP models: there and back as .bin and .txt, other programs' variants, truncated and broken files."""

import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.readers.scenes.colmap import read_colmap
from dcap.scene.types.pictures import ColmapModel, Pinhole, posed
from dcap.scene.writers.sugar import write_colmap, write_colmap_text

WRITERS = [write_colmap, write_colmap_text]


def model(images: int = 3, points: int = 5) -> ColmapModel:
    """Two cameras, some pictures and points."""
    random = np.random.default_rng(0)
    turns = Rotation.random(images, rng=random).as_matrix()
    return ColmapModel(
        (Pinhole(1, 640, 480, (500.0, 500.5), (320.0, 240.0)), Pinhole(7, 32, 24, (1 / 3, 0.1), (16.5, 12.0))),
        tuple(
            posed(k + 1, f"a folder/view {k}.png", (1, 7)[k % 2], turns[k], random.normal(size=3))
            for k in range(images)
        ),
        random.normal(size=(points, 3)),
        random.integers(0, 256, (points, 3)).astype(np.uint8),
    )


@pytest.mark.parametrize("write", WRITERS)
def test_models_come_back_the_same(tmp_path: Path, write) -> None:
    """To the last bit, in either form."""
    true = model()
    write(tmp_path / "sparse" / "0", true)
    read = read_colmap(tmp_path / "sparse" / "0")
    assert read.cameras == true.cameras
    assert [(i.id, i.name, i.camera_id) for i in read.images] == [(i.id, i.name, i.camera_id) for i in true.images]
    for a, b in zip(read.images, true.images, strict=True):
        assert np.array_equal(a.quaternion, b.quaternion)
        assert np.array_equal(a.translation, b.translation)
    assert np.array_equal(read.points, true.points)
    assert np.array_equal(read.colors, true.colors)


def test_a_pose_is_world_to_camera() -> None:
    """A place p appears at R p + t, the camera itself at zero."""
    axes = Rotation.from_euler("zyx", [0.3, -0.4, 1.1]).as_matrix()
    place = np.array([1.0, -2.0, 3.0])
    image = posed(1, "a.png", 1, axes, place)
    assert image.camera_from_world @ place + image.translation == pytest.approx(np.zeros(3), abs=1e-12)
    assert image.camera_from_world @ (place + 2 * axes[:, 2]) + image.translation == pytest.approx([0, 0, 2])
    assert image.position == pytest.approx(place)
    assert image.quaternion[0] >= 0.0


def test_binary_files_are_laid_out_as_documented(tmp_path: Path) -> None:
    """Packed here field by field, with observations and tracks, a SIMPLE_PINHOLE, and nothing of the writer's."""
    (tmp_path / "cameras.bin").write_bytes(struct.pack("<QiiQQ3d", 1, 4, 0, 640, 480, 500.0, 320.0, 240.0))
    (tmp_path / "images.bin").write_bytes(
        struct.pack("<Qi7di", 1, 9, 1.0, 0, 0, 0, 0.5, 0.25, 2.0, 4) + b"x.jpg\0"
        + struct.pack("<Qddqddq", 2, 1.0, 2.0, 3, 4.0, 5.0, -1)
    )  # fmt: skip
    (tmp_path / "points3D.bin").write_bytes(
        struct.pack("<QQ3d3BdQ4i", 2, 3, 1.0, 2.0, 3.0, 10, 20, 30, 0.7, 2, 9, 0, 9, 1)
        + struct.pack("<Q3d3BdQ", 4, -1.0, -2.0, -3.0, 255, 0, 1, 0.1, 0)
    )
    read = read_colmap(tmp_path)
    assert read.cameras == (Pinhole(4, 640, 480, (500.0, 500.0), (320.0, 240.0)),)
    (image,) = read.images
    assert (image.id, image.camera_id, image.name) == (9, 4, "x.jpg")
    assert image.position == pytest.approx([-0.5, -0.25, -2.0])
    assert read.camera_of(image) is read.cameras[0]
    assert np.array_equal(read.points, [[1, 2, 3], [-1, -2, -3]])
    assert np.array_equal(read.colors, [[10, 20, 30], [255, 0, 1]])


def test_text_files_with_comments_observations_and_tracks(tmp_path: Path) -> None:
    """As COLMAP itself writes them; the last line of observations may be missing."""
    (tmp_path / "cameras.txt").write_text("# Camera list\n# Number: 1\n2 SIMPLE_PINHOLE 640 480 500 320 240\n")
    (tmp_path / "images.txt").write_text(
        "# Image list\n1 1 0 0 0 0 0 2 2 a.png\n1.5 2.5 -1 3.5 4.5 7\n2 0 1 0 0 0 0 2 2 b.png\n\n"
        "3 1 0 0 0 1 2 3 2 c d.png\n"
    )
    (tmp_path / "points3D.txt").write_text("# points\n\n1 0.5 1.5 -2 1 2 3 0.1 1 0 2 0\n")
    read = read_colmap(tmp_path)
    assert [i.name for i in read.images] == ["a.png", "b.png", "c d.png"]
    assert read.images[1].camera_from_world == pytest.approx(np.diag([1.0, -1.0, -1.0]))
    assert read.cameras[0].focal == (500.0, 500.0)
    assert np.array_equal(read.points, [[0.5, 1.5, -2.0]])


BROKEN = [
    ("cameras.bin", struct.pack("<Q", 1 << 60), "promises 1152921504606846976 rows"),
    ("points3D.bin", struct.pack("<Q", 1 << 40) + bytes(600), "hold 11 at most"),
    ("cameras.bin", struct.pack("<QiiQQ8d", 1, 1, 4, 640, 480, *[1.0] * 8), "camera 1 is OPENCV.*undistort"),
    ("cameras.bin", struct.pack("<QiiQQ8d", 1, 1, 99, 640, 480, *[1.0] * 8), "unknown model 99"),
    ("cameras.bin", struct.pack("<QiiQQ4d", 1, 1, 1, 0, 480, *[1.0] * 4), "0 x 480 pixels"),
    ("cameras.bin", struct.pack("<QiiQQ4d", 1, 1, 1, 640, 480, -1.0, 1.0, 1.0, 1.0), "focal lengths"),
    ("cameras.bin", struct.pack("<QiiQQ4d", 0, 1, 1, 640, 480, *[1.0] * 4), "56 bytes are left"),
    ("images.bin", struct.pack("<Qi7di", 1, 1, *[0.0] * 7, 1) + bytes(9), "has length 0, expected 1"),
    ("images.bin", struct.pack("<Qi7di", 1, 1, 1.0, *[0.0] * 6, 3) + bytes(9), "names camera 3"),
    ("images.bin", struct.pack("<Qi7di", 1, 1, 1.0, *[0.0] * 6, 1) + b"a" * 40, "does not end"),
    ("images.bin", struct.pack("<Qi7di", 1, 1, 1.0, *[0.0] * 6, 1) + b"\xff\0" + bytes(8), "not UTF-8"),
    (
        "images.bin", struct.pack("<Qi7di", 1, 1, 1.0, *[0.0] * 6, 1) + b"a\0" + struct.pack("<Q", 1 << 61),
        "entries of 24 bytes",
    ),
    ("points3D.bin", struct.pack("<QQ3d3BdQ", 1, 1, *[0.0] * 3, 0, 0, 0, 0.0, 1 << 50), "entries of 8 bytes"),
    ("points3D.bin", struct.pack("<QQ3d3BdQ", 1, 1, np.nan, 0, 0, 0, 0, 0, 0.0, 0), "expected finite"),
    ("cameras.txt", b"1 PINHOLE 640 480 500 500 320\n", "line 1 has 7 words"),
    ("cameras.txt", b"1 RADIAL 640 480 500 320 240 0 0\n", "camera 1 is RADIAL"),
    ("cameras.txt", b"# c\n1 PINHOLE 640 x 500 500 320 240\n", "line 2: .*'x'"),
    ("images.txt", b"1 1 0 0 0 0 0 0 1\n", "line 1 has 9 words"),
    ("points3D.txt", b"1 0 0 0 1 2 300 0\n", "colour"),
]  # fmt: skip
"""Files of a model, what stands in them instead, and what is said of it: a regular expression."""


def test_a_file_that_breaks_its_format(tmp_path: Path, subtests: pytest.Subtests) -> None:
    """One line that names the file, the row and what is wrong."""
    for number, (name, content, words) in enumerate(BROKEN):
        with subtests.test(str((name, words))):
            folder = tmp_path / str(number)
            (write_colmap if name.endswith(".bin") else write_colmap_text)(folder, model(1))
            (folder / name).write_bytes(content)
            with pytest.raises(FormatError, match=words) as caught:
                read_colmap(folder)
            assert str(folder) in str(caught.value)


def test_a_folder_without_a_model(tmp_path: Path) -> None:
    """It says what was looked for."""
    with pytest.raises(InputError, match="cameras, images and points3D"):
        read_colmap(tmp_path)
    with pytest.raises(GeometryError, match="same id"):
        ColmapModel((Pinhole(1, 1, 1, (1, 1), (0, 0)),) * 2, (), np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
