"""Gaussian splats as bare records of 32 bytes (`.splat`): no header, no harmonics beyond the colour.

A record is three floats of the centre, three of the standard deviations, four bytes of colour and opacity (sRGB, alpha)
and four of the quaternion (w, x, y, z), each as 128 + 128 q. Units and axes are not stated.
"""

from pathlib import Path

import numpy as np

from dcap.scene.errors import FormatError
from dcap.scene.problems import Report, refusing
from dcap.scene.readers.files.content import read_bytes
from dcap.scene.readers.splats.splats import Fields, check_count, gaussians_of, logit_of
from dcap.scene.types.gaussians import DC, Gaussians

RECORD = np.dtype([("position", "<f4", 3), ("scale", "<f4", 3), ("color", "u1", 4), ("rotation", "u1", 4)])
"""One Gaussian, 32 bytes."""

THINNEST = np.float32(1e-9)
"""Size of what is flat by rounding: zero has no logarithm [file units]."""


def read_splat_records(path: Path, report: Report | None = None) -> Gaussians:
    """Read a file of records, in its own units and axes."""
    size = path.stat().st_size if path.is_file() else 0
    if size % RECORD.itemsize:
        raise FormatError(f"{path}: {size} bytes are no whole number of records of {RECORD.itemsize} bytes")
    check_count(path, size // RECORD.itemsize)
    rows = np.frombuffer(read_bytes(path), RECORD)
    with np.errstate(invalid="ignore"):  # a size below zero is told by its logarithm
        log_scale = np.log(np.where(rows["scale"] == 0.0, THINNEST, rows["scale"]))
    color = rows["color"].astype(np.float32) / 255.0
    fields: Fields = (
        rows["position"].copy(),
        log_scale,
        (rows["rotation"].astype(np.float32) - 128.0) / 128.0,
        logit_of(color[:, 3]).astype(np.float32),
        (color[:, :3] - 0.5) / np.float32(DC),
        np.zeros((len(rows), 3, 0), np.float32),
    )
    return gaussians_of(fields, report or refusing(path))
