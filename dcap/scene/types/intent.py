"""Reading of the sentence: support, size and mass of the object, orientation and region in words."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array


@dataclass(frozen=True, slots=True)
class OrientationRequest:
    """Requested orientation."""

    pose: str
    """upright (right way up) | seated (as such a thing usually rests) | standing (on end) | upside_down | on_side |
    on_left_side | on_right_side | lying | on_back | on_front | leaning | any (nothing said)."""
    facing: str
    """Id of an instance or 'part:NAME' or 'wall' | 'door' | 'viewer' to face; empty: none."""
    words: str
    """The words it was read from."""
    turn_deg: float = 0.0
    """Turn about the vertical beyond the facing or the usual alignment, counterclockwise seen from above [degrees]."""
    lean: str = ""
    """Id of an instance or 'part:NAME' of the base that the object leans on; empty: it stands by itself."""


@dataclass(frozen=True, slots=True)
class RegionConstraint:
    """Constraint on a place, besides its region."""

    kind: str
    """not_on (neither on it nor over or under it) | not_in (not in that region) | exactly | at_least | at_most
    (distance from it) | farthest | nearest | away (from it)."""
    regions: tuple[str, ...]
    """Region names as in RegionRequest, of the part or next to the reference; for distances edge, corner or end with
    sides; empty: the reference itself."""
    reference: str
    """Instance id, 'part:NAME' or 'part:NAME/SIDE'; empty: the part's own regions."""
    metres: float | None = None
    """The distance of exactly, at_least and at_most [m]: the free gap between the object and it, seen from above."""
    words: str = ""
    """The words it was read from."""


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
    """The words it was read from."""
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
    """Whether its mass is not density times the volume of its closed mesh."""
    scale: float
    """Isotropic factor applied to the object mesh: 1, that of a unit, or to the usual size (`tasks.intent.rescale`)."""
    orientation: OrientationRequest
    region: RegionRequest
    not_understood: tuple[str, ...]
    """Words without an effect."""
    notes: tuple[str, ...]
    candidates: tuple[SupportCandidate, ...] = ()
    """Supports that the sentence may mean, the chosen one first."""
    mass_given: bool = False
    """Whether the mass comes from the user and must not be replaced by density times volume."""
    at: NDArray[np.float64] | None = None
    """The place on the base that the user gave [m], shape (3,); None: the region determines it."""

    def __post_init__(self) -> None:
        if self.at is not None:
            check_array("at", self.at, 3)
