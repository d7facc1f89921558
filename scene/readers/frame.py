"""Units and axes: from the file's own coordinates to metres, right-handed, z up.

Order of trust: the user's option, then the format's standard, then an estimate from the content; always reported.
An estimate never assumes millimetres or inches: those differ from a mesh a thousand times too large by nothing but the
user's word, so a mesh of such a size is refused with the option that settles it. Centimetres are assumed only where
millimetres would make less than 4 cm of it: what is that long or longer is never taken ten times too large.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from scene.errors import InputError
from scene.readers.raw import RawMesh
from scene.sample import SourceOptions

UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Length of each unit [m]."""


class Role(StrEnum):
    """What a mesh is used as: it decides which sizes are plausible and which option is named."""

    SCENE = "scene"
    OBJECT = "object"


@dataclass(frozen=True)
class Limits:
    """Sizes (largest extent) that make sense for a role."""

    smallest: float
    """Below it the mesh is refused [m]."""
    largest: float
    """Above it the mesh is refused [m]."""
    metres_up_to: float
    """A mesh without a stated unit is taken as metres up to this many units [-]."""
    centimetres_up_to: float
    """... and as centimetres up to this many [-]; beyond, the user must say. Equal to the above: never."""


LIMITS = {
    Role.SCENE: Limits(smallest=0.005, largest=200.0, metres_up_to=40.0, centimetres_up_to=40.0),
    Role.OBJECT: Limits(smallest=0.001, largest=20.0, metres_up_to=3.0, centimetres_up_to=40.0),
}
"""A scene is anything from a mug to a hall; an object is something that a person puts down.
Of 40 to 600 units a scene is as well a room in centimetres as a stool in millimetres: only the user knows."""


@dataclass(frozen=True)
class Frame:
    """How a file's coordinates map to ours."""

    world_from_file: NDArray[np.float64]
    """Shape (4, 4)."""
    up: str
    unit_metres: float
    unit_source: str
    notes: tuple[str, ...]


def find_frame(raw: RawMesh, options: SourceOptions, role: Role) -> Frame:
    """Decide unit and up axis, and refuse a mesh of absurd size."""
    notes: list[str] = []
    unit, source = _unit(raw, options, role, notes)
    up = _up(raw, options, role, notes)
    world_from_file = np.eye(4)
    if up == "y":  # (x, y, z) -> (x, -z, y)
        world_from_file[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    world_from_file[:3, :3] *= unit
    return Frame(world_from_file, up, unit, source, tuple(notes))


def _option(role: Role, name: str) -> str:
    return f"--object-{name}" if role is Role.OBJECT else f"--{name}"


def _unit(raw: RawMesh, options: SourceOptions, role: Role, notes: list[str]) -> tuple[float, str]:
    """Length of the file's unit [m] and who said so."""
    extent = float(np.ptp(raw.vertices, axis=0).max())
    limits = LIMITS[role]
    if options.unit != "auto":
        if options.unit not in UNITS:
            raise InputError(f"{_option(role, 'unit')} {options.unit!r} is not one of auto, {', '.join(UNITS)}")
        unit, source = UNITS[options.unit], "option"
    elif raw.unit_metres:
        unit, source = raw.unit_metres, "format"
    elif extent <= limits.metres_up_to:
        unit, source = 1.0, "estimate"
    elif extent <= limits.centimetres_up_to:
        unit, source = 0.01, "estimate"
        notes.append(
            f"{extent:.3g} units long and without a stated unit: taken as centimetres ({_option(role, 'unit')})"
        )
    else:
        raise InputError(f"{raw.path}: {_size_line(extent, role)}")
    size = extent * unit
    if not limits.smallest <= size <= limits.largest:
        raise InputError(
            f"{raw.path}: {size:.4g} m long as a {role} (unit {unit:g} m, by {source}), "
            f"expected {limits.smallest:g} to {limits.largest:g} m; set {_option(role, 'unit')} to m, cm, mm or in"
        )
    return unit, source


def _size_line(extent: float, role: Role) -> str:
    sizes = ", ".join(f"{name}: {extent * UNITS[name]:.3g} m" for name in ("m", "cm", "mm"))
    return f"{extent:.4g} units long and the file states no unit ({sizes}); set {_option(role, 'unit')}"


def _up(raw: RawMesh, options: SourceOptions, role: Role, notes: list[str]) -> str:
    """The up axis: y or z."""
    if options.up != "auto":
        if options.up not in ("y", "z"):
            raise InputError(f"{_option(role, 'up')} {options.up!r} is not one of auto, y, z")
        return options.up
    evidence = {axis: _evidence(raw, index) for axis, index in (("y", 1), ("z", 2))}
    if raw.up:
        other = "z" if raw.up == "y" else "y"
        if _contradicts(evidence[raw.up], evidence[other]):
            notes.append(f"{other} taken as up against the format's {raw.up}: it stands on it ({_option(role, 'up')})")
            return other
        return raw.up
    up = _estimated_up(raw, evidence)
    notes.append(f"{up} taken as up, estimated from the shape ({_option(role, 'up')})")
    return up


@dataclass(frozen=True)
class UpEvidence:
    """What speaks for one axis being up."""

    grounded: bool
    """The lowest coordinate is zero."""
    floating: bool
    """The origin lies well inside."""
    level_area: float
    """Area of faces perpendicular to the axis [units^2]."""
    foot: float
    """Area of the hull of the lowest points, as a share of the whole footprint; 0 if the middle is not above it."""


def _evidence(raw: RawMesh, axis: int) -> UpEvidence:
    low, high = raw.vertices.min(axis=0), raw.vertices.max(axis=0)
    extent = high - low
    height, largest = float(extent[axis]), float(extent.max())
    a, b, c = (raw.vertices[raw.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    area = 0.5 * np.linalg.norm(normals, axis=1)
    level = np.abs(normals[:, axis]) > 0.95 * 2.0 * np.maximum(area, 1e-300)
    return UpEvidence(
        grounded=abs(float(low[axis])) <= 0.015 * largest,
        floating=float(low[axis]) < -0.1 * height,
        level_area=float(area[level].sum()),
        foot=_foot(raw.vertices, axis, low, height),
    )


def _foot(vertices: NDArray[np.float64], axis: int, low: NDArray[np.float64], height: float) -> float:
    """Share of the footprint on which the mesh would stand along `axis`."""
    flat = np.delete(vertices, axis, axis=1)
    lowest = flat[vertices[:, axis] <= low[axis] + 0.03 * height]
    try:
        whole, foot = ConvexHull(flat), ConvexHull(lowest)
    except (QhullError, ValueError):
        return 0.0
    middle = flat.mean(axis=0)
    inside = bool((foot.equations[:, :2] @ middle + foot.equations[:, 2] <= 0).all())
    return float(foot.volume / whole.volume) if inside else 0.0


def _contradicts(standard: UpEvidence, other: UpEvidence) -> bool:
    """Whether the content speaks clearly against the format's own up axis.

    A picture with its back in a coordinate plane would lie well, but it can stand on its edge too: the format is right.
    """
    lies = other.grounded and standard.floating and other.level_area > 1.5 * standard.level_area
    return lies and other.foot > 1.5 * standard.foot


def _estimated_up(raw: RawMesh, evidence: dict[str, UpEvidence]) -> str:
    """Without a standard: where the mesh stands; in doubt y for OBJ (modelling tools), z else (scanners, CAD)."""
    y, z = evidence["y"], evidence["z"]
    if y.grounded != z.grounded:
        return "y" if y.grounded else "z"
    default = "y" if raw.path.suffix.lower() == ".obj" else "z"
    if max(y.foot, z.foot) > 1.5 * min(y.foot, z.foot):
        return "y" if y.foot > z.foot else "z"
    return default
