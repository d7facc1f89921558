"""Units and axes: from the file's own coordinates to metres, right-handed, z up.

Order of trust: the user's option, then the format's standard, then an estimate from the content; always reported. An
estimate never assumes millimetres or inches, because only the user's word distinguishes them from a mesh that is a
thousand times too large; such a mesh is refused with the option that settles it. Centimetres are only assumed if the
mesh would be less than 4 cm in millimetres: a mesh of that length or longer is never made ten times too large.

Determines the upward axis of a file from its content.

A mesh stands on the plane through its origin, or on its feet. A room is recognised by its walls and oriented by its
furniture, which fills the lower half, so y down, as often in structure from motion, is recognised too. A mesh that is
not a room is never turned upside down, as a table stands as well on its top as on its legs; splats may be, by their
ground.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dcap.scene.errors import InputError
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import METRES

AXES = {"y": 1, "z": 2}

LEVEL = 0.9
"""Least share of a unit normal along an axis for a level face [-]."""

SLAB = 0.05
"""Share of the extent that counts as the end of a room or scene: its floor, ceiling or wall [-]."""

COVERED = 0.4
"""Share of a side that level faces must cover for it to be a wall [-]: windows, doors and furniture hide the rest."""

WALLS = 4
"""Number of the six sides that are covered in a room [-]; the ceiling is often missing."""

ROOM_METRES = (1.5, 2.2)
"""Least smallest and middle extent of a room [m]: larger than any single piece of furniture."""

HEAVY = 0.03
"""Shift of the middle of a room's content, as a share of its height, that weighs as much as ... [-]."""
LEVEL_HEAVY = 0.4
"""... this shift of its level faces [-], and as ..."""
UPRIGHT = 0.03
"""... this difference in the share of faces that are level or upright [-]. All three from the embedded rooms."""
MOST_UPRIGHT = 1.5
"""Maximum weight of uprightness [-]."""

CLEARLY = 3.0
"""Multiple of UPRIGHT that determines the axis on its own: walls of a scan stand at any heading, but they stand [-]."""

GROUND = 0.5
"""Least share of the footprint that a ground covers [-]; the other end has less than half of it."""
WORLD_FROM_FILE = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],  # (x, y, z) -> (x, -z, y)
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
}
"""Rotation that brings each axis of a file up: a turn about its x."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces by area, place and direction."""

    center: NDArray[np.float64]
    """Centres of the faces, shape (m, 3)."""
    normal: NDArray[np.float64]
    """Absolute components of the unit normals, shape (m, 3)."""
    area: NDArray[np.float64]
    """Areas of the faces, shape (m,)."""
    low: NDArray[np.float64]
    """Bounds without the outermost half percent of the area on either side, shape (3,)."""
    high: NDArray[np.float64]

    @classmethod
    def of(cls, raw: RawMesh) -> "Faces":
        """Measure a mesh."""
        a, b, c = (raw.vertices[raw.faces[:, i]] for i in range(3))
        normal = np.cross(b - a, c - a)
        twice = np.linalg.norm(normal, axis=1)
        center, area = (a + b + c) / 3.0, 0.5 * twice
        corners, share = np.concatenate([a, b, c]), np.tile(area, 3)
        ends = np.array([_quantiles(corners[:, k], share, (0.005, 0.995)) for k in range(3)])
        return cls(center, np.abs(normal) / np.maximum(twice, 1e-300)[:, None], area, ends[:, 0], ends[:, 1])

    def height(self, axis: int) -> NDArray[np.float64]:
        """Height of the faces along an axis, 0 at the lower end and 1 at the upper end, shape (m,)."""
        extent = max(float(self.high[axis] - self.low[axis]), 1e-300)
        return np.asarray((self.center[:, axis] - self.low[axis]) / extent)

    def covered(self, axis: int) -> tuple[float, float]:
        """Share of the lower and upper side across an axis that level faces cover."""
        footprint = max(float(np.prod(np.delete(self.high - self.low, axis))), 1e-300)
        level, height = self.normal[:, axis] > LEVEL, self.height(axis)
        return tuple(float(self.area[level & end].sum()) / footprint for end in (height < SLAB, height > 1.0 - SLAB))  # type: ignore[return-value]


def _quantiles(values: NDArray[np.float64], weight: NDArray[np.float64], shares: tuple[float, ...]) -> list[float]:
    """Values below which a share of the weight lies."""
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    at = np.minimum(np.searchsorted(total, np.array(shares) * total[-1]), len(order) - 1)
    return [float(v) for v in values[order[at]]]


def up_of_scene(raw: RawMesh, unit: float) -> tuple[str, str] | None:
    """The up axis of a room or another large scene, and the evidence; None for a mesh that may be a single thing."""
    faces = Faces.of(raw)
    smallest, middle, _ = np.sort(faces.high - faces.low) * unit
    if middle < ROOM_METRES[1]:
        return None
    sides = [share for axis in range(3) for share in faces.covered(axis)]
    if smallest >= ROOM_METRES[0] and sum(share > COVERED for share in sides) >= WALLS:
        return _furnished(faces), "how the room is furnished"
    grounds = _grounds(faces)
    if len(grounds) == 1:
        return grounds[0], "the ground"
    more = _upright(faces, AXES["z"]) - _upright(faces, AXES["y"])
    return ("z" if more > 0.0 else "y", "its upright walls") if abs(more) > CLEARLY * UPRIGHT else None


def _furnished(faces: Faces) -> str:
    """The direction in which the content of a room lies low."""
    upright = {name: _upright(faces, axis) for name, axis in AXES.items()}
    more = float(np.clip((upright["z"] - upright["y"]) / UPRIGHT, -MOST_UPRIGHT, MOST_UPRIGHT))
    low = {name: _lowness(faces, axis) for name, axis in AXES.items()}
    score = {"z": low["z"] + more, "-z": -low["z"] + more, "y": low["y"] - more, "-y": -low["y"] - more}
    return max(score, key=lambda up: score[up])


def _grounds(faces: Faces) -> list[str]:
    """Directions with a ground below and no comparable surface above."""
    found = []
    for name, axis in AXES.items():
        low, high = faces.covered(axis)
        found += [name] if low > GROUND and high < 0.5 * GROUND else []
        found += [f"-{name}"] if high > GROUND and low < 0.5 * GROUND else []
    return found


def _lowness(faces: Faces, axis: int) -> float:
    """Distance below the middle of the faces between the ends of an axis, with level faces counted twice [-]."""
    height, level = faces.height(axis), faces.normal[:, axis] > LEVEL
    inner = (height > 1.5 * SLAB) & (height < 1.0 - 1.5 * SLAB)
    below = [0.5 - float(np.average(height[k], weights=faces.area[k] + 1e-300)) if k.any() else 0.0
             for k in (inner, inner & level)]  # fmt: skip
    return below[0] / HEAVY + below[1] / LEVEL_HEAVY


def _upright(faces: Faces, axis: int) -> float:
    """Share of the area that is level or upright if an axis is vertical [-]: furniture stands at any heading."""
    along = faces.normal[:, axis]
    return float(faces.area[(along > 0.95) | (along < 0.1)].sum() / faces.area.sum())


@dataclass(frozen=True)
class UpEvidence:
    """Evidence for one axis being up."""

    grounded: bool
    """Whether the lowest coordinate is zero."""
    floating: bool
    """Whether the origin lies well inside."""
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


def contradicts_standard(raw: RawMesh) -> bool:
    """Return whether the content clearly contradicts the format's own up axis.

    A picture with its back in a coordinate plane would lie well, but it can also stand on its edge: the format is
    right.
    """
    standard, other = _evidence(raw, AXES[raw.up]), _evidence(raw, 3 - AXES[raw.up])
    lies = other.grounded and standard.floating and other.level_area > 1.5 * standard.level_area
    return lies and other.foot > 1.5 * standard.foot


def estimated_up(raw: RawMesh) -> tuple[str, str]:
    """The up axis if no standard states it, and the evidence."""
    if raw.of_splats:
        return _up_of_splats(raw)
    y, z = _evidence(raw, 1), _evidence(raw, 2)
    if y.grounded != z.grounded:
        return "y" if y.grounded else "z", "the shape"
    if max(y.foot, z.foot) > 1.5 * min(y.foot, z.foot):
        return "y" if y.foot > z.foot else "z", "the shape"
    # in doubt y for modelling tools, z for scanners and CAD
    return "y" if raw.path.suffix.lower() == ".obj" else "z", "the shape"


def _up_of_splats(raw: RawMesh) -> tuple[str, str]:
    """The direction away from the ground, or from the plane through the origin; in doubt y down, as in structure from
    motion."""
    faces = Faces.of(raw)
    grounds = _grounds(faces)
    near = 0.015 * float((faces.high - faces.low).max())
    ends = [(name, faces.low[axis]) for name, axis in AXES.items()]
    ends += [(f"-{name}", faces.high[axis]) for name, axis in AXES.items()]
    planes = [up for up, bottom in ends if abs(float(bottom)) <= near]
    found = [up for up in planes if up in grounds] or grounds or planes
    if len(found) == 1:
        return found[0], "the ground" if grounds else "the plane through the origin"
    return "-y", "convention alone, as neither a room nor a ground is recognised"


class Role(StrEnum):
    """Use of a mesh, which determines plausible sizes and the option named in messages."""

    SCENE = "scene"
    OBJECT = "object"


@dataclass(frozen=True)
class Limits:
    """Sizes (largest extent) that make sense for a role."""

    smallest: float
    """Largest extent below which the mesh is refused [m]."""
    largest: float
    """Largest extent above which the mesh is refused [m]."""
    metres_up_to: float
    """Largest extent up to which a mesh without a stated unit is in metres [units]."""
    centimetres_up_to: float
    """... and up to which it is in centimetres [units]; above, the user must state the unit. Equal to the above:
    never."""


LIMITS = {
    Role.SCENE: Limits(smallest=0.005, largest=200.0, metres_up_to=40.0, centimetres_up_to=40.0),
    Role.OBJECT: Limits(smallest=0.001, largest=20.0, metres_up_to=3.0, centimetres_up_to=40.0),
}
"""A scene is anything from a mug to a hall; an object is a thing that a person puts down. With 40 to 600 units a scene
may be a room in centimetres or a stool in millimetres: only the user knows."""

ANY = "any"
ROOM = (2.0, 40.0, 6.0)
"""Extents at which a scene of any unit is left unchanged, and the extent to which it is scaled otherwise [m]."""
BY_HEIGHT = "--height-of THING=METRES, for example --height-of table=0.75"
"""A way for a person to state the scale of a scene without measuring units."""


FAR_M = 100.0
"""A mesh whose middle is farther from the origin is moved there: single precision, as in GLB files and ray tracing, has
steps of 0.01 mm at this distance, and of half a metre at the coordinates of a national grid."""
COARSEST_M = 1e-3
"""Largest step between coordinates of a file [m]; above it shapes are lost."""


@dataclass(frozen=True)
class FileFrame:
    """Mapping of a file's coordinates to ours."""

    world_from_file: NDArray[np.float64]
    """Transform, shape (4, 4)."""
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
    """Shift that moves a mesh far from the origin back to it, in whole metres, shape (3,) [m]; zero for a mesh near
    it."""
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
    """Length of the file's unit [m] and its source."""
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
        taken = f"{extent:.3g} units long and without a stated unit; assuming centimetres"
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
