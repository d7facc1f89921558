"""COLMAP models as its programs read them."""

from pathlib import Path

import numpy as np
from colmap_files import read_colmap
from scipy.spatial.transform import Rotation

from dcap.scene.types.pictures import ColmapModel, Pinhole, posed
from dcap.scene.writers.sugar import write_colmap


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


def test_models_are_written_to_the_last_bit(tmp_path: Path) -> None:
    """Cameras, poses, points and colours; a model without pictures and points is one, too."""
    true = model()
    write_colmap(tmp_path / "sparse" / "0", true)
    read = read_colmap(tmp_path / "sparse" / "0")
    assert read.cameras == true.cameras
    for a, b in zip(read.images, true.images, strict=True):
        assert (a.id, a.name, a.camera_id) == (b.id, b.name, b.camera_id)
        assert np.array_equal([*a.quaternion, *a.translation], [*b.quaternion, *b.translation])
    assert np.array_equal(read.points, true.points)
    assert np.array_equal(read.colors, true.colors)
    write_colmap(tmp_path, model(0, 0))
    assert (read_colmap(tmp_path).images, len(read_colmap(tmp_path).points)) == ((), 0)
