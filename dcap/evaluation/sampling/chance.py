"""Random draws that depend only on words: a digest as a number, so that no draw depends on another or on their
order."""

import hashlib
from collections.abc import Sequence
from typing import TypeVar

ValueT = TypeVar("ValueT")
DIGITS = 13
"""Hexadecimal digits that a float holds exactly [-]."""


def chance(*words: object) -> float:
    """A pseudo-random number in [0, 1), the same for the same words."""
    digest = hashlib.sha256("\n".join(map(str, words)).encode()).hexdigest()
    return float(int(digest[:DIGITS], 16) / 16**DIGITS)


def picked(options: Sequence[ValueT], *words: object) -> ValueT:
    """One of several, by chance."""
    return options[int(chance(*words) * len(options))]
