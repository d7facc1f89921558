"""How long the unit of a file is, where only the height of a thing in it tells."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FileScale:
    """A length and what it rests on."""

    metres: float
    """Of the file's unit [m]."""
    note: str
    """How it was found, in a sentence."""
