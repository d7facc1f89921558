"""The fixed pictures of a final state that judges see."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False, slots=True)
class JudgedViews:
    """Square RGB images, each (h, w, 3). Those of a whole support are from one camera for all methods, the others from
    cameras at the same directions and distance from the object."""

    clean: Picture
    """The scene before, as in `room`."""
    asset: Picture
    """The object alone, as it was given."""
    room: Picture
    """The support that was asked for, from the middle of the room."""
    front: Picture
    """The object from nearby: from the middle of the room, a little above it."""
    right: Picture
    """From a quarter turn farther, counterclockwise seen from above."""
    back: Picture
    """From the other side."""
    left: Picture
    """From a quarter turn back."""
    top: Picture
    """The support from steeply above."""
    low: Picture
    """From the front and just above the level of what it stands on, where gaps and dents show."""


BEFORE = ("clean", "asset")
"""Names of the pictures of the scene before and of the object alone."""
PLACED = tuple(one.name for one in fields(JudgedViews) if one.name not in BEFORE)
"""Names of the pictures of a placement, in the order in which judges and people see them."""
