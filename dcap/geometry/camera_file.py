"""Cameras as JSON in OpenCV's convention.

Keys: `width`, `height`, `fx`, `fy`, `cx`, `cy` [pixel] and `world_from_camera`, a 4x4 matrix row by row [m]; x to the
right, y down, z forward. As in OpenCV the middle of the first pixel is (0, 0); ours, like COLMAP's, is (0.5, 0.5).
"""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from dcap.geometry.camera import Camera
from dcap.scene.errors import InputError

PIXEL_MIDDLE = 0.5
"""Our coordinate of the middle of OpenCV's pixel (0, 0) [pixel]."""
LARGEST = 16_384
"""Maximum number of pixels along a side [pixel]."""
MOST = 4096 * 4096
"""Maximum number of pixels: a ray takes about a hundred bytes, so this many take 2 GiB [pixel]."""
FARTHEST = 100.0
"""Largest plausible focal length and distance of the principal point, over the picture's width [-]: 0.6 degrees of
view."""
DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "distortion", "dist_coeffs", "distortion_coefficients")
"""Keys of lens distortion, which pinhole pictures do not have."""
TURNED = 1e-3
"""Tolerance of a rotation matrix [-]: files are rounded."""
Row = tuple[float, float, float, float]
Side = Annotated[int, Field(ge=1, le=LARGEST)]
Focal = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class CameraFile(BaseModel, frozen=True, extra="allow"):
    """The content of the file."""

    width: Side
    height: Side
    fx: Focal
    fy: Focal
    cx: Finite
    cy: Finite
    world_from_camera: tuple[Row, Row, Row, Row]


def write_camera(path: Path, camera: Camera) -> None:
    """Write a camera."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = camera.world_from_camera, camera.position
    (fx, fy), (cx, cy) = camera.focals.tolist(), (camera.principal - PIXEL_MIDDLE).tolist()
    tree = {
        "width": camera.width, "height": camera.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
        "world_from_camera": pose.tolist(),
    }  # fmt: skip
    path.write_text(json.dumps(tree, indent=1) + "\n", encoding="utf-8")


def read_camera(path: Path, target: NDArray[np.float64]) -> Camera:
    """Read a camera; `target` is assumed to be the point that it looks at [m], shape (3,). Raises InputError with the
    problem."""
    try:
        found = CameraFile.model_validate_json(path.read_bytes())
    except OSError as error:
        raise InputError(f"--camera {path}: {error.strerror or error}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(one) for one in first["loc"])
        raise InputError(f"--camera {path}: {where + ': ' if where else ''}{first['msg']}") from None
    check_pixels(path, found)
    pose = np.array(found.world_from_camera)
    turn = pose[:3, :3]
    if not np.isfinite(pose).all() or np.abs(turn @ turn.T - np.eye(3)).max() > TURNED or np.linalg.det(turn) < 0.0:
        raise InputError(
            f"--camera {path}: world_from_camera is not a rigid motion; its first three columns must be a rotation"
        )
    if np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max() > TURNED:
        raise InputError(f"--camera {path}: the last row of world_from_camera is {pose[3].tolist()}, expected 0 0 0 1")
    return Camera(
        pose[:3, 3], target, turn, found.width, found.height, found.fx,
        middle=(found.cx + PIXEL_MIDDLE, found.cy + PIXEL_MIDDLE), stretch=found.fy / found.fx,
    )  # fmt: skip


def check_pixels(path: Path, found: CameraFile) -> None:
    """Raise InputError for oversized pictures, cameras that see nothing, and lenses that are not pinholes."""
    if found.width * found.height > MOST:
        raise InputError(
            f"--camera {path}: {found.width} x {found.height} pixels are more than {MOST}; give a smaller view"
        )
    side = max(found.width, found.height)
    for name in ("fx", "fy", "cx", "cy"):
        value = abs(getattr(found, name))
        if value > FARTHEST * side or (name in ("fx", "fy") and value < side / FARTHEST):
            raise InputError(
                f"--camera {path}: {name} = {getattr(found, name):g} does not fit a picture of {side} pixels"
            )
    for name, value in (found.model_extra or {}).items():
        if name in DISTORTION and np.any(np.asarray(value, dtype=object) != 0):
            raise InputError(f"--camera {path}: {name} is not 0; undistort the photo first, maps need a pinhole camera")
