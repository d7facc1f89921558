"""What a stage returns: a value, or the reason why there is none."""

from dataclasses import dataclass
from enum import StrEnum
from typing import TypeAlias, TypeVar


class Reason(StrEnum):
    """Why a placement is infeasible (fixed codes, part of the contract)."""

    LEFT_TARGET = "left_target"
    TOPPLED = "toppled"
    NO_EQUILIBRIUM = "no_equilibrium"
    UNSTABLE_STEP = "unstable_step"
    TARGET_NOT_FOUND = "target_not_found"
    NO_SUPPORT_HIT = "no_support_hit"
    TOO_LARGE_FOR_TARGET = "too_large_for_target"
    BURIED = "buried"


@dataclass(frozen=True, eq=False, slots=True)
class Infeasible:
    """An expected negative outcome with its evidence; it travels through the remaining stages unchanged."""

    reason: Reason
    """The code."""
    message: str
    """One sentence for a person: what, where, which value."""
    evidence: dict[str, object]
    """Numbers and names behind the decision; JSON types only."""


Value = TypeVar("Value")

Outcome: TypeAlias = Value | Infeasible
