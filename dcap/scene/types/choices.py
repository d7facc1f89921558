"""Choices of the stages that read the sentence: the intent, the rotation and the anchor.

Point of view on a thing: left and right are those of a viewer who looks at its front.

A thing without a front, such as a table in the middle of a room, has no natural viewer. The viewer is then assumed at
the long side that faces the room, and the result notes it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array
from dcap.scene.types.boxes import OrientedBox

VIEWED = frozenset({"left", "right", "front", "back", "head", "foot"})
"""Sides that depend on the viewer; up and down do not."""
MIDDLE = 0.1
"""Distance between the middles of thing and room up to which no side counts as facing the room [m]."""
POSE_OF_THE_FILE = "the pose of the file is kept"
"""Reason given for a rotation that was not chosen."""


@dataclass(frozen=True, slots=True)
class OrientationRequest:
    """Requested orientation."""

    pose: str
    """upright (right way up) | seated (as such a thing usually rests) | standing (on end) | upside_down | on_side |
    on_left_side | on_right_side | lying | on_back | on_front | leaning | any (nothing said)."""
    facing: str
    """Id of an instance or 'part:NAME' or 'wall' | 'door' | 'viewer' to face; empty: none."""
    words: str
    """The words that state it."""
    turn_deg: float = 0.0
    """Turn about the vertical beyond the facing or the usual alignment, counterclockwise seen from above [degrees]."""
    lean: str = ""
    """Id of an instance or 'part:NAME' of the base that the object leans on; empty: it stands on its own."""


@dataclass(frozen=True, slots=True)
class RegionConstraint:
    """Constraint on a place, besides its region."""

    kind: str
    """not_on (neither on the reference nor over or under it) | not_in (not in that region) | exactly | at_least |
    at_most (distance from it) | farthest | nearest | away (from it)."""
    regions: tuple[str, ...]
    """Region names as in RegionRequest, of the part or next to the reference; for distances edge, corner or end with
    sides; empty: the reference itself."""
    reference: str
    """Instance id, 'part:NAME' or 'part:NAME/SIDE'; empty: the part's own regions."""
    metres: float | None = None
    """The distance for exactly, at_least and at_most [m]: the free gap between the object and the reference, seen from
    above."""
    words: str = ""
    """The words that state it."""


@dataclass(frozen=True, slots=True)
class SupportCandidate:
    """An instance that the sentence may mean."""

    id: str
    label: str
    score: float
    """Likelihood that the sentence means it, 0..1."""


@dataclass(frozen=True, slots=True)
class RegionRequest:
    """Requested place on the support."""

    part: str
    """Name of the requested part, or empty."""
    names: tuple[str, ...]
    """Among: center, left, right, front, back, head, foot, edge, corner, near, next_to, between, middle, any; combined
    ('left', 'front')."""
    references: tuple[str, ...]
    """Instance ids or 'part:NAME' that near / next_to / between refer to."""
    words: str
    """The words that state it."""
    which: str = ""
    """Choice among several parts of that name: left, right, top, bottom, middle or a number counted from below; or
    empty."""
    constraints: tuple[RegionConstraint, ...] = ()
    """Further constraints on the place; all must hold."""


@dataclass(frozen=True, eq=False, slots=True)
class Intent:
    """One answer to one question."""

    base_id: str
    base_label: str
    object_name: str
    """Category of the object: ball, mug, plush toy ..."""
    size: NDArray[np.float64]
    """Size prior in the state of the mesh (folded ...), extents sorted descending [m], shape (3,)."""
    mass: float
    """Mass prior [kg]."""
    hollow: bool
    """Whether the mass differs from density times the volume of the closed mesh."""
    scale: float
    """Isotropic factor for the object mesh: 1, the factor of a unit, or to the usual size (`tasks.intent.rescale`)."""
    orientation: OrientationRequest
    region: RegionRequest
    not_understood: tuple[str, ...]
    """Words without effect."""
    notes: tuple[str, ...]
    candidates: tuple[SupportCandidate, ...] = ()
    """Supports that the sentence may mean, the chosen one first."""
    mass_given: bool = False
    """Whether the mass comes from the user and must not be replaced by density times volume."""
    at: NDArray[np.float64] | None = None
    """The place on the base given by the user [m], shape (3,); None: the region determines it."""

    def __post_init__(self) -> None:
        if self.at is not None:
            check_array("at", self.at, 3)


def viewer_side(
    box: OrientedBox, front: NDArray[np.float64] | None, room_center: NDArray[np.float64]
) -> tuple[NDArray[np.float64], int]:
    """Unit vector towards the viewer, shape (2,), and the box axis along it: the side nearest to the front, or without
    a front the long side towards the room, whose middle is `room_center` [m], shape (2,) or (3,)."""
    axes, half = box.axes[:2, :2], box.half_extents[:2]
    sides = [(axes[:, k] * sign, k) for k in (0, 1) for sign in (1.0, -1.0)]
    if front is not None and np.linalg.norm(front[:2]) > 0:
        return max(sides, key=lambda s: float(s[0] @ front[:2]))
    axis = 1 if half[0] >= half[1] else 0
    direction = axes[:, axis]
    inward = float(direction @ (room_center[:2] - box.center[:2]))
    # in the middle of the room neither long side is nearer: the viewer is on the -y side, as on a floor plan
    away = inward < 0 if abs(inward) > MIDDLE else float(direction @ (0.01, 1.0)) > 0
    return (-direction if away else direction), axis


def axis_word(direction: NDArray[np.float64]) -> str:
    """The world axis nearest to a horizontal direction: +x, -x, +y or -y."""
    axis = int(abs(direction[1]) >= abs(direction[0]))
    return f"{'+' if direction[axis] > 0 else '-'}{'xy'[axis]}"


@dataclass(frozen=True, eq=False, slots=True)
class AskedPose:
    """Requested orientation, as directions of the mesh, for comparison with the rest state."""

    name: str
    """upright, on_back ... as in `OrientationRequest`; any: none."""
    axis: NDArray[np.float64]
    """Direction in the mesh that defines the pose: its upright axis, front or left, unit, shape (3,)."""
    from_vertical: float | None
    """Requested angle of that direction from the vertical [rad]; None: unknown, use the angle before the drop."""
    up: NDArray[np.float64]
    """Upward direction in the mesh in its usual pose, unit, shape (3,)."""
    front: NDArray[np.float64]
    """Its front, unit, shape (3,)."""
    doubt: str = ""
    """Reason why the shape does not determine that pose; empty: it does."""
    facing_doubt: str = ""
    """Reason why the shape does not determine its front, if a facing is requested; empty: it does."""
    either_way: bool = False
    """Whether the axis has no direction: a book stands on either end."""
    looks: NDArray[np.float64] | None = None
    """Direction in the mesh that a facing or a turn refers to, unit, shape (3,); None: not requested or unknown."""
    ahead: NDArray[np.float64] | None = None
    """Requested horizontal direction of `looks` in the world, unit, shape (3,); None as above."""


@dataclass(frozen=True, eq=False, slots=True)
class Rotation:
    """R*: object mesh frame (as read, z up) to world."""

    matrix: NDArray[np.float64]
    """Rotation, orthonormal, det +1, shape (3, 3)."""
    pictures: tuple[NDArray[np.uint8], ...]
    """The three flips about x, y, z as RGB images, each (h, w, 3); empty if none were used."""
    refined_prompt: str
    candidate: str
    """Id of the chosen stable pose or flip."""
    reason: str
    pose: AskedPose | None = None
    """Requested orientation; None without one."""


@dataclass(frozen=True, eq=False, slots=True)
class Lean:
    """Leaning of an object before the drop."""

    on: str
    """Instance id, or 'part:NAME' of the base, that the object leans on."""
    angle: float
    """Tilt of the object's upright axis from the vertical [rad]."""
    axis: NDArray[np.float64]
    """That axis at the start, a unit vector in the world, shape (3,)."""

    def __post_init__(self) -> None:
        check_array("axis", self.axis, 3)


@dataclass(frozen=True, eq=False, slots=True)
class Anchor:
    """The pre-drop pose."""

    base_id: str
    part: str
    """Name of the part hit."""
    part_index: int
    """Index into the base instance's parts."""
    region: str
    """Canonical region words joined by spaces, 'center' if none was requested."""
    local: NDArray[np.float64]
    """Anchor in the part's box frame, -1..1 along its axes, shape (2,)."""
    surface_point: NDArray[np.float64]
    """x_s: hit of the ray along gravity on the part [m], shape (3,)."""
    world_from_object: NDArray[np.float64]
    """Pre-drop pose: object mesh (as read) to world: translation @ R* @ scale, shape (4, 4)."""
    clearance: float
    """Smallest vertical gap between the object and the surfaces beneath it at the start [m]."""
    region_polygon: NDArray[np.float64]
    """Requested region on the part, world xy [m], shape (k, 2), counter-clockwise; used only for `region_missed`."""
    reason: str
    lean: Lean | None = None
    """Leaning; None if the object stands on its own."""
    notes: tuple[str, ...] = ()
    """Interpretations of the place that deviate from the literal words."""
    pose: AskedPose | None = None
    """Requested orientation; None if there is none, or if the object leans."""

    def __post_init__(self) -> None:
        check_array("local", self.local, 2)
        check_array("surface_point", self.surface_point, 3)
        check_array("world_from_object", self.world_from_object, 4, 4)
        check_array("region_polygon", self.region_polygon, None, 2)
