"""Length of a file's unit, from the known height of a thing in it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileScale:
    """Length of a file's unit, and its reason."""

    metres: float
    """Length of the file's unit [m]."""
    note: str
    """Origin of the length, in a sentence."""
