"""COLMAP's text files as its documentation lays them out, of models without observations and tracks."""

from pathlib import Path

import numpy as np

from dcap.scene.types.pictures import ColmapModel, Pinhole, PosedImage


def read_colmap(folder: Path) -> ColmapModel:
    """The model of three text files; every picture is followed by an empty line of observations."""
    rows = {}
    for name in ("cameras", "images", "points3D"):
        lines = (folder / f"{name}.txt").read_text(encoding="utf-8").splitlines()
        rows[name] = [line.split(" ") for line in lines if line[:1] != "#"]
    cameras = []
    for number, model, width, height, *lengths in rows["cameras"]:
        fx, fy, cx, cy = map(float, lengths)
        assert model == "PINHOLE"
        cameras.append(Pinhole(int(number), int(width), int(height), (fx, fy), (cx, cy)))
    assert all(words == [""] for words in rows["images"][1::2])
    images = []
    for number, *pose, camera, name in ([*row[:9], " ".join(row[9:])] for row in rows["images"][::2]):
        values = np.array(pose, dtype=np.float64)
        images.append(PosedImage(int(number), name, int(camera), values[:4], values[4:]))
    points = np.array(rows["points3D"], dtype=np.float64).reshape(-1, 8)
    assert np.array_equal(points[:, 0], np.arange(1, len(points) + 1))
    return ColmapModel(tuple(cameras), tuple(images), points[:, 1:4], points[:, 4:7].astype(np.uint8))
