"""The fixed pictures of a final state that judges see."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]


@dataclass(frozen=True, eq=False, slots=True)
class JudgedViews:
    """Square RGB images, each (h, w, 3); cameras stand where the scene and the object's size and place say."""

    clean: Picture
    """The scene before, as in `room`."""
    asset: Picture
    """The object alone, at its final orientation."""
    room: Picture
    """From a corner of the room, with the object in the middle."""
    front: Picture
    """The object from nearby: from -y, a little above it."""
    right: Picture
    """From +x."""
    back: Picture
    """From +y."""
    left: Picture
    """From -x."""
    top: Picture
    """From steeply above."""
    low: Picture
    """From -y and just above the level of what it stands on, where gaps and dents show."""


BEFORE = ("clean", "asset")
"""Names of the pictures of the scene before and of the object alone."""
PLACED = tuple(one.name for one in fields(JudgedViews) if one.name not in BEFORE)
"""Names of the pictures of a placement, in the order in which judges and people see them."""
