"""Result of a stage: a value, or the reason why there is none."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.settled import LastState


class Reason(StrEnum):
    """Reasons why a placement is infeasible (fixed codes, part of the contract)."""

    LEFT_TARGET = "left_target"
    TOPPLED = "toppled"
    NO_EQUILIBRIUM = "no_equilibrium"
    UNSTABLE_STEP = "unstable_step"
    TARGET_NOT_FOUND = "target_not_found"
    NO_SUPPORT_HIT = "no_support_hit"
    TOO_LARGE_FOR_TARGET = "too_large_for_target"
    BURIED = "buried"
    OBJECT_NOT_SOLID = "object_not_solid"


@dataclass(frozen=True, slots=True)
class NotInScene:
    """A thing that the sentence names but the scene lacks."""

    asked: str
    present: tuple[str, ...]
    """Labels of the scene's things."""
    object: str


@dataclass(frozen=True, slots=True)
class InTheWay:
    """An obstacle in the object's place."""

    id: str
    name: str
    share: float
    """Share of the tried spots [-]."""


@dataclass(frozen=True, slots=True)
class NoRoom:
    """A part on which the object does not fit."""

    base: str
    """Instance id."""
    part: str
    region: str
    footprint_m: tuple[float, float]
    height_m: float
    part_size_m: tuple[float, float]
    best_supported_share: float
    """Largest supported share of the object's underside, with nothing in the way [-]."""
    needed_share: float
    """[-]."""
    blocked_share: float
    """Share of the tried spots [-]."""
    in_the_way: tuple[InTheWay, ...]


@dataclass(frozen=True, slots=True)
class BesideThePart:
    """A place next to something that is not on the part."""

    base: str
    """Instance id."""
    part: str
    region: str
    references: tuple[str, ...]
    beside_m: float
    """Distance of the place from the part."""


@dataclass(frozen=True, eq=False, slots=True)
class HiddenObject:
    """An object that no camera sees."""

    visible_fraction: float
    """[-]."""
    camera_position: NDArray[np.float64]
    """Camera position of the best view [m], shape (3,)."""


@dataclass(frozen=True, slots=True)
class ObjectHole:
    """A hole in an object's surface."""

    middle_m: tuple[float, ...]
    """Middle of its rim, at the pose before the drop [m], three numbers."""
    size_m: tuple[float, float]
    """Length and width [m]."""


@dataclass(frozen=True, slots=True)
class OpenObject:
    """An object whose surface encloses nothing and cannot be closed."""

    hole_count: int
    holes: tuple[ObjectHole, ...]
    """The largest ones, the largest first."""


Evidence: TypeAlias = NotInScene | NoRoom | BesideThePart | HiddenObject | OpenObject | LastState


@dataclass(frozen=True, eq=False, slots=True)
class Infeasible:
    """An expected negative outcome with its evidence; it travels through the remaining stages unchanged."""

    reason: Reason
    """The code."""
    message: str
    """One sentence for a person: what, where, which value."""
    evidence: Evidence | None
    """Numbers and names behind the decision; None if the solver broke."""


Value = TypeVar("Value")

Outcome: TypeAlias = Value | Infeasible
