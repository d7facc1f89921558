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

from dcap.scene.errors import InputError
from dcap.scene.readers.frame.up_axis import contradicts_standard, estimated_up, up_of_scene
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.units import METRES

WORLD_FROM_FILE = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],  # (x, y, z) -> (x, -z, y)
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}
"""Rotation that brings each axis of a file up: a turn about its x."""


class Role(StrEnum):
    """Use of a mesh: it decides which sizes are plausible and which option is named."""

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

ANY = "any"
ROOM = (2.0, 40.0, 6.0)
"""Extents at which a scene of any unit stays as it is, and what it is made otherwise [m]."""
BY_HEIGHT = "--height-of THING=METRES, for example --height-of table=0.75"
"""How a person may say the scale of a scene without measuring units."""


FAR_M = 100.0
"""A mesh whose middle is farther from the origin is moved there: single precision, as in GLB files and ray tracing, has
steps of 0.01 mm at this distance, and of half a metre at the coordinates of a national grid."""
COARSEST_M = 1e-3
"""Steps between coordinates that a file may have [m]; beyond, its shapes are lost."""


@dataclass(frozen=True)
class FileFrame:
    """How a file's coordinates map to ours."""

    world_from_file: NDArray[np.float64]
    """Shape (4, 4)."""
    up: str
    unit_metres: float
    unit_source: str
    notes: tuple[str, ...]


def find_frame(raw: RawMesh, options: SourceOptions, role: Role) -> FileFrame:
    """Decide unit and up axis, and refuse a mesh of absurd size."""
    notes: list[str] = []
    unit, source = _unit(raw, options, role, notes)
    up = _up(raw, options, role, unit, notes)
    world_from_file = np.eye(4)
    world_from_file[:3, :3] = unit * np.array(WORLD_FROM_FILE[up])
    world_from_file[:3, 3] = _shift(raw, world_from_file[:3, :3], notes)
    return FileFrame(world_from_file, up, unit, source, tuple(notes))


def _shift(raw: RawMesh, linear: NDArray[np.float64], notes: list[str]) -> NDArray[np.float64]:
    """Shift of a mesh far from the origin back to it, in whole metres, shape (3,) [m]; zero for one that is near."""
    middle = linear @ (0.5 * (raw.vertices.min(axis=0) + raw.vertices.max(axis=0)))
    if np.linalg.norm(middle) <= FAR_M:
        return np.zeros(3)
    unit = float(np.linalg.norm(linear[0]))
    step = unit * float(np.spacing(np.float32(np.abs(raw.vertices).max())))
    if step > COARSEST_M and (raw.vertices.astype(np.float32) == raw.vertices).all():
        raise InputError(
            f"{raw.path}: its coordinates, up to {np.abs(raw.vertices).max():.6g}, are in single precision, exact to "
            f"{1e3 * step:.3g} mm only; export it with an offset, or in double precision"
        )
    shift: NDArray[np.float64] = -np.round(middle)
    notes.append(f"moved by ({', '.join(f'{one:.0f}' for one in shift)}) m to the origin (world_from_file)")
    return shift


def option_name(role: Role, name: str) -> str:
    """The option that settles a unit or an axis."""
    return f"--object-{name}" if role is Role.OBJECT else f"--{name}"


def _unit(raw: RawMesh, options: SourceOptions, role: Role, notes: list[str]) -> tuple[float, str]:
    """Length of the file's unit [m] and who said so."""
    extent = float(np.ptp(raw.vertices, axis=0).max())
    limits = LIMITS[role]
    if options.unit == ANY:
        unit = raw.unit_metres or (1.0 if ROOM[0] <= extent <= ROOM[1] else ROOM[2] / extent)
        return unit, "estimate"
    if options.unit != "auto":
        unit, source = _stated_unit(options.unit, role), "option"
    elif raw.unit_metres:
        unit, source = raw.unit_metres, "format"
    elif extent <= limits.metres_up_to:
        unit, source = METRES["m"], "estimate"
    elif extent <= limits.centimetres_up_to:
        unit, source = METRES["cm"], "estimate"
        taken = f"{extent:.3g} units long and without a stated unit: taken as centimetres"
        notes.append(Caution(Cause.ASSUMED, f"{taken} ({option_name(role, 'unit')})"))
    else:
        raise InputError(f"{raw.path}: {_size_line(extent, role)}")
    size = extent * unit
    if not limits.smallest <= size <= limits.largest:
        raise InputError(
            f"{raw.path}: as a {role} it would be {size:.4g} m long (unit {unit:g} m, by {source}), "
            f"expected {limits.smallest:g} to {limits.largest:g} m; set {option_name(role, 'unit')} to m, cm, mm or in"
        )
    return unit, source


def _stated_unit(unit: str, role: Role) -> float:
    """The length of a unit by its name or as a number [m]."""
    if unit in METRES:
        return METRES[unit]
    try:
        metres = float(unit)
    except ValueError:
        metres = 0.0
    if not 0.0 < metres < float("inf"):
        raise InputError(f"{option_name(role, 'unit')} {unit!r} is not one of auto, {', '.join(METRES)}")
    return metres


def _size_line(extent: float, role: Role) -> str:
    sizes = ", ".join(f"{name}: {extent * METRES[name]:.3g} m" for name in ("m", "cm", "mm"))
    or_height = f", or {BY_HEIGHT}" if role is Role.SCENE else ""
    return f"{extent:.4g} units long and the file states no unit ({sizes}); set {option_name(role, 'unit')}{or_height}"


def _up(raw: RawMesh, options: SourceOptions, role: Role, unit: float, notes: list[str]) -> str:
    """The axis of the file that points up: y, z, -y or -z."""
    option = option_name(role, "up")
    if options.up != "auto":
        if options.up not in WORLD_FROM_FILE:
            raise InputError(f"{option} {options.up!r} is not one of auto, {', '.join(WORLD_FROM_FILE)}")
        return options.up
    if raw.up:
        other = "z" if raw.up == "y" else "y"
        if contradicts_standard(raw):
            used = f"{other} is used as up although the format says {raw.up}: the mesh stands on it ({option})"
            notes.append(Caution(Cause.ASSUMED, used))
            return other
        return raw.up
    up, why = (role is Role.SCENE and up_of_scene(raw, unit)) or estimated_up(raw)
    notes.append(Caution(Cause.ASSUMED, f"{up} taken as up, estimated from {why} ({option})"))
    return up
