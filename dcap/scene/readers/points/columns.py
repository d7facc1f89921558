"""Points from rows of numbers: which columns are colours and normals is told by what they hold."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.types.point_cloud import PointCloud

Array = NDArray[np.float64]
Notes = tuple[str, ...]

MOST_POINTS = 12_000_000
"""Points that a file may hold [-]: a row of nine numbers each takes 0.9 GB."""
FEWEST_POINTS = 100
"""Points that a surface can be made of [-]."""
FLAT = 0.002
"""Root mean square distance from the best plane over that along it, up to which a cloud is a plane [-]."""
GREY = 200
"""sRGB of points without colours."""
UNIT_LENGTH = 0.02
"""How far the length of a normal may be from 1 [-]."""


def check_point_count(path: Path, count: int) -> None:
    """Refuse more points than we can work with, before memory is taken for them."""
    if count > MOST_POINTS:
        raise InputError(f"{path}: {count} points > {MOST_POINTS}; thin the cloud out first (voxel downsampling)")


def cloud_of(
    path: Path, position: Array, color: NDArray[np.generic] | None, normal: Array | None
) -> tuple[PointCloud, Notes]:
    """Checked points and what is missing of them: coordinates must be finite, many enough, and in no plane."""
    count = len(position)
    if not count:
        raise InputError(f"{path}: no points in it; export the cloud again")
    finite = np.isfinite(position).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise FormatError(
            f"{path}: point {bad} is not finite: {position[bad].tolist()} ({count - int(finite.sum())} of {count} such "
            "points); remove them and save it again"
        )
    check_spread(path, position)
    notes: Notes = ()
    if color is None:
        notes += ("no colours in the file: its points are grey",)
    if normal is not None:
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(normal, axis=1)
        bad = ~(np.isfinite(length) & (length > 1e-6))
        if bad.any():
            notes += (f"{int(bad.sum())} of {count} normals in the file have no direction: none of them is used",)
            normal = None
        else:
            normal = normal / length[:, None]
    shade = np.full((count, 3), GREY, dtype=np.uint8) if color is None else bytes_of(color)
    return PointCloud(np.ascontiguousarray(position, dtype=np.float64), shade, normal), notes


def check_spread(path: Path, position: Array) -> None:
    """Refuse too few points, and those that lie at one place or in a plane or line."""
    count = len(position)
    if count < FEWEST_POINTS:
        raise InputError(f"{path}: {count} points, expected at least {FEWEST_POINTS}; export a denser cloud")
    offset = position - position.mean(axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        moment = offset.T @ offset / count
    if not np.isfinite(moment).all():
        raise FormatError(
            f"{path}: coordinates up to {np.abs(position).max():.3g}, which are no lengths; export it again"
        )
    spread = np.sqrt(np.linalg.eigvalsh(moment).clip(0.0))
    if not spread[2] > 0.0:
        raise InputError(f"{path}: all {count} points lie at {position[0].tolist()}; export the cloud again")
    if spread[0] <= FLAT * spread[2]:
        raise InputError(
            f"{path}: all {count} points lie in a plane (off it by {spread[0]:.2g} units, along it by "
            f"{spread[2]:.2g}), which is no scene and no object; scan it from several sides, or give a mesh"
        )


def bytes_of(color: NDArray[np.generic]) -> NDArray[np.uint8]:
    """Colours (n, 3) as bytes; floats up to 1 are shares, whole numbers up to 65535 have 16 bits."""
    levels = np.nan_to_num(color.astype(np.float64))
    most = float(levels.max(initial=0.0))
    if color.dtype.kind == "f" and most <= 1.0:
        levels *= 255.0
    elif most > 255.0:
        levels *= 255.0 / 65535.0
    return np.clip(np.rint(levels), 0, 255).astype(np.uint8)


def cloud_of_rows(path: Path, rows: Array, first: int = 3) -> tuple[PointCloud, Notes]:
    """Points of rows x y z ... (n, k); columns from `first` on are told by their values."""
    if rows.ndim != 2 or rows.shape[1] < 3:
        raise FormatError(f"{path}: an array of shape {rows.shape}, expected (n, 3) or more columns: x y z ...")
    count = rows.shape[1]
    color: Array | None = None
    normal: Array | None = None
    notes: Notes = ()
    ignored = list(range(4, first + 1))
    at = first
    while at < count:
        three = rows[:, at : at + 3]
        kind = kind_of(three) if at + 3 <= count else ""
        if kind == "normals" and normal is None:
            normal = three
        elif kind == "colours" and color is None:
            color = three
        else:
            ignored.append(at + 1)
            at += 1
            continue
        notes += (f"columns {at + 1} to {at + 3} taken as {kind}",)
        at += 3
    if ignored:
        notes += (f"columns that say neither colours nor normals are ignored: {', '.join(map(str, ignored))}",)
    cloud, more = cloud_of(path, rows[:, :3], color, normal)
    return cloud, notes + more


def kind_of(three: Array) -> str:
    """`normals`, `colours` or nothing: what three columns (n, 3) hold."""
    low, high = float(three.min(initial=0.0)), float(three.max(initial=0.0))
    if not (np.isfinite(low) and np.isfinite(high)):
        return ""
    if low >= -1.01 and high <= 1.01:
        length = np.linalg.norm(three, axis=1)
        if (np.abs(length - 1.0) < UNIT_LENGTH).mean() > 0.9 and (low < 0.0 or len(np.unique(three[:1000])) > 2):
            return "normals"
        return "colours" if low >= 0.0 else ""
    return "colours" if low >= 0.0 and high <= 255.0 and (three == np.rint(three)).all() else ""
