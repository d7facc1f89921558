"""COLMAP's files as its documentation lays them out, of models without observations and tracks."""

import struct
from pathlib import Path

import numpy as np

from dcap.scene.types.pictures import ColmapModel, Pinhole, PosedImage

PINHOLE = 1
"""COLMAP's number of the camera model."""


def read_colmap(folder: Path) -> ColmapModel:
    """The model of three binary files."""
    cameras, images, points = ((folder / f"{name}.bin").read_bytes() for name in ("cameras", "images", "points3D"))
    assert len(cameras) == 8 + 56 * struct.unpack_from("<Q", cameras)[0]
    kinds = []
    for number, model, width, height, fx, fy, cx, cy in struct.iter_unpack("<iiQQ4d", cameras[8:]):
        assert model == PINHOLE
        kinds.append(Pinhole(number, width, height, (fx, fy), (cx, cy)))
    found, at = [], 8
    for _ in range(struct.unpack_from("<Q", images)[0]):
        number, *pose, camera = struct.unpack_from("<i7di", images, at)
        end = images.index(b"\0", at + 64)
        found.append(PosedImage(number, images[at + 64 : end].decode(), camera, np.array(pose[:4]), np.array(pose[4:])))
        assert images[end + 1 : end + 9] == bytes(8)  # observations
        at = end + 9
    assert at == len(images)
    row = np.dtype([("id", "<u8"), ("place", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track", "<u8")])
    rows = np.frombuffer(points, row, offset=8)
    assert len(rows) == struct.unpack_from("<Q", points)[0]
    return ColmapModel(tuple(kinds), tuple(found), rows["place"], rows["color"])


def read_colmap_text(folder: Path) -> dict[str, list[list[str]]]:
    """The words of each line that is no comment, by the name of the file."""
    names = ("cameras", "images", "points3D")
    lines = {name: (folder / f"{name}.txt").read_text(encoding="utf-8").splitlines() for name in names}
    return {name: [line.split(" ") for line in lines[name] if line[:1] != "#"] for name in names}
