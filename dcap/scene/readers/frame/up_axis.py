"""Which axis of a file points up, told by its content.

A mesh stands on the plane through its origin, or on its feet. A room is recognised by its walls and told from its
furniture, which fills the lower half: so y down, as structure from motion often has it, is found too. A mesh that is no
room is never turned upside down, as a table stands as well on its top as on its legs; splats may be, by their ground.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from dcap.scene.readers.mesh.raw import RawMesh

AXES = {"y": 1, "z": 2}

LEVEL = 0.9
"""Share of a unit normal along an axis from which a face is level [-]."""

SLAB = 0.05
"""Share of the extent that counts as the end of a room or scene: its floor, ceiling or wall [-]."""

COVERED = 0.4
"""Share of a side that level faces cover where it is a wall [-]: windows, doors and furniture hide the rest."""

WALLS = 4
"""Sides of six that are covered in a room [-]; the ceiling is often cut off."""

ROOM_METRES = (1.5, 2.2)
"""Least smallest and middle extent of a room [m]: beyond any single piece of furniture."""

HEAVY = 0.03
"""Shift of the middle of what a room holds, as a share of its height, that weighs as much as ... [-]."""
LEVEL_HEAVY = 0.4
"""... this shift of the level faces in it [-], and as ..."""
UPRIGHT = 0.03
"""... this difference in the share of faces that are level or upright [-]. All three from the embedded rooms."""
MOST_UPRIGHT = 1.5
"""Weight that uprightness has at the most [-]."""

CLEARLY = 3.0
"""So many times UPRIGHT tells the axis alone: walls of a scan stand at any heading, but they stand [-]."""

GROUND = 0.5
"""Share of the footprint that a ground covers [-]; the other end has less than half of it."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces by area, place and direction."""

    center: NDArray[np.float64]
    """Shape (m, 3)."""
    normal: NDArray[np.float64]
    """Absolute components of the unit normals, shape (m, 3)."""
    area: NDArray[np.float64]
    """Shape (m,)."""
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
        """0 at the lower end of an axis, 1 at the upper, shape (m,)."""
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
    """The up axis of a room or another large scene and what tells it; None for what may be a single thing."""
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
    """The direction in which what a room holds lies low."""
    upright = {name: _upright(faces, axis) for name, axis in AXES.items()}
    more = float(np.clip((upright["z"] - upright["y"]) / UPRIGHT, -MOST_UPRIGHT, MOST_UPRIGHT))
    low = {name: _lowness(faces, axis) for name, axis in AXES.items()}
    score = {"z": low["z"] + more, "-z": -low["z"] + more, "y": low["y"] - more, "-y": -low["y"] - more}
    return max(score, key=lambda up: score[up])


def _grounds(faces: Faces) -> list[str]:
    """Directions in which there is a ground below and nothing like it above."""
    found = []
    for name, axis in AXES.items():
        low, high = faces.covered(axis)
        found += [name] if low > GROUND and high < 0.5 * GROUND else []
        found += [f"-{name}"] if high > GROUND and low < 0.5 * GROUND else []
    return found


def _lowness(faces: Faces, axis: int) -> float:
    """How far below the middle the faces between the ends of an axis lie, level faces counted again [-]."""
    height, level = faces.height(axis), faces.normal[:, axis] > LEVEL
    inner = (height > 1.5 * SLAB) & (height < 1.0 - 1.5 * SLAB)
    below = [0.5 - float(np.average(height[k], weights=faces.area[k] + 1e-300)) if k.any() else 0.0
             for k in (inner, inner & level)]  # fmt: skip
    return below[0] / HEAVY + below[1] / LEVEL_HEAVY


def _upright(faces: Faces, axis: int) -> float:
    """Share of the area that is level or upright if an axis is vertical: furniture stands at any heading [-]."""
    along = faces.normal[:, axis]
    return float(faces.area[(along > 0.95) | (along < 0.1)].sum() / faces.area.sum())


@dataclass(frozen=True)
class UpEvidence:
    """Evidence for one axis being up."""

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


def contradicts_standard(raw: RawMesh) -> bool:
    """Whether the content speaks clearly against the format's own up axis.

    A picture with its back in a coordinate plane would lie well, but it can stand on its edge too: the format is right.
    """
    standard, other = _evidence(raw, AXES[raw.up]), _evidence(raw, 3 - AXES[raw.up])
    lies = other.grounded and standard.floating and other.level_area > 1.5 * standard.level_area
    return lies and other.foot > 1.5 * standard.foot


def estimated_up(raw: RawMesh) -> tuple[str, str]:
    """The up axis where no standard says it, and what tells it."""
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
    """Away from the ground, or from the plane through the origin; in doubt y down, as structure from motion has it."""
    faces = Faces.of(raw)
    grounds = _grounds(faces)
    near = 0.015 * float((faces.high - faces.low).max())
    ends = [(name, faces.low[axis]) for name, axis in AXES.items()]
    ends += [(f"-{name}", faces.high[axis]) for name, axis in AXES.items()]
    planes = [up for up, bottom in ends if abs(float(bottom)) <= near]
    found = [up for up in planes if up in grounds] or grounds or planes
    if len(found) == 1:
        return found[0], "the ground" if grounds else "the plane through the origin"
    return "-y", "nothing but custom: neither a room nor a ground is seen"
