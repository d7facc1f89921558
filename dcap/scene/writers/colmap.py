"""COLMAP models to files: cameras, images and points3D, binary (what programs read first) or as text.

The layouts are those of dcap/scene/readers/scenes/colmap.py; no observations and no tracks are written.
"""

import struct
from pathlib import Path

import numpy as np

from dcap.scene.types.colmap import ColmapModel

PINHOLE = 1
"""COLMAP's number of the camera model."""
NO_ERROR = -1.0
"""Reprojection error of points without matches [pixel]."""

COLUMNS = {
    "cameras": "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]",
    "images": "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of X Y POINT3D_ID",
    "points3D": "POINT3D_ID X Y Z R G B ERROR TRACK[]",
}


def write_colmap(folder: Path, model: ColmapModel) -> None:
    """Write cameras.bin, images.bin and points3D.bin."""
    folder.mkdir(parents=True, exist_ok=True)
    cameras = [struct.pack("<iiQQ4d", c.id, PINHOLE, c.width, c.height, *c.focal, *c.center) for c in model.cameras]
    images = [
        struct.pack("<i7di", i.id, *i.quaternion, *i.translation, i.camera_id) + i.name.encode() + bytes(9)
        for i in model.images
    ]  # a zero ends the name, then comes the number of observations: none
    points = np.zeros(
        len(model.points),
        dtype=[("id", "<u8"), ("place", "<f8", 3), ("color", "u1", 3), ("error", "<f8"), ("track", "<u8")],
    )
    points["id"], points["place"], points["color"] = np.arange(1, len(points) + 1), model.points, model.colors
    points["error"] = NO_ERROR
    for name, count, rows in (
        ("cameras", len(cameras), b"".join(cameras)),
        ("images", len(images), b"".join(images)),
        ("points3D", len(points), points.tobytes()),
    ):
        (folder / f"{name}.bin").write_bytes(struct.pack("<Q", count) + rows)


def write_colmap_text(folder: Path, model: ColmapModel) -> None:
    """Write cameras.txt, images.txt and points3D.txt, with enough digits to restore the same numbers."""
    folder.mkdir(parents=True, exist_ok=True)

    def line(*values: object) -> str:
        return " ".join(repr(float(v)) if isinstance(v, float) else str(v) for v in values) + "\n"

    rows = {
        "cameras": [line(c.id, "PINHOLE", c.width, c.height, *c.focal, *c.center) for c in model.cameras],
        "images": [
            line(i.id, *i.quaternion.tolist(), *i.translation.tolist(), i.camera_id, i.name) + "\n"
            for i in model.images
        ],
        "points3D": [
            line(k + 1, *place, *color, NO_ERROR)
            for k, (place, color) in enumerate(zip(model.points.tolist(), model.colors.tolist(), strict=True))
        ],
    }
    for name, lines in rows.items():
        (folder / f"{name}.txt").write_text("".join([f"# {COLUMNS[name]}\n", *lines]), encoding="utf-8")
