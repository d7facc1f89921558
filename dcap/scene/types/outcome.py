"""Result of a stage: a value, or the reason why there is none; and the messages that go with it.

Messages of the stages: plain text explains how a result was made; a `Caution` asks a person for action.

Both are in the same lists, in order of occurrence. `placement.json` has the cautions as `warnings` and the others as
`notes`.
"""

from collections.abc import Iterable
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
    """Share of the tried spots that it blocks [-]."""


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
    """Largest supported share of the object's underside at an unobstructed spot [-]."""
    needed_share: float
    """Required share [-]."""
    blocked_share: float
    """Share of the tried spots that are blocked [-]."""
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
    """Distance between the place and the part."""


@dataclass(frozen=True, eq=False, slots=True)
class HiddenObject:
    """An object that no camera can see."""

    visible_fraction: float
    """Visible share in the best view [-]."""
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
    """An object whose surface encloses no volume and cannot be closed."""

    hole_count: int
    holes: tuple[ObjectHole, ...]
    """The largest holes, the largest first."""


Evidence: TypeAlias = NotInScene | NoRoom | BesideThePart | HiddenObject | OpenObject | LastState


@dataclass(frozen=True, eq=False, slots=True)
class Infeasible:
    """An expected negative outcome with its evidence; it travels through the remaining stages unchanged."""

    reason: Reason
    """The reason code."""
    message: str
    """One sentence for a person: what, where, which value."""
    evidence: Evidence | None
    """Numbers and names behind the decision; None if the solver broke."""


Value = TypeVar("Value")

Outcome: TypeAlias = Value | Infeasible


class Cause(StrEnum):
    """Reasons for a person to check a result, the most important first."""

    NOT_MET = "not_met"
    """A request that the result does not meet."""
    NOT_UNDERSTOOD = "not_understood"
    """Words of the sentence, or lines of a file of labels, that had no effect."""
    ASSUMED = "assumed"
    """A unit, an axis, a size or a shape was guessed, and the result depends on it."""
    WHICH = "which"
    """Another thing, or another side of it, may be meant."""


class Caution(str):
    """A message that asks for action."""

    __slots__ = ("cause",)
    cause: Cause

    def __new__(cls, cause: Cause, text: str) -> "Caution":
        """The message with its cause."""
        made = super().__new__(cls, text)
        made.cause = cause
        return made

    def __getnewargs__(self) -> tuple[Cause, str]:  # type: ignore[override]
        return self.cause, str(self)


def about(subject: str, message: str) -> str:
    """A message prefixed with its subject; a caution remains a caution."""
    text = f"{subject}: {message}"
    return Caution(message.cause, text) if isinstance(message, Caution) else text


def cautions(messages: Iterable[str]) -> list[Caution]:
    """Messages that ask for action, the most important cause first, without repetitions."""
    order = list(Cause)
    found = dict.fromkeys(one for one in messages if isinstance(one, Caution))
    return sorted(found, key=lambda one: order.index(one.cause))


def explanations(messages: Iterable[str]) -> list[str]:
    """The other messages, without repetitions."""
    return list(dict.fromkeys(one for one in messages if not isinstance(one, Caution)))
